"""The samples run as they are and give what was put into them; truth.toml is read here and nowhere else."""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from each import each
from shared_scenes import scenes, shared

from benchmarks.digest.cases import calibration
from benchmarks.digest.compare import differences
from benchmarks.digest.record import read_record
from tactilevision.cli import main
from tactilevision.recording.read import read_recording

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "sample_frames" / "gelslim3"


@pytest.fixture(scope="module")
def calibrated() -> Path:
    return calibrated_sample()


@shared
def calibrated_sample() -> Path:
    out = scenes() / "sample"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", "calibrate", str(SAMPLE), "--out", str(out)])
        assert main() == 0
    return out


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    return tomllib.loads((SAMPLE / "truth.toml").read_text())


@pytest.fixture(scope="module")
def result(calibrated: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((calibrated / "calibration.json").read_text())
    return content


@each("key", ["c_N_per_mm", "youngs_modulus_MPa", "poisson_ratio", "beta", "clock_offset_s"])
def test_the_truth_lies_in_the_interval(key: str, result: dict[str, Any], truth: dict[str, Any]) -> None:
    low, high = result[key]["interval95"]
    assert low <= truth[key] <= high


def test_the_sample_gives_what_is_on_record(calibrated: Path) -> None:
    """On whatever processor: c to 1e-6 of itself; `make digest` asks for 1e-8 on one machine."""
    case = "calibrate gelslim3"
    assert list(differences(read_record()[case], calibration(calibrated), case, times=100)) == []


def test_stiffness_and_clock_are_near(result: dict[str, Any], truth: dict[str, Any]) -> None:
    """The clocks within 3 ms, c within 2 %: on a ramp the touch itself leaves about 1.3 % of c open."""
    assert result["c_N_per_mm"]["value"] == pytest.approx(truth["c_N_per_mm"], rel=0.02)
    assert result["clock_offset_s"]["value"] == pytest.approx(truth["clock_offset_s"], abs=0.003)


def test_every_press_is_judged_rightly(result: dict[str, Any], truth: dict[str, Any]) -> None:
    assert result["presses_accepted"] == [p["press"] for p in truth["press"] if p["good"]]
    said = {p["press"]: p["reason"] for p in result["presses_rejected"]}
    assert said == {p["press"]: p["reason"] for p in truth["press"] if not p["good"]}


def test_depths_are_certified_within_their_std(calibrated: Path, truth: dict[str, Any]) -> None:
    """The bevel meets the rising gel early, at .9 of the machined height; uncorrected, depth would be 10 % off."""
    import pandas as pd

    points = pd.read_csv(calibrated / "points.csv", dtype={"press": str}).set_index("press")
    for press in truth["press"]:
        if press["good"]:
            point = points.loc[press["press"]]
            assert abs(point["depth_mm"] - press["depth_mm"]) < 3 * point["depth_std_mm"]
            assert point["depth_uncorrected_mm"] == pytest.approx(press["height_mm"], abs=0.005)


def test_what_was_written_is_a_recording_again(calibrated: Path) -> None:
    """curves.csv and points.csv go back in beside the recording's own settings."""
    again = calibrated / "again"
    again.mkdir()
    for name in ("points.csv", "curves.csv"):
        (again / name).write_bytes((calibrated / name).read_bytes())
    (again / "recording.toml").write_text(
        (SAMPLE / "recording.toml").read_text().replace('rectification = "maps.npz"\n', "")
    )
    recording = read_recording(again)
    assert len(recording.points) == 23
    assert recording.curves


def test_the_report_shows_each_press(calibrated: Path) -> None:
    text = (calibrated / "report.html").read_text()
    assert text.count("<img") == 2 + len(list((calibrated / "presses").glob("*.png")))
    assert "bevel not touched" in text
