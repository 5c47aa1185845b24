"""A wrong ball radius shows on the faces that a bevel certifies: depth goes with 1/R, certificates do not."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from shared_scenes import sample_reconstructor

from tactilevision.heightmap.build import build_reconstructor
from tactilevision.press.certificate import Certificate
from tactilevision.press.certification import certify
from tactilevision.press.certified_faces import scale_warning
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "gelslim3"
DEPTHS_MM = (0.14, 0.14, 0.27, 0.28, 0.36, 0.45, 0.54)


def faces(scale: float) -> list[tuple[float, float]]:
    """Seen within 3 %, and the deepest an eighth too low, as walls leave them."""
    rng = np.random.default_rng(2)
    return [
        (scale * rng.normal(1.0, 0.03) * (depth if depth < 0.5 else 0.88 * depth), depth) for depth in DEPTHS_MM
    ]


def test_faces_as_certified_raise_no_doubt() -> None:
    assert scale_warning(faces(1.0), [4.0]) == ""
    assert scale_warning(faces(0.97), [4.0]) == ""
    assert scale_warning(faces(0.9)[:2], [4.0]) == "", "two faces are too few"
    assert scale_warning([(0.4, 0.5), (0.5, 0.6), (0.45, 0.55)], [4.0]) == "", "walls hide the depth of these"


def test_faces_off_together_name_the_radius_that_would_explain_them() -> None:
    said = scale_warning(faces(1 / 1.1), [4.4])
    assert "-9 % off" in said or "-10 % off" in said or "-8 % off" in said
    assert "stated as 4.4 mm really 3.9" in said or "stated as 4.4 mm really 4.0" in said
    assert "balls of this sensor would mend it" in scale_warning(faces(1.4), [])


def test_faces_that_scatter_as_much_say_nothing() -> None:
    assert scale_warning([(0.12, 0.14), (0.2, 0.28), (0.33, 0.29), (0.3, 0.36)], [4.0]) == ""


@lru_cache
def certified(factor: float) -> Certificate:
    sample = read_recording(SAMPLE)
    balls = [dataclasses.replace(ball, ball_radius_mm=factor * ball.ball_radius_mm) for ball in sample.balls]
    stated = dataclasses.replace(sample, balls=tuple(balls), presses=sample.presses[::2])
    return certify(stated, sample_reconstructor() if factor == 1.0 else build_reconstructor(stated))


@pytest.mark.parametrize(("factor", "off"), [pytest.param(1.0, 0, marks=pytest.mark.slow), (1.1, -10)])
@pytest.mark.slow
def test_a_ball_stated_too_large_is_told_by_the_sample_s_presses(factor: float, off: int) -> None:
    """Certified depths are the bevel's: they stay within half a percent."""
    said = [line for line in certified(factor).warnings if "gentle faces" in line]
    assert bool(said) == bool(off)
    if off:
        assert "stated as 2.2, 4.4 mm really 1.9" in said[0] or "stated as 2.2, 4.4 mm really 2.0" in said[0]
    pairs = zip(certified(factor).points, certified(1.0).points, strict=True)
    assert all(one.depth_mm == pytest.approx(other.depth_mm, rel=0.005) for one, other in pairs if other.accepted)
