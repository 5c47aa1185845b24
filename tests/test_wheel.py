"""The wheel holds what it should, under the names it should, and works away from the checkout."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (built,) = out.glob("*.whl")
    return built


def test_the_sdist_holds_what_builds_the_wheel_and_nothing_that_needs_the_samples(
    wheel: Path, tmp_path: Path
) -> None:
    build = [sys.executable, "-m", "hatchling", "build"]
    subprocess.run([*build, "-t", "sdist", "-d", str(tmp_path)], cwd=ROOT, check=True, capture_output=True)
    (packed,) = tmp_path.glob("*.tar.gz")
    shutil.unpack_archive(packed, tmp_path, filter="data")
    (unpacked,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert {path.name for path in unpacked.iterdir() if path.is_dir()} == {
        "tactilevision",
        "calibration",
        "models",
    }
    subprocess.run([*build, "-t", "wheel", "-d", str(tmp_path)], cwd=unpacked, check=True, capture_output=True)
    (again,) = tmp_path.glob("*.whl")
    assert sorted(zipfile.ZipFile(again).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())


FIRST_SOUND = {
    "opencv-contrib-python-headless": "4.12",
    "torch": "2.10",
    "onnx": "1.21",
}  # CVE's first fixed version


def test_no_version_with_a_known_fault_may_be_installed() -> None:
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    needs = {need.name: need for need in map(Requirement, stated)}
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line)
    for name, first in FIRST_SOUND.items():
        assert needs[name].specifier.contains(first)
        assert not needs[name].specifier.contains(
            f"{first.partition('.')[0]}.{int(first.partition('.')[2]) - 1}.9"
        )
    assert [n for n, need in needs.items() if n in pinned and not need.specifier.contains(pinned[n])] == []


def test_top_level_names_are_the_two_packages(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"tactilevision", "calibration"}
    assert not [name for name in names if name.endswith((".ipynb", ".tmp~")) or "sample_frames" in name]


def test_every_data_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    listed = subprocess.run(
        ["git", "ls-files", "tactilevision", "calibration"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    assert set(listed) <= set(zipfile.ZipFile(wheel).namelist())


def test_installed_alone_it_reproduces_the_papers_figures(wheel: Path, tmp_path: Path) -> None:
    """A fresh environment sees the wheel and the dependencies, but no checkout and no editable install."""
    home = tmp_path / "env"
    venv.create(home, with_pip=False)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    site = home / "lib" / version / "site-packages"
    zipfile.ZipFile(wheel).extractall(site)
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    entry = (
        "import sys, calibration, tactilevision; from tactilevision.cli import main; "
        "print(calibration.__file__, tactilevision.__file__, sep='\\n'); sys.exit(main())"
    )
    out = subprocess.run(
        [
            str(home / "bin" / "python"),
            "-I",
            "-c",
            entry,
            "calibrate",
            str(ROOT / "sample_frames" / "paper_points"),
            "--law",
            "paper",
            "--out",
            str(tmp_path / "out"),
        ],
        cwd=tmp_path,
        check=False,
        capture_output=True,
        text=True,
    )
    assert out.returncode == 0, out.stderr
    assert "0.1988" in out.stdout
    assert all(where.startswith(str(home)) for where in out.stdout.splitlines()[:2])
