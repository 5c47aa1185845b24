"""A calibration that fails its own balls says so, flags its maps, and is not used unasked."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from each import each

from tactilevision.cli import source
from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import unfit
from tactilevision.heightmap.build import tuned
from tactilevision.heightmap.inconsistent_light import measured_light
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import make_reference
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import UNFIT
from tactilevision.robots.live import Stream

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import BALL_MM, SENSOR, SHAPE, ball_pictures, flat
from shared_scenes import shared

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "gelslim3"


@each(
    "direction, ratio, fit",
    [(3.5, 0.97, True), (14.7, 0.9, True), (19.0, 0.97, False), (4.0, 0.4, False), (40.0, 2.0, False)],
)
def test_what_balls_left_out_say_decides(direction: float, ratio: float, fit: bool) -> None:
    card = MethodCard(held_out_direction_error_deg=direction, other={"held_out_depth_ratio": ratio})
    assert bool(unfit(card)) != fit
    assert not unfit(MethodCard()), "nothing is known of it"


@lru_cache
@shared
def on_wrong_circles() -> Reconstructor:
    """Circles where no ball is, as those of another folder would be."""
    rng = np.random.default_rng(2)
    reference = make_reference([flat(rng) for _ in range(3)])
    shots = [
        BallPicture(shot.rgb, BALL_MM, (float(rng.uniform(40, SHAPE[1] - 40)), float(rng.uniform(40, 140))), 16.0)
        for shot in ball_pictures(8, rng)
    ]
    calibration = calibrate_from_balls(reference, shots, mm_per_px=SENSOR.mm_per_px, fit=PHOTOMETRIC["polynomial"])
    return tuned(SENSOR, calibration, pictures=shots, free=())


def test_a_calibration_on_wrong_circles_warns_and_flags_every_map() -> None:
    reader = on_wrong_circles()
    assert any("fails its own balls" in warning for warning in reader.warnings)
    assert UNFIT in reader.rectified_map(flat(np.random.default_rng(3))).flags


def test_a_scale_stated_ten_times_too_small_ends_no_calibration() -> None:
    """Contacts are then said to be smaller than the cells in which the light's law is held against them."""
    rng = np.random.default_rng(2)
    reference, shots = make_reference([flat(rng) for _ in range(3)]), ball_pictures(8, rng)
    small = replace(SENSOR, mm_per_px=(SENSOR.mm_per_px[0] / 10, SENSOR.mm_per_px[1] / 10))
    fit = PHOTOMETRIC["polynomial"]
    calibration = calibrate_from_balls(reference, shots, mm_per_px=small.mm_per_px, fit=fit)
    light = measured_light(calibration.method, shots, balls=calibration.balls, free=(), mm_per_px=small.mm_per_px)
    assert light is not None
    assert np.isfinite(light.limit)


def test_a_stream_and_the_command_line_refuse_it_unless_told_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    reader = on_wrong_circles()
    reader = reader.varied(warnings=("two lamps?", *reader.warnings))
    with pytest.raises(InputError, match="even_so=True"):
        Stream(reader)
    Stream(reader, even_so=True)

    def built(recording: Recording, method: object = None, *, progress: object = None) -> Reconstructor:
        return reader

    monkeypatch.setattr("tactilevision.cli.source.build_reconstructor", built)
    recording = read_recording(SAMPLE)
    with pytest.raises(InputError, match=r"^reference/ball: .*--even-so"):
        source.Choice(even_so=False).light(recording)
    assert capsys.readouterr().err.count("warning: two lamps?") == 1, "why it fails is told with it"
    (tmp_path / "old.npz").touch()
    with pytest.raises(InputError, match=f"^{tmp_path}/old.npz: .*--even-so"):  # what was named, not this folder
        source.Choice(method=f"{tmp_path}/old.npz", even_so=False).light(recording)
    assert source.Choice().light(recording) is reader
