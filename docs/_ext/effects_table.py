"""The directive `effects-table`: every effect of the catalogue, as it describes itself."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive

HEADINGS = ("key", "what it is", "stage", "largest expected", "what to check by hand")


def row(effect: Any) -> tuple[str, ...]:
    """Its cells; a size in the unit of its first parameter."""
    first = effect.parameters[0]
    size = f"{effect.largest:g} {'' if first.unit == '1' else first.unit}".strip() if effect.largest else ""
    stage = effect.stage.name.lower()
    if effect.depth_source:
        stage += f" ({effect.depth_source} only)"
    return f"``{effect.key}``", effect.title, stage, size, effect.check.action if effect.check else ""


def table() -> list[str]:
    """The lines (reStructuredText) of the table, in the order in which effects act."""
    from calibration.effects import EFFECTS

    lines = [".. list-table::", "   :header-rows: 1", ""]
    for cells in (HEADINGS, *map(row, EFFECTS.values())):
        for number, cell in enumerate(cells):
            lines.append(f"   {'*' if number == 0 else ' '} - {cell}".rstrip())
    return lines


class EffectsTable(Directive):
    """Takes no argument and no content."""

    def run(self) -> list[nodes.Node]:
        """The table."""
        from docutils.core import publish_doctree

        return list(publish_doctree("\n".join(table())).children)


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("effects-table", EffectsTable)
    return {"parallel_read_safe": True}
