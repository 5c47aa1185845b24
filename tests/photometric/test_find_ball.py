"""Where a ball lies in a picture of colour change, also where one of its sides is far brighter than the others."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.photometric.ball_detection import ball_slopes, find_ball
from tactilevision.synthetic.gel import BallPress

SHAPE, SCALE, RADIUS_MM = (160, 220), (0.06, 0.06), 4.0
CENTRE = (112.3, 78.8)  # px


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


def layered(share: float, contact_mm: float) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float32]], float]:
    """Colour changes of a matt layer, 3 mm thick, under a ball that is `share` of its radius wide; its radius."""
    press = BallPress(contact_mm / share, contact_mm, 3.0, 0.48, (0.0, 0.0))
    r, depth = press.section()
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    x, y = (x - CENTRE[0]) * SCALE[0], (y - CENTRE[1]) * SCALE[1]
    away = np.hypot(x, y)
    slope = np.interp(away, r, np.gradient(depth, r)) / np.maximum(away, 1e-9)
    p, q = slope * x, slope * y
    toward = np.array([[0.9, 0.1], [-0.5, 0.8], [-0.4, -0.9]])  # of the lamps, as slopes they light best
    light = (1.0 + 1.5 * (p[..., None] * toward[:, 0] + q[..., None] * toward[:, 1])) / np.sqrt(1 + p**2 + q**2)[
        ..., None
    ]
    noise = 0.01 * np.random.default_rng(4).standard_normal(light.shape)
    return np.maximum(light, 0.05).astype(np.float32) - 1.0 + noise.astype(np.float32), contact_mm / share


@pytest.mark.parametrize(("share", "contact_mm"), [(0.5, 2.0), (0.65, 1.8), (0.8, 2.2)])
def test_the_circle_of_a_deep_press_is_not_too_wide(share: float, contact_mm: float) -> None:
    change, radius_mm = layered(share, contact_mm)
    found = find_ball(change, SCALE, radius_mm=radius_mm)
    assert found.contact_radius_px == pytest.approx(contact_mm / SCALE[0], abs=1.5)
    assert np.hypot(*np.subtract(found.centre_px, CENTRE)) < 1.0


def test_a_label_holds_a_fit_where_half_of_the_ball_is_not_seen() -> None:
    change, radius_mm = layered(0.7, 2.0)
    change[:, : int(CENTRE[0]), 0] = np.nan
    change[: int(CENTRE[1]), :, 2] = np.nan
    label = CENTRE[0] + 4.0, CENTRE[1] - 3.0
    found = find_ball(change, SCALE, radius_mm=radius_mm, centre_px=label, contact_radius_px=1.15 * 2.0 / SCALE[0])
    assert found.contact_radius_px == pytest.approx(2.0 / SCALE[0], abs=2.5)
    assert np.hypot(*np.subtract(found.centre_px, CENTRE)) < 2.5


def test_a_place_of_unknown_colours_holds_no_ball() -> None:
    change, radius_mm = layered(0.7, 2.0)
    change[:, 160:] = np.nan
    with pytest.raises(InputError, match="no colour that is known changes"):
        find_ball(change, SCALE, radius_mm=radius_mm, centre_px=(200.0, 80.0), contact_radius_px=12.0)
