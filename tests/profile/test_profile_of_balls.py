"""A profile made of ball presses alone."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from tactilevision.cli import main
from tactilevision.profile.sensor import open_with_profile, sensor_for
from tactilevision.profile.storage import read_profile
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "rendered_shadows"
BALLS = 8  # enough for a light whose own fit is not what is tested


def run(*words: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        return main()


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample's balls and flats, with no frames."""
    root = tmp_path_factory.mktemp("light") / "balls"
    root.mkdir()
    shutil.copy(SAMPLE / "recording.toml", root)
    shutil.copytree(SAMPLE / "reference", root / "reference")
    table = root / "reference" / "ball.csv"
    table.write_text("\n".join(table.read_text().splitlines()[: BALLS + 1]) + "\n")
    return root


def test_balls_without_frames_make_a_profile_whose_deep_maps_are_flagged(balls: Path, tmp_path: Path) -> None:
    assert run("calibrate-sensor", balls, "--method", "polynomial", "--out", tmp_path / "a.tvs") == 0
    profile = read_profile(tmp_path / "a.tvs")
    assert profile.frame_size_px == (427, 320)
    sensor = sensor_for(open_with_profile(SAMPLE, profile), profile)
    free, deep = (sensor.read(read_frame(read_recording(SAMPLE), number).rgb) for number in (0, 4))
    assert "shadow" in deep.flags
    assert "shadow" not in free.flags


def test_commands_that_need_frames_say_where_they_belong(
    balls: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert read_recording(balls).frame_size_px == (427, 320)
    for command in ("depth", "calibrate", "diagnose"):
        assert run(command, balls, "--out", tmp_path) == 2
        assert "balls/frames: " in capsys.readouterr().err
