"""Where one colour is overexposed the other two tell the slope; where none is, nothing changes."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from lamp_room import BALL_MM, SENSOR, SHAPE, ball, ball_pictures, flat, in_px, picture
from shared_scenes import shared

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.ball_samples import radii_from
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.polynomial import fit_polynomial
from tactilevision.photometric.reference import SATURATED, make_reference
from tactilevision.photometric.storage import load_method, save_method
from tactilevision.records.measured import Bools, Bytes

COLOUR = 2
SHARE = 0.2  # of the untouched picture that is overexposed
CONTACT_MM = 1.6


def overexposed(rgb: Bytes, gain: float) -> Bytes:
    grey = rgb.astype(float)
    grey[..., COLOUR] = np.minimum(grey[..., COLOUR] * gain, 255.0)
    return np.asarray(np.rint(grey), np.uint8)


def gain() -> float:
    return float(255.0 / np.quantile(flat(np.random.default_rng(1))[..., COLOUR], 1.0 - SHARE))


@lru_cache
@shared
def calibrated(over: bool) -> Calibration:
    rng = np.random.default_rng(1)
    factor = gain() if over else 1.0
    reference = make_reference([overexposed(flat(rng), factor) for _ in range(3)])
    shots = [dataclasses.replace(shot, rgb=overexposed(shot.rgb, factor)) for shot in ball_pictures(10, rng)]
    return calibrate_from_balls(reference, shots, mm_per_px=SENSOR.mm_per_px, fit=fit_polynomial)


def bright_place() -> tuple[float, float]:
    """In mm, the middle of what is overexposed."""
    rows, columns = np.nonzero(calibrated(True).method.reference.rgb[..., COLOUR] >= SATURATED)
    zero = np.array(in_px((0.0, 0.0)))
    x, y = (np.array([np.median(columns), np.median(rows)]) - zero) * SENSOR.mm_per_px
    return float(np.clip(x, -6.5, 6.5)), float(np.clip(y, -4.0, 4.0))


def near(place: tuple[float, float]) -> Bools:
    contact = Ball(in_px(place), CONTACT_MM / SENSOR.mm_per_px[0], BALL_MM)
    return np.asarray(radii_from(contact, SHAPE, mm_per_px=SENSOR.mm_per_px) < 1.0)


def test_a_ball_under_an_overexposed_colour_is_as_deep_as_elsewhere() -> None:
    place = bright_place()
    depth, p, q = ball(place, CONTACT_MM, BALL_MM)
    rgb = picture(p, q, np.random.default_rng(5))
    reader = Reconstructor(SENSOR, calibrated(True).method)
    height = reader.rectified_map(overexposed(rgb, gain()))
    under = near(place)
    assert (calibrated(True).method.reference.rgb[..., COLOUR][under] >= SATURATED).mean() > 0.5
    assert height.valid[under].mean() > 0.98, "it was thrown away"
    assert height.depth_mm[under].max() == pytest.approx(depth.max(), rel=0.15)
    whole = Reconstructor(SENSOR, calibrated(False).method).rectified_map(rgb)
    assert height.std_mm is not None
    assert whole.std_mm is not None
    assert np.median(height.std_mm[under]) > 1.05 * np.median(whole.std_mm[under]), "two colours tell less"


def test_balls_where_a_colour_is_overexposed_are_found_and_used() -> None:
    found, whole = calibrated(True), calibrated(False)
    assert all(one is not None for one in found.balls)
    off = [
        np.hypot(*np.subtract(one.centre_px, other.centre_px))
        for one, other in zip(found.balls, whole.balls, strict=True)
        if one is not None and other is not None
    ]
    assert max(off) < 1.5
    assert found.direction_error_deg < whole.direction_error_deg + 1.0


def test_frames_that_tell_all_colours_are_read_as_before() -> None:
    method = calibrated(False).method
    plain = dataclasses.replace(method, two_colours=None)
    rgb = picture(*ball((1.0, -0.5), CONTACT_MM, BALL_MM)[1:], np.random.default_rng(6))
    assert rgb.max() < SATURATED
    one, other = method.read(rgb), plain.read(rgb)
    assert one.lost_share is None
    np.testing.assert_array_equal(one.slopes.dz_dx, other.slopes.dz_dx)
    np.testing.assert_array_equal(one.slopes.valid, other.slopes.valid)


def test_a_glint_in_all_colours_is_not_valid_and_makes_no_hill() -> None:
    rgb = flat(np.random.default_rng(7))
    rgb[60:72, 100:112] = 255
    height = Reconstructor(SENSOR, calibrated(False).method).rectified_map(rgb)
    assert not height.valid[61:71, 101:111].any()
    assert np.abs(height.depth_mm).max() < 0.03


def test_one_colour_that_no_ball_tells_leaves_a_calibration_by_two() -> None:
    rng = np.random.default_rng(3)
    factor = 6.0  # all of one colour is white but for a corner

    def washed(rgb: Bytes) -> Bytes:
        out = overexposed(rgb, factor)
        out[:, : SHAPE[1] // 2, COLOUR] = 40
        return out

    reference = make_reference([washed(flat(rng))])
    shots = []
    for k in range(6):
        at = (2.5 + 0.8 * (k % 3), -2.0 + 3.0 * (k // 3))
        shots.append(BallPicture(washed(picture(*ball(at, 1.4, BALL_MM)[1:], rng)), BALL_MM))
    found = calibrate_from_balls(reference, shots, mm_per_px=SENSOR.mm_per_px, fit=fit_polynomial)
    assert found.direction_error_deg < 15.0


def test_the_laws_of_two_colours_travel_with_the_method(tmp_path: Path) -> None:
    method = calibrated(True).method
    again: CalibratedMethod = load_method(save_method(method, tmp_path / "method"))
    rgb = overexposed(picture(*ball(bright_place(), CONTACT_MM, BALL_MM)[1:], np.random.default_rng(8)), gain())
    one, other = method.slopes(rgb), again.slopes(rgb)
    np.testing.assert_allclose(one.dz_dx, other.dz_dx, atol=1e-5)
    np.testing.assert_array_equal(one.valid, other.valid)
