"""Calibrated light is restored from the cache with the same depths, and calibrated anew for other pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_scenes import SAMPLE, sample_reconstructor

from tactilevision.heightmap.kept_light import kept_light
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.rig import Sensor


def test_other_pictures_another_ball_or_another_scale_are_calibrated_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    made, frame = sample_reconstructor(), read_frame(read_recording(SAMPLE), 96)
    assert made.calibration is not None
    reference, calls = made.calibration.method.reference, []
    sensor, ball = made.sensor, BallPicture(frame.rgb, 2.5, name="one")

    def make() -> Reconstructor:
        calls.append(1)
        return made

    def kept(sensor: Sensor, ball: BallPicture) -> Reconstructor:
        return kept_light(sensor, "auto", reference, pictures=[ball], free=[frame.rgb], make=make)

    first, second = kept(sensor, ball), kept(sensor, ball)
    assert len(calls) == 1
    for restored in (first, second):
        found, true = restored.height_map(frame), made.height_map(frame)
        assert found.std_mm is not None
        assert true.std_mm is not None
        np.testing.assert_array_equal(found.depth_mm, true.depth_mm)
        np.testing.assert_array_equal(found.std_mm, true.std_mm)
        assert restored.calibration is not None
        assert restored.calibration.balls == made.calibration.balls
    wider = replace(sensor, mm_per_px=(2 * sensor.mm_per_px[0], sensor.mm_per_px[1]))
    brighter = replace(ball, rgb=np.maximum(frame.rgb, 1))
    for one in ((sensor, replace(ball, radius_mm=2.6)), (sensor, brighter), (wider, ball)):
        kept(*one)
    assert len(calls) == 4
