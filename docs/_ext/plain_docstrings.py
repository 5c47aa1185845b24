"""Plain docstrings as reStructuredText: indented lines are equations, everything else is taken as written."""

from __future__ import annotations

import re
from typing import Any

CODE = re.compile(r"(`+[^`]+`+)")
SPECIAL = re.compile(r"([*|\\_])")


def escaped(line: str) -> str:
    """A line of prose in which only `code` means anything."""
    parts = CODE.split(line)
    return "".join(
        f"``{part.strip('`')}``" if part.startswith("`") else SPECIAL.sub(r"\\\1", part) for part in parts
    )


def blocks(lines: list[str]) -> list[list[str]]:
    """Runs of lines between blank ones."""
    found: list[list[str]] = [[]]
    for line in lines:
        if line.strip():
            found[-1].append(line.rstrip())
        elif found[-1]:
            found.append([])
    return [block for block in found if block]


def is_literal(block: list[str]) -> bool:
    """Whether a block keeps its lines: an equation, a table or a list, told by its indentation."""
    return any(line.startswith("  ") for line in block)


def as_rst(lines: list[str]) -> list[str]:
    """The docstring's lines as reStructuredText."""
    said: list[str] = []
    for block in blocks(lines):
        said += ["::", "", *(f"    {line}" for line in block)] if is_literal(block) else map(escaped, block)
        said.append("")
    return said


def process(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Handler of `autodoc-process-docstring`."""
    lines[:] = as_rst(lines)


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", process)
    return {"parallel_read_safe": True}
