"""Balls find themselves, slopes come back, and what cannot be used is named."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from lamp_room import MM_PER_PX, SHAPE, ball, flat, in_px, picture, presses, room_calibration
from shared_scenes import shared

from tactilevision.errors import InputError
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.network_training import NetworkFitter
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_method, save_method

SCALE = (MM_PER_PX, MM_PER_PX)
FITS = {**PHOTOMETRIC, "network": NetworkFitter(steps=60)}  # what it can do when trained on: test_network.py
RADIUS_MM = 4.0


def pictures(count: int, seed: int = 1) -> list[BallPicture]:
    rng = np.random.default_rng(seed)
    return [
        BallPicture(picture(*ball(centre, contact, RADIUS_MM)[1:], rng), RADIUS_MM)
        for centre, contact in presses(count, rng)
    ]


@lru_cache
@shared
def calibrated(name: str) -> Calibration:
    if name == "polynomial":
        return room_calibration(12)  # of the same pictures of balls
    rng = np.random.default_rng(0)
    reference = make_reference([flat(rng) for _ in range(3)])
    return calibrate_from_balls(reference, pictures(8), mm_per_px=SCALE, fit=FITS[name])


def test_balls_are_found_to_a_fraction_of_a_pixel() -> None:
    true = presses(12, np.random.default_rng(1))
    # presses and noise share a generator: draw the places as `pictures` does
    for (centre, contact), found in zip(true, calibrated("polynomial").balls, strict=True):
        assert found is not None
        assert np.hypot(*np.subtract(found.centre_px, in_px(centre))) < 0.6
        assert found.contact_radius_px * MM_PER_PX == pytest.approx(contact, rel=0.12)


@pytest.mark.parametrize(
    ("name", "degrees"), [("polynomial", 6.0), pytest.param("lookup", 9.0, marks=pytest.mark.slow)]
)
def test_slopes_of_balls_never_seen(name: str, degrees: float) -> None:
    calibration = calibrated(name)
    assert calibration.direction_error_deg < degrees
    rng = np.random.default_rng(9)
    _, p, q = ball((1.5, -1.0), 1.7, RADIUS_MM)
    slopes = calibration.method.slopes(picture(p, q, rng))
    inside = np.hypot(p, q) > 0.1
    gain = np.sum(slopes.dz_dx * p + slopes.dz_dy * q, where=inside) / np.sum(p**2 + q**2, where=inside)
    assert gain == pytest.approx(1.0, abs=0.05)
    assert slopes.std is not None
    assert slopes.valid is not None
    assert slopes.valid.mean() > 0.95


@pytest.mark.parametrize(
    "name",
    [
        "polynomial",
        *(pytest.param(name, marks=pytest.mark.slow) for name in sorted({*PHOTOMETRIC} - {"polynomial"})),
    ],
)
def test_no_change_of_colour_is_no_slope(name: str) -> None:
    method = calibrated(name).method
    slopes = method.slopes(np.rint(method.reference.rgb).astype(np.uint8))
    assert abs(float(np.median(slopes.dz_dx))) < 0.01
    assert abs(float(np.median(slopes.dz_dy))) < 0.01


def test_the_stated_noise_is_the_noise() -> None:
    method = calibrated("polynomial").method
    rng = np.random.default_rng(3)
    maps = np.stack([method.slopes(flat(rng)).dz_dx for _ in range(12)])
    stated = method.slopes(flat(rng)).std
    assert stated is not None
    assert np.median(maps.std(axis=0)) == pytest.approx(float(np.median(stated)), rel=0.5)


def test_light_that_fades_does_not_become_a_slope() -> None:
    method = calibrated("polynomial").method
    rng = np.random.default_rng(4)
    _, p, q = ball((0.0, 0.0), 1.6, RADIUS_MM)
    bright, dim = (method.slopes(picture(p, q, rng, gain=gain)) for gain in (1.0, 0.96))
    assert np.mean(bright.dz_dx - dim.dz_dx) == pytest.approx(0.0, abs=0.004)
    away = np.hypot(p, q) < 0.001
    assert abs(float(np.mean(dim.dz_dx[away]))) < 0.006


def test_a_known_centre_is_taken_as_a_start() -> None:
    rng = np.random.default_rng(0)
    reference = make_reference([flat(rng)])
    stated = [
        BallPicture(shot.rgb, RADIUS_MM, in_px(centre), contact / MM_PER_PX)
        for shot, (centre, contact) in zip(pictures(6), presses(6, np.random.default_rng(1)), strict=True)
    ]
    found = calibrate_from_balls(reference, stated, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"]).balls
    assert all(one is not None for one in found)


@pytest.mark.parametrize(
    "name", ["polynomial", *(pytest.param(one, marks=pytest.mark.slow) for one in ("auto", "lookup", "network"))]
)
def test_a_method_survives_the_disk(name: str, tmp_path: Path) -> None:
    method = calibrated(name).method
    path = save_method(method, tmp_path / "finger.npz")
    again = load_method(path)
    frame = flat(np.random.default_rng(6))
    assert np.array_equal(method.slopes(frame).dz_dx, again.slopes(frame).dz_dx)
    assert again.card.held_out_direction_error_deg == pytest.approx(calibrated(name).direction_error_deg)
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(InputError, match="does not match its card"):
        load_method(path)


def test_too_few_balls_are_refused_and_say_why() -> None:
    rng = np.random.default_rng(0)
    reference = make_reference([flat(rng)])
    empty = [BallPicture(flat(rng), RADIUS_MM, name="empty.png")]
    with pytest.raises(InputError, match=r"too few ball presses.*2 of 3.*empty\.png.*no contact"):
        calibrate_from_balls(reference, pictures(2) + empty, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"])


@pytest.mark.slow
def test_balls_in_one_corner_are_warned_of() -> None:
    rng = np.random.default_rng(0)
    reference = make_reference([flat(rng)])
    corner = [
        BallPicture(picture(*ball((-6.0 + 0.2 * k, -4.0 + 0.1 * k), 1.4, RADIUS_MM)[1:], rng), RADIUS_MM)
        for k in range(5)
    ]
    calibration = calibrate_from_balls(reference, corner, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"])
    assert any("of the picture only" in warning for warning in calibration.warnings)


def test_a_contact_in_the_only_reference_is_warned_of() -> None:
    rng = np.random.default_rng(0)
    touched = picture(*ball((-5.0, 3.0), 1.4, RADIUS_MM)[1:], rng)
    shots = [
        BallPicture(picture(*ball((4.0 - 0.5 * k, -3.0 + 0.4 * k), 1.8, RADIUS_MM)[1:], rng), RADIUS_MM)
        for k in range(6)
    ]
    found = calibrate_from_balls(make_reference([touched]), shots, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"])
    assert any("contact in the reference" in warning for warning in found.warnings)
    place = found.method.card.contact_in_reference_px
    assert place is not None
    assert np.hypot(*np.subtract(place, in_px((-5.0, 3.0)))) < 1.4 / MM_PER_PX
    assert not any("contact in the reference" in warning for warning in calibrated("polynomial").warnings)


def test_frames_that_cannot_be_read_are_named() -> None:
    method = calibrated("polynomial").method
    frame = flat(np.random.default_rng(7))
    with pytest.raises(InputError, match="does not match the reference in size"):
        method.slopes(frame[:-1])
    with pytest.raises(InputError, match="does not match the reference in size or type"):
        method.slopes(frame.astype(np.float32))
    with pytest.raises(InputError, match="black"):
        method.slopes(np.zeros_like(frame))
    with pytest.raises(InputError, match="saturated"):
        method.slopes(np.full_like(frame, 255))


def test_swapped_colours_are_noticed() -> None:
    rng = np.random.default_rng(0)
    warm = np.zeros((*SHAPE, 3), np.uint8) + np.array([180, 90, 40], np.uint8)
    warm = np.clip(warm + rng.normal(0, 1, warm.shape), 0, 255).astype(np.uint8)
    method = calibrated("polynomial").method.with_reference(make_reference([warm]))
    with pytest.raises(InputError, match="blue, green, red"):
        method.slopes(np.ascontiguousarray(warm[..., ::-1]))


def test_flats_that_cannot_be_used_are_named() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="no picture of the untouched gel"):
        make_reference([])
    with pytest.raises(InputError, match="differ in size"):
        make_reference([flat(rng), flat(rng)[:-2]])
    with pytest.raises(InputError, match="black"):
        make_reference([np.zeros((*SHAPE, 3), np.uint8)])
    with pytest.raises(InputError, match="saturated"):
        make_reference([np.full((*SHAPE, 3), 255, np.uint8)])
    touched = picture(*ball((0.0, 0.0), 1.5, RADIUS_MM)[1:], rng)
    with pytest.raises(InputError, match="contact"):
        make_reference([flat(rng), flat(rng), touched])


def test_balls_all_in_one_corner_are_told_of() -> None:
    rng = np.random.default_rng(3)
    reach = 0.25 * MM_PER_PX * np.array(SHAPE[::-1])
    places = [tuple(float(v) for v in rng.uniform(-0.8, -0.1, 2) * reach) for _ in range(6)]
    shots = [BallPicture(picture(*ball((x, y), 0.9, RADIUS_MM)[1:], rng), RADIUS_MM) for x, y in places]
    reference = make_reference([flat(rng) for _ in range(3)])
    found = calibrate_from_balls(reference, shots, mm_per_px=SCALE, fit=FITS["polynomial"])
    assert any("cover" in line for line in found.warnings)
    assert not any("cover" in line for line in calibrated("polynomial").warnings)


def test_a_ball_where_the_light_is_saturated_is_left_out() -> None:
    def glaring(rgb: np.ndarray) -> np.ndarray:
        rgb = rgb.copy()
        rgb[: SHAPE[0] // 3, : SHAPE[1] // 3] = 255
        return rgb

    rng = np.random.default_rng(0)
    reference = make_reference([glaring(flat(rng)) for _ in range(3)])
    lost = (SHAPE[1] / 7, SHAPE[0] / 7)
    shots = [BallPicture(glaring(p.rgb), RADIUS_MM) for p in pictures(8)]
    shots.append(BallPicture(shots[0].rgb, RADIUS_MM, centre_px=lost, contact_radius_px=10.0, name="lost"))
    found = calibrate_from_balls(reference, shots, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"])
    assert found.balls[-1] is None
    assert any("lost excluded" in warning for warning in found.warnings)


@pytest.mark.parametrize(("radius_mm", "contact_px"), [(0.004, None), (RADIUS_MM, 1.7)])
def test_a_ball_in_the_wrong_unit_is_named(radius_mm: float, contact_px: float | None) -> None:
    rng = np.random.default_rng(0)
    reference = make_reference([flat(rng)])
    shots = [BallPicture(shot.rgb, radius_mm, (60.0, 50.0), contact_px) for shot in pictures(4)]
    with pytest.raises(InputError, match="too small to be read"):
        calibrate_from_balls(reference, shots, mm_per_px=SCALE, fit=PHOTOMETRIC["polynomial"])
