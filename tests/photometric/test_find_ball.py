"""Where a ball lies in a picture of colour change, also where one of its sides is far brighter than the others."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.photometric.ball.detection import ball_slopes, find_ball

SHAPE, SCALE, RADIUS_MM = (160, 220), (0.06, 0.06), 4.0


@pytest.mark.parametrize(("loud", "off_px"), [(1.0, 0.5), (4.0, 4.5), (12.0, 4.5)])
def test_a_ball_is_found_whole_where_one_colour_is_loud(loud: float, off_px: float) -> None:
    """A lamp near the place, over gel that is dark without it: a side of the ball shines many times as much."""
    rng, centre, contact_px = np.random.default_rng(0), (120.3, 71.8), 30.0
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    p, q = ball_slopes(
        (x - centre[0]) * SCALE[0],
        (y - centre[1]) * SCALE[1],
        contact_mm=contact_px * SCALE[0],
        radius_mm=RADIUS_MM,
    )
    towards = 0.6 * p + 0.8 * q
    change = np.stack([loud * towards * np.where(towards > 0, 1.0, 0.2), 0.4 * p - 0.2 * q, -0.5 * q], axis=-1)
    seen = (change + 0.01 * rng.standard_normal(change.shape)).astype(np.float32)
    found = find_ball(seen, SCALE, radius_mm=RADIUS_MM)
    assert np.hypot(*np.subtract(found.centre_px, centre)) < off_px, "on its bright side it is 15"
    assert found.contact_radius_px == pytest.approx(contact_px, rel=0.15), "not the 20 of that side"
