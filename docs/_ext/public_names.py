"""Writes one page of API for each package out of its `__all__`, before Sphinx reads the sources."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path
from typing import Any

PACKAGES = ("tactilevision", "calibration")
HEADINGS = ("Functions", "Classes", "Errors", "Data")


def kind_of(thing: Any) -> str:
    """The heading under which a public name stands."""
    if inspect.isclass(thing):
        return "Errors" if issubclass(thing, BaseException) else "Classes"
    return "Functions" if inspect.isroutine(thing) else "Data"


def entry(package: str, name: str, kind: str, thing: Any) -> list[str]:
    """The directive that documents one name."""
    if kind == "Data":
        listed = ", ".join(f"``{key}``" for key in thing) if hasattr(thing, "__iter__") else f"``{thing!r}``"
        return [f".. py:data:: {name}", f"   :module: {package}", "", f"   {listed}", ""]
    directive = "autofunction" if kind == "Functions" else "autoclass"
    options = ["   :members:"] if kind == "Classes" else []
    return [f".. {directive}:: {package}.{name}", *options, ""]


def page(package: str) -> str:
    """The page (reStructuredText) of one package: a table of all names, then each in full."""
    module = import_module(package)
    lines = [package, "=" * len(package), "", (module.__doc__ or "").split("\n\n")[0], ""]
    names = {kind: [] for kind in HEADINGS}  # type: dict[str, list[tuple[str, Any]]]
    for name in sorted(getattr(module, "__all__", ()), key=str.lower):
        thing = getattr(module, name)
        names[kind_of(thing)].append((name, thing))
    for kind, found in names.items():
        if not found:
            continue
        lines += [kind, "-" * len(kind), ""]
        if kind != "Data":
            lines += [".. autosummary::", "   :nosignatures:", ""]
            lines += [f"   {package}.{name}" for name, _ in found] + [""]
        for name, thing in found:
            lines += entry(package, name, kind, thing)
    return "\n".join(lines)


def write_pages(app: Any) -> None:
    """Write the pages; a page that says the same is left alone, so that a second build is quick."""
    for package in PACKAGES:
        path = Path(app.srcdir) / "api" / f"{package}.rst"
        text = page(package)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("builder-inited", write_pages, priority=100)
    return {"parallel_read_safe": True}
