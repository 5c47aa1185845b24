"""What a recording's light may suffer after its reference pictures: off it changes nothing, on it bends slopes."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.lights import SOUND, SlopeResponse
from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.simulation import simulate


def test_sound_light_shows_the_slopes_themselves() -> None:
    slopes = (np.full((2, 3), 0.4, np.float32), np.full((2, 3), -0.3, np.float32))
    assert SOUND.shown(slopes, 7.0) is slopes


def test_gain_drift_and_ceiling_act_on_the_size_of_a_slope() -> None:
    p, q = SlopeResponse(gain=-0.2, drift=0.1, steepest=0.5, end_s=50.0).shown(
        (np.full((1, 1), 0.4, np.float32), np.full((1, 1), -0.3, np.float32)), 25.0
    )
    size = 0.5 * np.tanh(0.85 * 0.5 / 0.5)
    assert (float(p[0, 0]), float(q[0, 0])) == pytest.approx((0.8 * size, -0.6 * size), rel=1e-6)


def test_only_the_recording_suffers_and_the_truth_says_it(tmp_path: Path) -> None:
    """The reference pictures are from before; frames of presses differ."""
    options = SimulationOptions(
        camera=CameraOptions(width_px=96, height_px=72, mm_per_px=(0.28, 0.28)),
        presses=1,
        faults=(),
        flats=1,
        balls=1,
        torn_frame=False,
    )
    options = replace(
        options,
        indenters=replace(options.indenters, heights_mm=(0.3,)),
        rig=replace(options.rig, frames_per_press=12),
    )
    sound = simulate(tmp_path / "sound", seed=1, options=options)
    worn = simulate(tmp_path / "worn", seed=1, options=replace(options, slope_response=SlopeResponse(gain=-0.3)))
    names = sorted(path.name for path in (sound / "frames").iterdir())
    same = [(sound / "frames" / n).read_bytes() == (worn / "frames" / n).read_bytes() for n in names]
    assert same[0], "the free gel has no slopes to lose"
    assert not all(same)
    for still in ("reference/flat/00.png", "reference/ball/00.png"):
        assert (sound / still).read_bytes() == (worn / still).read_bytes()
    hidden = tomllib.loads((worn / "truth.toml").read_text(encoding="utf-8"))["hidden"]
    assert hidden == {"photometric_gain": {"amount": -0.3, "unit": "1", "catalogued": True}}
    assert "hidden" not in tomllib.loads((sound / "truth.toml").read_text(encoding="utf-8"))
