"""Imports go one way, and looking at the package costs nothing: the house's walls as tests."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(p for room in ("tactilevision", "calibration") for p in (ROOT / room).rglob("*.py"))
FOR_READERS = "report"  # the one room of calibration that may use figures, and that no other room knows
HEAVY = {"torch", "kornia", "matplotlib", "skimage"}


def imported(path: Path) -> set[str]:
    """Dotted names that a file imports anywhere in it, but for those that only a type checker sees."""
    names: set[str] = set()
    tree = ast.parse(path.read_text())
    tree.body = [
        node for node in tree.body if not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test))
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
    return names


def rooms(path: Path) -> set[str]:
    return {name.split(".")[1] for name in imported(path) if name.startswith("tactilevision.")}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_keep_to_the_arrows(path: Path) -> None:
    room = path.relative_to(ROOT).parts
    tops = {name.split(".")[0] for name in imported(path)}
    if room[0] == "tactilevision" and room[1] not in ("cli", "__main__.py"):
        assert "calibration" not in tops, "tactilevision never imports calibration"
        assert "cli" not in rooms(path)
    if room[0] == "calibration" and room[1] != FOR_READERS:
        allowed = {"records", "errors", "mechanics", "files", "recording", "robust"}
        assert rooms(path) <= allowed, f"calibration stands on {sorted(allowed)} only"
        assert not any(name.startswith(f"calibration.{FOR_READERS}") for name in imported(path))
    if room[1] == "mechanics":
        assert rooms(path) <= {"mechanics", "records", "errors", "files"}, (
            "mechanics knows neither pictures nor fits"
        )
    if "plots" not in room and room[1] != "plots.py":
        assert "matplotlib" not in tops, "figures are drawn in tactilevision.plots alone"
    if room[0] == "tactilevision":
        simulates = room[1] == "synthetic" or room[1:] == ("cli", "simulate.py")
        assert simulates or "truth.toml" not in path.read_text(), "truth is for scorers alone"


@pytest.mark.parametrize("name", ["tactilevision", "calibration"])
def test_importing_the_package_loads_nothing_heavy(name: str) -> None:
    code = f"import sys, {name}; print(*sorted({HEAVY!r} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == []


def test_no_file_and_no_function_outgrows_its_page() -> None:
    too_long = {str(p.relative_to(ROOT)): n for p in SOURCES if (n := p.read_text().count("\n")) > 350}
    assert not too_long
