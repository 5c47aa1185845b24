"""Whole frames whose light lost slopes since its reference pictures: what it lost is named, with its size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.inputs.gather import observe_points
from calibration.inputs.observations import Measured
from calibration.tasks.diagnose import diagnose
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.press.certification import certify
from tactilevision.recording.read import read_recording
from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.lights import SOUND, SlopeResponse
from tactilevision.synthetic.options import GelOptions, IndenterOptions, RigOptions, SimulationOptions
from tactilevision.synthetic.rig import Protocol
from tactilevision.synthetic.simulation import simulate


def options(slope_response: SlopeResponse) -> SimulationOptions:
    """Twelve presses of four depths before a small camera."""
    return SimulationOptions(
        gel=GelOptions(youngs_modulus_MPa=0.21, poisson_ratio=0.479, friction=0.25, prior=0.48, prior_std=0.005),
        camera=CameraOptions(width_px=240, height_px=180, mm_per_px=(0.1125, 0.1125), distortion_px=0.0),
        slope_response=slope_response,
        indenters=IndenterOptions(heights_mm=(0.2, 0.3, 0.4, 0.5)),
        rig=RigOptions(protocol=Protocol(rest_s=2.0, hold_s=0.5, free_s=0.6), frames_per_press=22),
        presses=3,
        faults=(),
        frames="jpeg",
        flats=2,
        balls=16,
        torn_frame=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "slope_response", "amount"),
    [
        ("", SOUND, 0.0),
        ("photometric_gain", SlopeResponse(gain=-0.2), -0.2),
        ("photometric_drift", SlopeResponse(drift=-0.2), -0.2),
        ("slope_saturation", SlopeResponse(steepest=0.5), 1 / 0.5),
        ("slope_saturation", SlopeResponse(steepest=0.3), 1 / 0.3),
    ],
    ids=["sound", "gain", "drift", "ceiling", "low ceiling"],
)
def test_what_the_light_lost_is_named_from_whole_frames(
    key: str, slope_response: SlopeResponse, amount: float, tmp_path: Path
) -> None:
    recording = read_recording(simulate(tmp_path / "worn", seed=11, options=options(slope_response)))
    points = certify(recording, build_reconstructor(recording, "polynomial")).points
    found = diagnose(observe_points(Measured(recording, points)), np.random.default_rng(0))
    assert [effect.key for effect in found.effects] == [key] * bool(key)
    assert found.verdict == ("IDENTIFIED" if key else "ADEQUATE")
    if key:
        low, high = found.effects[0].parameters[0][1].interval95 or (0.0, 0.0)
        assert low < amount < high
