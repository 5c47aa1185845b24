"""A profile made of ball presses alone: it keeps the lamps, and undoes shadows in frames that show them."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tactilevision.cli import main
from tactilevision.profile.sensor import load_sensor, open_with_profile, sensor_for
from tactilevision.profile.storage import read_profile
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "rendered_shadows"


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
    return root


def test_balls_without_frames_make_a_profile_that_undoes_shadows(balls: Path, tmp_path: Path) -> None:
    assert run("calibrate-sensor", balls, "--out", tmp_path / "a.tvs") == 0
    profile = read_profile(tmp_path / "a.tvs")
    assert profile.lamps is None, "no frame has shown what they cast"
    assert profile.frame_size_px == (427, 320)
    frames = open_with_profile(SAMPLE, profile)
    undone = sensor_for(frames, profile, shadows=True)
    assert undone.shadows
    assert undone.profile.lamps is not None
    assert undone.profile.lamps.refined is not None, "as deep as their shadows have faces, too"
    assert undone.reconstructor.shadows is not None
    assert any("cast shadows" in one for one in undone.reconstructor.warnings)
    assert not sensor_for(frames, profile, shadows=False).shadows
    asked, left = load_sensor(tmp_path / "a.tvs", shadows=True), load_sensor(tmp_path / "a.tvs")
    assert asked.reconstructor.shadows is not None, "who asks for it has no folder to look at"
    assert left.reconstructor.shadows is None
    free = replace(frames, frame_names=frames.frame_names[:1], frame_times_s=frames.frame_times_s[:1])
    assert not sensor_for(free, profile, shadows=True).shadows, "the first frame touches nothing"


def test_commands_that_need_frames_say_where_they_belong(
    balls: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert read_recording(balls).frame_size_px == (427, 320)
    for command in ("depth", "calibrate", "diagnose"):
        assert run(command, balls, "--out", tmp_path) == 2
        assert "balls/frames: " in capsys.readouterr().err
