"""Marks on the gel: found where there is a pattern, filled from around, and no slope made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lamp_room import MM_PER_PX, SHAPE, ball, dots, flat, picture, places, presses, with_dots

from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.markers import fill, fill_marks, find_marks, marked
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_method, save_method
from tactilevision.sensors import get_sensor, may_have_marks

SCALE = (MM_PER_PX, MM_PER_PX)


def method(rng: np.random.Generator, *, may_have_marks: bool) -> CalibratedMethod:
    reference = make_reference([with_dots(flat(rng)) for _ in range(3)], may_have_marks=may_have_marks)
    shots = [
        BallPicture(with_dots(picture(*ball(centre, contact, 4.0)[1:], rng)), 4.0)
        for centre, contact in presses(8, rng)
    ]
    return calibrate_from_balls(reference, shots, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"]).method


def test_a_pattern_is_found_and_only_a_pattern() -> None:
    rng = np.random.default_rng(0)
    found = find_marks(with_dots(flat(rng)))
    assert found is not None
    dark = dots() < 0.7
    assert found.mask[dark].mean() > 0.98
    assert found.mask[dots() > 0.99].mean() < 0.1
    assert find_marks(flat(rng)) is None
    dirt = flat(rng)
    for row, column in rng.integers((3, 3), (SHAPE[0] - 3, SHAPE[1] - 3), (150, 2)):
        dirt[row - 2 : row + 2, column - 2 : column + 2] //= 3
    assert find_marks(dirt) is None, "dirt strewn at random is no pattern"
    noise = np.random.default_rng(31)
    for _ in range(20):
        still = np.mean([picture(np.zeros(SHAPE), np.zeros(SHAPE), noise) for _ in range(3)], axis=0)
        assert find_marks(np.rint(still).astype(np.uint8)) is None, "nor is what rounding leaves of noise"


def test_marks_are_found_where_the_gel_has_carried_them() -> None:
    rng = np.random.default_rng(0)
    marks = find_marks(with_dots(flat(rng)))
    assert marks is not None
    moved = marked(with_dots(flat(rng), (5.0, 3.0)), marks)
    assert moved[dots((5.0, 3.0)) < 0.7].mean() > 0.98


def test_a_smooth_field_is_filled_smoothly() -> None:
    x, y = places()
    field = np.stack([0.1 * x - 0.2 * y, 0.01 * x * y]).astype(np.float32)
    mask = (dots() < 0.95).astype(np.uint8)
    holed = np.where(mask > 0, np.float32(9.0), field)
    fill(holed, mask)
    assert np.array_equal(holed[:, mask == 0], field[:, mask == 0])
    inner = np.s_[:, 10:-10, 10:-10]
    assert np.abs(holed - field)[inner].max() < 0.02 * np.ptp(field)


def test_curved_slopes_go_on_through_marks() -> None:
    """A quadratic comes back where a mean flattens it, and a hole too wide for a window keeps the mean."""
    x, y = places()
    field = np.stack([0.3 * x - 0.2 * y + 0.05 * x * y - 0.02 * x**2, 0.1 * y**2]).astype(np.float32)
    mask = (dots() < 0.95).astype(np.uint8)
    holed, mean = (np.where(mask > 0, np.float32(9.0), field) for _ in range(2))
    fill_marks(holed, mask)
    fill(mean, mask)
    assert np.array_equal(holed[:, mask == 0], field[:, mask == 0])
    assert np.abs(holed - field).max() < 0.002 * np.ptp(field)
    assert np.abs(mean - field).max() > 10 * np.abs(holed - field).max()
    mask[50:120, 60:130] = 1
    wide, mean = (np.where(mask > 0, np.float32(9.0), field) for _ in range(2))
    fill_marks(wide, mask)
    fill(mean, mask)
    assert np.array_equal(wide[:, 70:100, 80:110], mean[:, 70:100, 80:110])
    nothing = field.copy()
    fill_marks(nothing, np.zeros_like(mask))
    assert np.array_equal(nothing, field)


def test_slopes_between_marks_carry_over_them() -> None:
    rng = np.random.default_rng(2)
    _, p, q = ball((0.8, -0.5), 1.9, 4.0)
    frame = with_dots(picture(p, q, rng), (1.5, 1.0))
    inside = np.hypot(p, q) > 0.15
    errors = []
    for filled in (True, False):
        slopes = method(np.random.default_rng(1), may_have_marks=filled).slopes(frame)
        off = np.hypot(slopes.dz_dx - p, slopes.dz_dy - q)[inside]
        errors.append(float(np.sqrt(np.mean(off**2))))
    assert errors[0] < 0.06
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.slow
def test_what_marks_were_filled_with_teaches_no_slope() -> None:
    """Filled colours lag behind the slope under small balls: a law made of them reads larger ones too steep."""
    rng = np.random.default_rng(4)
    reference = make_reference([with_dots(flat(rng)) for _ in range(3)])
    small = [
        BallPicture(with_dots(picture(*ball(centre, 0.6 * contact, 2.0)[1:], rng)), 2.0)
        for centre, contact in presses(14, rng)
    ]
    made = calibrate_from_balls(reference, small, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"]).method
    gains = []
    for centre in ((0.0, 0.0), (2.0, -1.0), (-2.0, 1.0)):
        _, p, q = ball(centre, 2.4, 7.0)
        found = made.slopes(with_dots(picture(p, q, rng)))
        bare = (np.hypot(p, q) > 0.1) & (dots() > 0.99)
        gains.append(np.sum((found.dz_dx * p + found.dz_dy * q)[bare]) / np.sum((p**2 + q**2)[bare]))
    assert np.mean(gains) == pytest.approx(1.0, abs=0.02)


def test_a_reference_that_is_followed_never_takes_marks_in() -> None:
    rng = np.random.default_rng(1)
    change = ColourChange(make_reference([with_dots(flat(rng))]))
    before = change.maps.mean.copy()
    for _ in range(20):
        change.follow(with_dots(flat(rng), (5.0, 3.0)), 0.2)
    taken = (before - change.maps.mean) / (before + 20.0)
    assert np.percentile(taken, 99) < 0.1  # a mark would take half


@pytest.mark.slow
def test_marks_survive_the_disk(tmp_path: Path) -> None:
    made = method(np.random.default_rng(1), may_have_marks=True)
    again = load_method(save_method(made, tmp_path / "finger"))
    frame = with_dots(flat(np.random.default_rng(5)), (1.0, 0.0))
    assert np.array_equal(made.slopes(frame).dz_dx, again.slopes(frame).dz_dx)


@pytest.mark.parametrize(
    ("kind", "looked_for"), [("gelslim3", False), ("gelslim3_markers", True), ("digit", False)]
)
def test_marks_are_looked_for_where_there_may_be_some(kind: str, looked_for: bool) -> None:
    assert may_have_marks(get_sensor(kind)) is looked_for
    assert may_have_marks(get_sensor("custom", width_px=9, height_px=9, mm_per_px=0.1))
