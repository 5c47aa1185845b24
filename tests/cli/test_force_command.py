"""`force` as a user calls it: tractions, table, figures and JSON; calibrations of another sensor."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.effects import EFFECTS
from tactilevision.cli import force as command, main
from tactilevision.files.cache import cache_folder
from tactilevision.force.comparison import shear_summary
from tactilevision.force.field import NO_CONTACT
from tactilevision.force.frame import FrameForce
from tactilevision.recording.layout import FOUND
from tactilevision.recording.read import read_recording

RIG = Path(__file__).parents[2] / "sample_frames" / "hidden_rig"
FRAMES = 30  # of 162: a few presses
BALLS = 8  # of 20: enough for a light whose own fit is not what is tested
CALIBRATION: dict[str, Any] = {
    "youngs_modulus_MPa": {"value": 0.2, "std": 0.006, "interval95": [0.188, 0.212], "unit": "MPa"},
    "poisson_ratio": {"value": 0.48, "std": 0.005, "interval95": [0.47, 0.49], "unit": "1"},
    "covariance": {
        "of": ["youngs_modulus_MPa", "poisson_ratio"],
        "matrix": [[3.6e-5, -2.5e-5], [-2.5e-5, 2.5e-5]],
    },
    "gel": {"thickness_mm": 3.0, "shape": "disc"},
}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """The rig's sample on an unbounded gel: sides take half a minute to work out."""
    path = tmp_path / "rig"
    shutil.copytree(RIG, path)
    settings = (path / "recording.toml").read_text()
    assert 'shape = "disc"' in settings
    (path / "recording.toml").write_text(settings.replace('shape = "disc"', 'shape = "unbounded"'))
    shorten(path / "reference" / "ball.csv", BALLS)
    return path


def force(
    monkeypatch: pytest.MonkeyPatch, recording: Path, content: dict[str, Any], *more: object
) -> tuple[int, Path]:
    path = recording.parent / "calibration.json"
    path.write_text(json.dumps(content))
    out = recording.parent / "out"
    said = ["force", recording, "--calibration", path, "--out", out, "--workers", 1, *more]
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, said)])
    return main(), out


def shorten(table: Path, rows: int) -> None:
    """Keep the first rows of a table alone."""
    table.write_text("\n".join(table.read_text().splitlines()[: rows + 1]) + "\n")


