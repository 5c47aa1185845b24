"""The wheel holds what it should, under the names it should, and works away from the checkout."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

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
    entry = "import sys; from tactilevision.cli import main; sys.exit(main())"
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
    where = subprocess.run(
        [
            str(home / "bin" / "python"),
            "-I",
            "-c",
            "import tactilevision, calibration; print(tactilevision.__file__)",
        ],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert where.startswith(str(home))
