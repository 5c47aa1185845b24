"""Colours that the light's law does not explain are flagged by place; depth that rests on them is uncertain."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from lamp_room import SENSOR, SHAPE, ball, ball_pictures, in_px, picture, room_calibration
from scipy.special import j0, j1
from shared_scenes import shared

from tactilevision.heightmap.build import tuned
from tactilevision.heightmap.inconsistent_light import MIN_AREA_MM2, RISE_MM, LightCheck, rises_too_much
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.mechanics.layer import layer_compliance
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.methods.polynomial import fit_polynomial
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_method, save_method
from tactilevision.records.maps import INCONSISTENT, HeightMap
from tactilevision.records.measured import Bytes
from tactilevision.sensors import get_sensor
from tactilevision.synthetic.gel import BallPress

REAL = Path(__file__).parents[2] / ".." / "shared" / "real"
DARK = (4.0, -2.0)  # mm, where the light is shaded
SHADED = 0.2  # of the light that is missing there; more is taken for steep gel, or for drift


@lru_cache
@shared
def reader() -> Reconstructor:
    return tuned(SENSOR, room_calibration(14), pictures=ball_pictures(14, np.random.default_rng(1)), free=[])


def shaded(rgb: Bytes, share: float) -> Bytes:
    """The picture with all lamps dimmed round DARK, as no slope dims them."""
    x, y = in_px(DARK)
    rows, columns = np.indices(SHAPE)
    away = np.hypot(columns - x, rows - y) * SENSOR.mm_per_px[0]
    gain = 1.0 - share * np.exp(-np.square(away / 2.0))[..., None]
    return np.asarray(np.rint(rgb * gain), np.uint8)


def pressed(seed: int) -> Bytes:
    _, p, q = ball((-4.0, 2.0), 1.4, 4.0)
    return picture(p, q, np.random.default_rng(seed))


def test_presses_that_the_light_explains_are_not_flagged() -> None:
    for seed in range(20, 26):
        height = reader().rectified_map(pressed(seed))
        assert height.inconsistent is not None
        assert height.inconsistent.mean() < 0.01
        assert INCONSISTENT not in height.flags


def test_a_shaded_place_is_flagged_there_and_its_depth_uncertain() -> None:
    plain, false = (reader().rectified_map(rgb) for rgb in (pressed(30), shaded(pressed(30), SHADED)))
    assert INCONSISTENT in false.flags
    assert false.inconsistent is not None
    assert plain.std_mm is not None
    assert false.std_mm is not None
    rows, columns = np.nonzero(false.inconsistent)
    cell = SHAPE[1] / false.inconsistent.shape[1]
    away = np.hypot((columns + 0.5) * cell - in_px(DARK)[0], (rows + 0.5) * cell - in_px(DARK)[1])
    assert np.median(away) * SENSOR.mm_per_px[0] < 4.0
    off = np.abs(false.depth_mm - plain.depth_mm)
    where = off > 0.5 * off.max()
    assert np.median(false.std_mm[where]) > 1.5 * np.median(plain.std_mm[where])


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_darker_shade_leaves_a_map_and_no_error(share: float) -> None:
    """It once passed for a wall whose law had no place left: an IndexError."""
    height = reader().rectified_map(shaded(pressed(30), share))
    assert np.isfinite(height.depth_mm).all()


def test_gel_that_rises_too_much_as_none_can_is_flagged_whatever_its_colours() -> None:
    """A hill of .35 mm beside a ball, drawn in the light that the balls showed: no colour contradicts it."""
    _, p, q = ball((-4.0, 2.0), 1.4, 4.0)
    rows, columns = np.indices(SHAPE)
    x, y = ((at - middle) * SENSOR.mm_per_px[0] for at, middle in zip((columns, rows), in_px(DARK), strict=True))
    hill = 0.35 * np.exp(-0.5 * (x**2 + y**2) / 1.5**2) / 1.5**2
    height = reader().rectified_map(picture(p + x * hill, q + y * hill, np.random.default_rng(50)))
    assert height.depth_mm.min() < -0.25
    assert INCONSISTENT in height.flags


@pytest.mark.parametrize("contact_mm", [1.0, 1.9, 2.5])
def test_no_gel_of_layer_theory_rises_too_much(contact_mm: float) -> None:
    """The thinnest gel and nearly incompressible: up to .16 of the depth."""
    _, depth = BallPress(4.0, contact_mm, 1.5, 0.4999, (0.0, 0.0)).section()
    assert not rises_too_much(np.asarray(2.0 * depth[None], np.float32))
    assert rises_too_much(np.asarray(np.append(depth, -0.35 * depth.max() - RISE_MM)[None], np.float32))


def test_gel_within_a_ring_may_stand_out() -> None:
    """Even pressure on a ring of 2 to 6 mm, on 3 mm of gel that is nearly incompressible: .69 of the depth."""
    k, across = np.linspace(1e-3, 30.0, 6001), np.linspace(-12.0, 12.0, 61)
    pressure = (6.0 * j1(k * 6.0) - 2.0 * j1(k * 2.0)) * np.exp(-((k * 3.0 / 80) ** 2))  # times k
    r = np.linspace(0.0, 17.0, 171)
    section = np.trapezoid(layer_compliance(k * 3.0, 0.4999).normal * pressure * j0(r[:, None] * k), k)
    depth = np.interp(np.hypot(across, across[:, None]), r, section / section.max()).astype(np.float32)
    assert depth.min() < -0.6
    assert not rises_too_much(depth)
    depth[:5, :5] = -0.6
    assert rises_too_much(depth)


def test_single_noisy_pixels_do_not_count() -> None:
    rng, rgb = np.random.default_rng(3), pressed(40)
    specks = rng.random(SHAPE) < 0.002
    rgb[specks] = rng.integers(30, 220, (int(specks.sum()), 3))
    assert INCONSISTENT not in reader().rectified_map(rgb).flags


def test_the_law_of_light_travels_with_the_method(tmp_path: Path) -> None:
    method = reader().referenced
    assert method is not None
    law, kept = method.light_law, load_method(save_method(method, tmp_path / "method")).light_law
    assert law is not None
    assert kept is not None
    assert (kept.share, kept.limit) == (law.share, law.limit)
    assert np.allclose(kept.terms, law.terms)
    assert np.allclose(kept.noise, law.noise)


def test_without_a_law_of_light_slopes_of_no_surface_are_flagged() -> None:
    method = reader().referenced
    assert method is not None
    check = LightCheck(dataclasses.replace(method, light_law=None), SENSOR.mm_per_px)
    frame = method.change.take(pressed(30))
    assert check(frame).area_mm2 < MIN_AREA_MM2
    slopes = check.read(frame)[1]
    turned = np.zeros_like(slopes)
    y, x = (np.linspace(-1.0, 1.0, n) for n in slopes.shape[1:])
    turned[0], turned[1] = -0.3 * y[:, None], 0.3 * x[None]
    score, _ = check._curl(turned)
    assert np.median(score) > 1.0
    assert np.median(check._curl(np.full_like(slopes, 0.2))[0]) < 0.1, "a plane is a surface"


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="the real frames are not at hand")
def test_real_hollows_are_flagged_and_good_presses_are_not() -> None:
    """54 balls: those with gel said to stand out by .25 mm and more in a dark corner, and those without any."""
    folder = REAL / "gelslim_heightmap" / "dots1"
    with np.load(folder.parent / "abe_corr.npz", allow_pickle=False) as table:
        x, y = table["x"], table["y"]

    def read(path: Path) -> Bytes:
        raw = cv2.imread(str(path))
        assert raw is not None
        return np.ascontiguousarray(raw[x, y, ::-1])

    shots = [BallPicture(read(path), 3.8, name=path.name) for path in sorted(folder.glob("sample_*.jpg"))]
    reference = make_reference([read(folder / "ref.jpg")])
    found = calibrate_from_balls(reference, shots, mm_per_px=(0.0634, 0.0634), fit=fit_polynomial)
    sensor = get_sensor("custom", width_px=427, height_px=320, mm_per_px=0.0634)
    made = tuned(sensor, found, pictures=shots, free=[])
    heights = [made.rectified_map(shot.rgb) for shot in shots]

    def share(some: list[HeightMap]) -> float:
        return float(np.mean([INCONSISTENT in height.flags for height in some]))

    assert share([height for height in heights if height.depth_mm.min() > -0.12]) < 0.1
    assert share([height for height in heights if height.depth_mm.min() < -0.25]) >= 0.3