def test_a_press_becomes_forces_figures_and_numbers(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = recording.parent / "r.json"
    shorten(recording / "frames.csv", FRAMES)
    monkeypatch.setattr("calibration.tasks.diagnose.effects_for", lambda _: [EFFECTS["clock_offset"]])
    code, out = force(monkeypatch, recording, CALIBRATION, "--json", told, "--pictures", 1)
    assert code == 0
    with (out / "resultants.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == FRAMES
    with np.load(out / "tractions.npz", allow_pickle=False) as stacks:
        force_N = stacks["t_z"].sum(axis=(1, 2)) * stacks["mm_per_px"].prod()
    assert force_N == pytest.approx([float(row["fz_N"]) for row in rows], rel=1e-3, abs=1e-6)
    result = json.loads(told.read_text())
    by_name = {entry["parameter"]: entry for entry in result["sensitivity"]}
    assert by_name["youngs_modulus"]["change_percent"] == pytest.approx([-5.88, 5.88], abs=0.01)
    low, high = by_name["poisson_ratio"]["change_percent"]
    assert low < -1
    assert high > 1
    both = by_name["both together"]["change_percent"]
    assert both[1] < by_name["youngs_modulus"]["change_percent"][1], (
        "what is tied together moves the force by less"
    )
    assert result["measured"]["z"]["frames"] > 5
    assert 0.6 < result["measured"]["z"]["ratio"] < 1.4
    assert result["shear"]["known"] == 0
    assert "follow" in result["shear"]["why"], "an ink without grain: the output says why fx and fy are not there"
    assert "clock_offset" in result["diagnosis"]["candidates"]
    assert not result["diagnosis"]["stopped"], "the diagnosis comes to its end"
    assert (out / "diagnosis" / "report.html").is_file()
    beside = read_recording(out / "beside")
    assert {curve.press for curve in beside.curves} == {press.press for press in beside.presses}
    assert beside.curves[0].extra["picture_fz_N"].max() > 0.1
    assert np.isfinite([press.x_mm for press in beside.presses]).all()
    figures = {path.name for path in (out / "figures").iterdir()}
    assert {"resultants.png", "sensitivity.png", "residuals.png"} <= figures
    assert any(name.endswith("_force.png") for name in figures)
    printed = capsys.readouterr()
    assert "another sensor" not in printed.err
    first, told_first = contents(out / "diagnosis"), told.read_bytes()
    assert str(out / "diagnosis") in first["repeat.sh"].decode(), "the script names the folder that it lies in"
    (out / "diagnosis" / FOUND).mkdir()
    with monkeypatch.context() as hurried:
        hurried.setattr(command, "MOST_S", 0)
        folder = cache_folder()
        assert folder is not None
        had = set(folder.glob("diagnosis-*"))
        cut = command._diagnose(out / "beside", out / "cut")
        assert cut is not None
        assert cut["stopped"]
        assert set(folder.glob("diagnosis-*")) == had, "what the deadline cut is not kept"
    capsys.readouterr()
    monkeypatch.delattr(command, "_diagnosed")  # the same inputs: what was found is read from the cache
    assert force(monkeypatch, recording, CALIBRATION, "--json", told, "--pictures", 1)[0] == 0
    assert (contents(out / "diagnosis"), told.read_bytes()) == (first, told_first)
    assert not (out / "diagnosis" / FOUND).exists()
    again = capsys.readouterr()
    assert again.out == printed.out
    assert warnings(again.err) == warnings(printed.err) != []


def warnings(said: str) -> list[str]:
    """Return the warnings among lines of progress, which a fast run has not."""
    return [line for line in said.splitlines() if line.startswith("warning")]


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files by their names."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_calibration_of_another_gel_is_refused(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    thinner = CALIBRATION | {"gel": {"thickness_mm": 2.0, "shape": "disc"}}
    assert force(monkeypatch, recording, thinner)[0] == 2
    assert "another gel" in capsys.readouterr().err


@pytest.mark.slow
def test_a_gel_that_the_force_sensor_finds_stiffer_is_warned_of(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shorten(recording / "frames.csv", 60)
    softer = CALIBRATION | {"youngs_modulus_MPa": 0.05}
    assert force(monkeypatch, recording, softer, "--pictures", 0)[0] == 0
    assert "another sensor" in capsys.readouterr().err


def test_where_some_frames_tell_no_shear_the_output_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    known = FrameForce("0", 0.0, (0.1, 0.1, 1.0), (0.1,) * 3)
    lost = replace(known, resultant_N=(np.nan, np.nan, 1.0), flags="shear not used: markers lost")
    said = shear_summary([known, known, lost, replace(known, flags=NO_CONTACT)])
    command._say_shear(said)
    assert (said["touched"], said["known"]) == (3, 2)
    assert "fx and fy are known in 2 of 3 frames with contact; else shear not used" in capsys.readouterr().out


@pytest.mark.parametrize("left", [True, False])
def test_a_zero_that_cannot_be_taken_off_is_told(
    left: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without presses.csv nothing says when the gel was free."""
    said = {"z": {"rms_N": 0.4, "frames": 3, "inside_interval95": 0.0, "ratio": 1.0}}
    monkeypatch.setattr("tactilevision.force.comparison.summary", lambda found: said)
    found: Any = SimpleNamespace(touched=5, left_out={"why": 2})
    assert command._say_residuals(found, has_offset=left) == said
    out = capsys.readouterr().out
    assert "rms 0.400 N over 3 of 5 frames" in out
    assert "2 frames with contact are not compared: why" in out
    assert ("no presses.csv" in out) is left
