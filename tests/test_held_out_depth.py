"""What a card says of depth: exact for an exact ball, and silent on what lies beside it."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.depth_error import gain_std
from tactilevision.held_out_depth import bands, dent_mm
from tactilevision.photometric.ball import Ball


@pytest.mark.parametrize("scale", [(0.06, 0.06), (0.05, 0.07)])
def test_the_dent_of_a_ball_is_its_own(scale: tuple[float, float]) -> None:
    ball = Ball((80.3, 61.8), 1.5 / scale[0], 3.0)
    y, x = np.indices((130, 170), dtype=np.float64)
    r = np.hypot((x - 80.3) * scale[0], (y - 61.8) * scale[1])
    depth = np.sqrt(np.maximum(9.0 - r**2, 0.0)) + 0.7
    depth[r > 1.6] = -5.0
    found, true = dent_mm(depth, ball, scale)
    assert found == pytest.approx(true, rel=1e-12)
    assert true == pytest.approx(3.0 - np.sqrt(9.0 - 1.35**2), rel=0.03)
    assert dent_mm(0.9 * depth, ball, scale)[0] == pytest.approx(0.9 * true, rel=1e-12)


def test_bands_hold_their_errors_against_the_stated_one() -> None:
    balls = [{"dent_mm": 0.1 * n, "found_mm": 0.1 * n * 1.02, "contact_radius_px": 40.0 - n} for n in range(1, 10)]
    low, middle, high = bands({"held_out_balls": balls}, "dent_mm", 0.04)
    assert (low.count, middle.count, high.count) == (3, 3, 3)
    assert (low.low, high.high) == pytest.approx((0.1, 0.9))
    assert middle.off_mm == pytest.approx(0.5 * middle.stated_mm)
    assert high.within == 1.0
    assert [band.within for band in bands({"held_out_balls": balls}, "contact_radius_px", 0.01)] == [0.0] * 3
    assert bands({}, "dent_mm", 0.04) == []


def test_the_stated_scale_lies_between_balls_seen_and_unseen() -> None:
    assert 0.02 < gain_std({"held_out_gain_std": 0.06, "seen_gain_std": 0.02}, 0.5) < 0.06
    assert gain_std({}, 0.5) == 0.5
