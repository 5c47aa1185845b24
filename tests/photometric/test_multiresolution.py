"""Calm gel in means of pixels: the same surface, every pressed pixel still read by itself."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from each import each
from lamp_room import MM_PER_PX, SHAPE, ball, flat, picture, presses
from shared_scenes import shared

from tactilevision.heightmap.build import subtract_background
from tactilevision.heightmap.poisson import integrate
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.markers import Marks
from tactilevision.photometric.method import CalibratedMethod, SlopeReading, TiledEvaluator
from tactilevision.photometric.network_training import NetworkFitter
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.photometric.reference import make_reference
from tactilevision.records.measured import Bytes, Floats

SCALE = (MM_PER_PX, MM_PER_PX)


FITS = {**PHOTOMETRIC, "network": NetworkFitter(steps=150)}  # trained briefly


@lru_cache
@shared
def calibrated(name: str = "polynomial", odd: bool = False) -> CalibratedMethod:
    rng = np.random.default_rng(1)
    shots = [BallPicture(cut(picture(*ball(c, a, 4.0)[1:], rng), odd), 4.0) for c, a in presses(8, rng)]
    reference = make_reference([cut(flat(rng), odd) for _ in range(3)], may_have_marks=False)
    method = calibrate_from_balls(reference, shots, mm_per_px=SCALE, fit=FITS[name]).method
    return subtract_background(method, [cut(flat(rng), odd) for _ in range(8)])


def cut(rgb: Bytes, odd: bool) -> Bytes:
    return np.ascontiguousarray(rgb[:-1, :-1]) if odd else rgb


def tiled(method: CalibratedMethod, rgb: Bytes) -> SlopeReading:
    assert method.tiled_evaluator is not None
    return method.tiled_evaluator.read(rgb)


def depth(method: CalibratedMethod, rgb: Bytes, *, whole: bool) -> Floats:
    reading = method.read(rgb) if whole else tiled(method, rgb)
    found = integrate(reading.slopes.__class__(reading.slopes.dz_dx, reading.slopes.dz_dy), SCALE)
    return np.asarray(found - np.median(found[:6]), np.float64)


@pytest.mark.parametrize("odd", [pytest.param(False, marks=pytest.mark.slow), True])
def test_pressed_pixels_are_read_as_in_the_whole_picture(odd: bool) -> None:
    method, (_, p, q) = calibrated(odd=odd), ball((0.5, 0.5), 1.5, 4.0)
    rgb = cut(picture(p, q, np.random.default_rng(3)), odd)
    whole, quick = method.read(rgb), tiled(method, rgb)
    steep = np.hypot(p, q)[: rgb.shape[0], : rgb.shape[1]] > 0.15
    assert np.array_equal(whole.slopes.dz_dx[steep], quick.slopes.dz_dx[steep])
    assert np.array_equal(whole.slopes.dz_dy[steep], quick.slopes.dz_dy[steep])
    assert quick.steepest == whole.steepest
    assert whole.slopes.valid is not None
    assert quick.slopes.valid is not None
    assert np.array_equal(whole.slopes.valid, quick.slopes.valid)


@pytest.mark.slow
def test_a_contact_smaller_than_a_block_of_the_drift_is_not_overlooked() -> None:
    method, (true, p, q) = calibrated(), ball((1.1, -0.7), 5 * MM_PER_PX, 2.0)
    peak, rng = true > 0.7 * true.max(), np.random.default_rng(4)
    for _ in range(3):
        rgb = picture(p, q, rng)
        whole, quick = (depth(method, rgb, whole=whole)[peak].mean() for whole in (True, False))
        assert quick == pytest.approx(whole, abs=0.03 * true.max())


@pytest.mark.parametrize("size_px", [4, 6, 8])
def test_a_gentle_contact_of_few_pixels_is_as_deep_as_pixel_by_pixel(size_px: int) -> None:
    """Slopes of .1 are three times a single pixel's noise, which tells no contact, and nine times a mean's."""
    method = calibrated()
    true, p, q = ball((1.1, -0.7), size_px * MM_PER_PX, 10 * size_px * MM_PER_PX)
    peak, rng = true > 0.7 * true.max(), np.random.default_rng(5)
    found = []
    for _ in range(6):
        rgb = picture(p, q, rng)
        found.append([depth(method, rgb, whole=whole)[peak].mean() / true.max() for whole in (True, False)])
    whole, quick = np.mean(found, axis=0)
    assert quick == pytest.approx(whole, abs=0.06)  # .055 on some processors, .05 on others


@each("name", ["polynomial", "lookup"])
@each("px", [2, 3, 4])
def test_a_contact_of_few_means_is_read_in_full_and_free_gel_is_not(name: str, px: int) -> None:
    reader, (_, p, q) = TiledEvaluator(calibrated(name), px), ball((1.1, -0.7), 6 * MM_PER_PX, 2.0)
    y, x = np.unravel_index(int(np.argmax(np.hypot(p, q))), SHAPE)
    rng = np.random.default_rng(10)
    for _ in range(3):
        windows = reader.read(picture(p, q, rng)).windows
        assert any(r.start <= y < r.stop and c.start <= x < c.stop for r, c in windows)
        assert reader.read(flat(rng)).windows == []


@each("name", ["polynomial", "lookup"])
@each("gain", [1.0, 0.96])
def test_depths_are_no_worse(name: str, gain: float) -> None:
    method, (true, p, q) = calibrated(name), ball((-0.6, 0.4), 1.8, 4.0)
    true = true - np.median(true[:6])
    rng = np.random.default_rng(5)
    off = {whole: [] for whole in (True, False)}  # type: dict[bool, list[float]]
    for _ in range(4):
        rgb = np.clip(np.rint(gain * picture(p, q, rng)), 0, 255).astype(np.uint8)
        for whole, found in off.items():
            found.append(float(np.sqrt(np.mean((depth(method, rgb, whole=whole) - true) ** 2))))
    assert np.mean(off[False]) < 1.1 * np.mean(off[True]) + 2e-4


def test_calm_gel_is_calmer_and_follows_the_light() -> None:
    method = calibrated().with_reference(calibrated().reference)
    rng = np.random.default_rng(6)
    x = np.linspace(-1, 1, SHAPE[1])[None, :, None]
    warm = 1.0 + 0.03 * x**2 * np.array([1.0, -1.0, 0.5])
    noise = [np.median(np.abs(f(method, flat(rng)).slopes.dz_dx)) for f in (CalibratedMethod.read, tiled)]
    assert noise[1] < 0.7 * noise[0]
    before = np.sqrt(np.mean(depth(method, flat(rng, gain=warm), whole=False) ** 2))
    for _ in range(60):
        method.follow(flat(rng, gain=warm), 0.1)
    assert np.sqrt(np.mean(depth(method, flat(rng, gain=warm), whole=False) ** 2)) < 0.3 * before


def test_only_a_method_settled_so_is_read_so() -> None:
    method = calibrated()
    assert method.tiled_evaluator is not None
    assert dataclasses.replace(method, card=MethodCard()).tiled_evaluator is None
    marks = Marks(0.0, 4.0, np.zeros(SHAPE, np.uint8))
    assert method.with_reference(dataclasses.replace(method.reference, marks=marks)).tiled_evaluator is None


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.slow if one in ("network", "auto") else ()) for one in PHOTOMETRIC],
)
def test_what_a_law_says_of_noisy_pixels_on_the_mean_it_says_of_their_mean(name: str) -> None:
    law, rng = calibrated(name).law, np.random.default_rng(8)
    noise, place = 0.03, np.zeros((8000, 2))
    drawn, colours = noise * rng.standard_normal((8000, 3)), 0.05 * rng.standard_normal((60, 3))

    def said(by: ColourLaw, noise: Floats) -> Floats:
        """Mean slopes (60, 2) of the colours under noise, those of rest taken off."""
        rest = by.at(noise, place).mean(axis=0)
        return np.array([by.at(colour + noise, place).mean(axis=0) - rest for colour in colours])

    of_pixels, of_means = said(law, drawn), said(law.averaged(np.full(3, noise * np.sqrt(8 / 9))), drawn / 3)
    most = 0.034 if name == "auto" else 0.03  # the fit that is chosen today leaves .032
    assert np.sqrt(np.mean((of_means - of_pixels) ** 2)) < most * np.sqrt(np.mean(of_pixels**2))


def test_windows_hold_all_that_is_loud_and_none_overlaps_another() -> None:
    reader, rng = calibrated().tiled_evaluator, np.random.default_rng(9)
    assert reader is not None
    counts = []
    for _ in range(40):
        loud = np.zeros(reader.slope_threshold.shape, np.bool_)
        for top, left in rng.integers(0, np.array(loud.shape) - 4, (5, 2)):
            loud[top : top + rng.integers(3, 20), left : left + rng.integers(3, 20)] = True
        windows = reader.windows(np.stack([2.0 * reader.slope_threshold * loud, 0.0 * reader.slope_threshold]))
        covered = np.zeros(SHAPE, int)
        for window in windows:
            covered[window] += 1
        counts.append(len(windows))
        assert covered.max() == 1
        assert covered[:: reader.px, :: reader.px][: loud.shape[0], : loud.shape[1]][loud].min() == 1
    assert max(counts) > 1


def test_what_noise_makes_of_dark_gel_is_no_depth() -> None:
    method, rng = calibrated(), np.random.default_rng(7)
    maps = [depth(method, flat(rng), whole=False) for _ in range(8)]
    assert np.sqrt(np.mean(np.mean(maps, axis=0) ** 2)) < 0.6 * np.sqrt(np.mean(np.square(maps)))
