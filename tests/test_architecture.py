"""Imports go one way, and looking at the package costs nothing: the order of the packages as tests."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from each import each
from importlinter.cli import lint_imports
from sources import statements

ROOT = Path(__file__).parents[1]
SOURCES = sorted(p for name in ("tactilevision", "calibration") for p in (ROOT / name).rglob("*.py"))
HEAVY = {"torch", "kornia", "matplotlib", "skimage"}


def imported(path: Path) -> set[str]:
    """Dotted names that a file imports anywhere in it, those that only a type checker sees too."""
    names: set[str] = set()
    for node in statements(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
    return names


def test_imports_keep_to_the_declared_order(capsys: pytest.CaptureFixture[str]) -> None:
    """The contracts of pyproject.toml: no arrow up, no circle."""
    code = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert code == 0, capsys.readouterr().out


def test_every_package_and_file_has_its_place_in_the_order() -> None:
    """A new package must be placed before it may land; imports that only a type checker sees count."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    assert not settings.get("exclude_type_checking_imports")
    assert not any("ignore_imports" in contract for contract in settings["contracts"])
    order = next(contract for contract in settings["contracts"] if contract["id"] == "order")
    placed = {name.strip() for layer in order["layers"] for name in layer.split("|")}
    there = {f"tactilevision.{path.stem}" for path in (ROOT / "tactilevision").iterdir()
             if path.suffix == ".py" or (path / "__init__.py").exists()}  # fmt: skip
    assert placed - {"calibration"} == there - {"tactilevision.__init__"}


@each("path", SOURCES)
def test_a_file_imports_what_its_package_may(path: Path) -> None:
    package, names = path.relative_to(ROOT).parts, imported(path)
    used = {name.split(".")[1] for name in names if name.startswith("tactilevision.")}
    if package[0] == "calibration" and package[1] not in ("report", "workbench"):
        allowed = {"records", "errors", "mechanics", "files", "recording", "robust"}
        assert used <= allowed, f"calibration stands on {sorted(allowed)} only"
    if "plots" not in package and package[1] != "plots.py":
        drawing = {name for name in names if name.startswith("matplotlib")} - {"matplotlib.figure"}  # the type
        assert not drawing, "figures are drawn in tactilevision.plots alone"
    if package[0] == "tactilevision":
        simulates = package[1] == "synthetic" or package[1:] == ("cli", "simulate.py")
        assert simulates or "truth.toml" not in path.read_text(), "truth is for scorers alone"


@pytest.mark.parametrize("name", ["tactilevision", "calibration"])
def test_importing_the_package_loads_nothing_heavy(name: str) -> None:
    code = f"import sys, {name}; print(*sorted({HEAVY!r} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == []
