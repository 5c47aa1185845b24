"""Files that the version before the present layout wrote are still read, and say the same."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from tactilevision.cli import main

BEFORE = Path(__file__).parent / "data" / "before"
# mm, of frame 00012. That version read .2988, .2655, .3799: it took the edge of the dark gel for a contact, and
# free gel of frame 00000 for 23 um deeper than now.
PEAKS_MM = {"polynomial": 0.2739, "lookup": 0.2469, "either": 0.3479}


def run(*words: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        return main()


@pytest.mark.parametrize("name", PEAKS_MM)
def test_a_saved_method_reads_the_same_height_map(name: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    method = BEFORE / "methods" / f"{name}.npz"
    assert run("depth", BEFORE / "small", "--method", method, "--out", out, "--even-so") == 0
    table = np.genfromtxt(out / "depth.csv", delimiter=",", names=True, dtype=None, encoding=None)
    assert table["peak_mm"][-1] == pytest.approx(PEAKS_MM[name], abs=1e-4)


def test_certified_points_and_their_edge_profile_are_read(tmp_path: Path) -> None:
    assert run("calibrate", BEFORE / "calibrated", "--out", tmp_path / "out") == 0
    content = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert content["youngs_modulus_MPa"]["value"] == pytest.approx(0.19001105007, rel=1e-6)
    assert content["youngs_modulus_MPa"]["interval95"] == pytest.approx([0.168231, 0.207779], rel=1e-4)
    assert content["c_N_per_mm"]["value"] == pytest.approx(3.46317291754, rel=1e-6)


def test_a_calibration_is_read(tmp_path: Path) -> None:
    material = BEFORE / "calibrated" / "calibration.json"
    method = BEFORE / "methods" / "polynomial.npz"
    out = tmp_path / "out"
    assert (
        run("force", BEFORE / "small", "--method", method, "--calibration", material, "--out", out, "--even-so")
        == 0
    )
    table = np.genfromtxt(
        out / "resultants.csv", delimiter=",", names=True, usecols=(0, 4, 7), dtype=None, encoding=None
    )
    assert table["fz_std_N"][0] == pytest.approx(0.03594109, rel=1e-4)


def test_steps_taken_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(BEFORE / "steps", tmp_path / "steps")
    assert run("steps", tmp_path / "steps") == 0
    assert "1. + viscoelasticity: rms 54.90 -> 24.11 mN" in capsys.readouterr().out
