"""The two catalogues of public names are whole, and hold whatever was imported first."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from each import each

import calibration
import tactilevision

ROOT = Path(__file__).parents[1]
PUBLIC = [(package, name) for package in (tactilevision, calibration) for name in package.__all__]
NO_CALL = {"EFFECTS", "LAWS", "Floats", "Effect"}  # tables and types for annotations
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in ("tactilevision", "calibration")
    for path in (ROOT / package).rglob("*.py")
    if path.name != "__main__.py"
)
CHECK = """
import importlib, sys
from types import ModuleType
for module in sys.argv[1].split():
    importlib.import_module(module)
import calibration, tactilevision
for package in (calibration, tactilevision):
    for name in package.__all__:
        found = getattr(package, name)
        assert not isinstance(found, ModuleType), f"{name} is a module"
"""


@each("package, name", PUBLIC)
def test_a_public_name_is_there_and_says_what_it_is(package: ModuleType, name: str) -> None:
    found = getattr(package, name)
    assert not isinstance(found, ModuleType)
    assert callable(found) or name in NO_CALL
    assert found.__doc__ or name in NO_CALL


@pytest.mark.parametrize("package", [tactilevision, calibration], ids=lambda p: p.__name__)
def test_the_catalogue_names_what_can_be_loaded(package: ModuleType) -> None:
    assert set(package.__all__) <= set(dir(package))
    assert all(getattr(package, name) is not None for name in package.__all__)


@pytest.mark.parametrize("package", [tactilevision, calibration], ids=lambda p: p.__name__)
def test_an_unknown_name_is_an_attribute_error(package: ModuleType) -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        package.nonsense  # noqa: B018 - the look-up itself is the test


@pytest.mark.parametrize(
    "order", ["shuffled", *(pytest.param(order, marks=pytest.mark.slow) for order in ("sorted", "reversed"))]
)
def test_public_names_are_no_modules_whatever_was_imported_first(order: str) -> None:
    seed = int(np.random.default_rng().integers(2**31))
    names = {
        "sorted": MODULES,
        "reversed": MODULES[::-1],
        "shuffled": np.random.default_rng(seed).permutation(MODULES).tolist(),
    }[order]
    done = subprocess.run([sys.executable, "-c", CHECK, " ".join(names)], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, f"seed {seed}: {done.stderr[-2000:]}"


PAGES = [ROOT / "README.md", *(p for p in (ROOT / "docs").rglob("*.md") if "evidence" not in p.parts)]


@each("path", sorted([*PAGES, *(ROOT / "examples").glob("*.py")]))
def test_examples_and_pages_use_the_public_names_alone(path: Path) -> None:
    assert re.findall(r"from (?:tactilevision|calibration)\.\S+ import .*", path.read_text()) == []
    for package, names in re.findall(
        r"^from (tactilevision|calibration) import ([^(\n]+)$", path.read_text(), re.M
    ):
        listed = {"tactilevision": tactilevision, "calibration": calibration}[package].__all__
        assert set(re.split(r",\s*", names)) <= set(listed)


def test_the_command_line_works_where_another_package_emptied_ours(tmp_path: Path) -> None:
    for package in ("tactilevision", "calibration", "models"):
        shutil.copytree(ROOT / package, tmp_path / package)  # with what is compiled already
    (tmp_path / "calibration" / "__init__.py").write_text("")
    command = [sys.executable, "-m", "tactilevision", "calibrate", str(ROOT / "sample_frames" / "paper_points")]
    done = subprocess.run([*command, "--no-test", "--out", "out"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "calibration.json").is_file()
