"""The terms of a depth's deviation: each by its equation, gone in its limit, and together the whole."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tactilevision.heightmap.build import untouched_std_mm
from tactilevision.heightmap.deviation import (
    contributions_mm,
    free_variance,
    hidden_step_mm,
    missing_colour_variance,
    noise_variance,
    scale_variance,
    shades,
    wall_variances,
    zero_variance,
)
from tactilevision.heightmap.reconstructor import Reading, Reconstructor
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.heightmap.zero_plane import ZeroPlane, find_zero_plane
from tactilevision.records.maps import SlopeMap
from tactilevision.records.rig import SHADOW_ZONE

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import SENSOR, SHAPE, ball, picture, room_calibration

Floats = npt.NDArray[np.float32]
PX = (0.05, 0.05)


def dent() -> Floats:
    y, x = np.indices((60, 80), dtype=np.float32)
    return np.asarray(0.5 * np.exp(-((x - 40) ** 2 + (y - 30) ** 2) / 50.0), np.float32)


def test_the_scale_is_a_part_of_the_depth_and_none_of_no_depth() -> None:
    gain = np.full((60, 80), 0.03**2, np.float32)
    np.testing.assert_allclose(np.sqrt(scale_variance(dent(), gain)), 0.03 * dent(), rtol=1e-5, atol=1e-9)
    assert not scale_variance(np.zeros_like(dent()), gain).any()
    assert not scale_variance(dent(), 0 * gain).any()


def test_noise_counts_by_its_square_and_vanishes_with_it() -> None:
    noise = np.full((60, 80), 0.01, np.float32)
    one, two = noise_variance(noise, PX), noise_variance(2 * noise, PX)
    np.testing.assert_allclose(two, 4 * one, rtol=1e-3)
    assert not noise_variance(0 * noise, PX).any()


@pytest.mark.parametrize("seed", range(3))
def test_drawn_noise_scatters_as_far_as_its_term_says(seed: int) -> None:
    from tactilevision.heightmap.poisson import integrate

    noise, rng = np.full((60, 80), 0.01, np.float32), np.random.default_rng(seed)
    drawn = [integrate(SlopeMap(*(noise * rng.standard_normal((2, 60, 80)))), PX) for _ in range(20)]
    assert np.std(drawn) == pytest.approx(np.sqrt(noise_variance(noise, PX).mean()), rel=0.25)


def test_free_gel_is_noise_alone_where_its_frames_are_flat() -> None:
    noise = np.full((64, 80), 1e-6, np.float32)
    flat_frames = untouched_std_mm([np.zeros((64, 80))] * 4)
    np.testing.assert_array_equal(free_variance(noise, 0.0, untouched_std=flat_frames), noise)
    np.testing.assert_allclose(free_variance(noise, 0.002, untouched_std=flat_frames), 5e-6, rtol=1e-5)
    np.testing.assert_allclose(free_variance(noise, 0.0, untouched_std=flat_frames + 0.003), 9e-6, rtol=1e-5)


def test_a_flat_map_has_a_sure_zero_plane() -> None:
    y, x = np.indices((120, 160), dtype=np.float64)
    tilted = 0.01 * x - 0.02 * y
    free = np.ones((24, 32), np.bool_)
    assert zero_variance(find_zero_plane(tilted, free, mm_per_px=PX), (4, 5)).max() < 1e-12
    waves = tilted + 0.01 * np.sin(x / 7) * np.cos(y / 9)
    variance = zero_variance(find_zero_plane(waves, free, mm_per_px=PX), (3, 5))
    assert variance.min() == variance[1, 2] > 1e-7
    # a plane's tilt is known as well as its middle over the rms of X, 1 / sqrt(3): corners have 1 + 3 + 3 of it
    np.testing.assert_allclose(variance[::2, ::4] / variance[1, 2], 7.0, rtol=0.15)


def test_an_edge_counts_within_its_radius_alone() -> None:
    edge = PunchEdge((2.0, 1.5), 1.0, 0.2, np.zeros(2), np.zeros(2), 0.5, 0.1, 0.02)
    assert not wall_variances((60, 80), [], mm_per_point=PX).any()
    assert not wall_variances((60, 80), [replace(edge, std_mm=0.0)], mm_per_point=PX)[0].any()
    total = wall_variances((60, 80), [edge], mm_per_point=PX)[0]
    y, x = np.indices(total.shape)
    inside = np.hypot(0.05 * x - 2.0, 0.05 * y - 1.5) < 1.0
    np.testing.assert_allclose(total, np.where(inside, 4e-4, 0.0), rtol=1e-6)


def test_gel_that_a_wall_may_shade_is_uncertain_and_no_gel_beyond() -> None:
    places = np.linspace(0.0, 3.0, 200)
    edge = PunchEdge((2.0, 1.5), 1.0, 0.2, places, 0.1 * np.sqrt(places), 0.2, 0.1, 0.02)
    total = wall_variances((60, 80), [edge], mm_per_point=PX)[1]
    y, x = np.indices(total.shape) * PX[0]
    beyond = np.hypot(x - 2.0, y - 1.5) - 1.0
    assert shades(edge)
    assert not total[beyond > SHADOW_ZONE.reach * 0.2 + 0.05].any()
    assert np.ptp(total[beyond < 0.2]) == pytest.approx(0.0, abs=1e-12)
    fall = 0.1 * (np.sqrt(SHADOW_ZONE.reach * 0.2) - np.sqrt(0.2))
    assert np.sqrt(total.max()) == pytest.approx(0.3 * fall, rel=0.01)
    gentle = replace(edge, depth_mm=0.03)
    assert not shades(gentle)
    assert not wall_variances((60, 80), [gentle], mm_per_point=PX)[1].any()


def test_a_steep_band_hides_a_step_only_around_a_face_if_asked() -> None:
    """A square face under an assumed light, of slopes that fall as 1/sqrt outside it; and a ball's, as steep."""
    y, x = (np.indices((120, 120)) - 59.5) * PX[0]
    beyond = np.maximum(np.abs(x), np.abs(y)) - 1.5
    slope = np.where(beyond > 0, -0.15 / np.sqrt(np.maximum(beyond, 0.01)), 0.0)
    across = np.abs(x) > np.abs(y)
    square = SlopeMap(slope * np.sign(x) * across, slope * np.sign(y) * ~across)
    r = np.hypot(x, y)
    fall = -np.minimum(r / 1.5, 1.5 / np.maximum(r, 0.1)) * 0.45 / np.maximum(r, 0.1)
    dome = SlopeMap(fall * x, fall * y)
    how: Any = {"steepest": 0.3, "every": 2, "mm_per_px": PX}
    for slopes, shown, hidden in ((square, beyond < 0, True), (dome, r < 1.5, False)):
        depth = np.where(shown, 0.3, 0.0).astype(np.float32)[::2, ::2]
        any_rim = hidden_step_mm(depth, slopes, **how)
        assert any_rim > 0.05
        assert hidden_step_mm(depth, slopes, sharp=True, **how) == (any_rim if hidden else 0.0)


def test_slopes_that_balls_showed_hide_nothing_and_steeper_ones_do() -> None:
    depth, slope = dent(), np.zeros((60, 80), np.float32)
    gentle = SlopeMap(slope + 0.5, slope)
    assert hidden_step_mm(depth, gentle, steepest=0.6, every=1, mm_per_px=PX) == 0.0
    slope[25:35, 30] = 0.8
    steep = SlopeMap(slope, 0 * slope)
    assert hidden_step_mm(depth, steep, steepest=0.6, every=1, mm_per_px=PX) == 0.0, "as few are noise"
    slope[20:40, 30:32] = 0.8
    hidden = hidden_step_mm(depth, steep, steepest=0.6, every=1, mm_per_px=PX)
    area = np.count_nonzero(depth > 0.5 * depth.max())
    assert hidden == pytest.approx(0.6 * 0.05 * 40 / np.sqrt(4 * np.pi * area))


@lru_cache
def reader() -> Reconstructor:
    return Reconstructor(SENSOR, room_calibration(8).method)


def height_map(*, warm: float = 0.0) -> Reading:
    """A ball's reading; the light has grown warmer across the picture by a part `warm`."""
    rng = np.random.default_rng(2)
    _, p, q = ball((0.5, 0.5), 1.5, 4.0)
    x = np.linspace(-1, 1, SHAPE[1])[None, :, None]
    seen = picture(p, q, rng) * (1.0 + warm * x * np.array([1.0, -1.0, 0.5]))
    return reader().read_rectified(np.clip(seen, 0, 255).astype(np.uint8))


@pytest.mark.parametrize("warm", [0.0, 0.05])
def test_the_terms_of_a_map_sum_to_its_deviation(warm: float) -> None:
    seen = height_map(warm=warm)
    height, error, terms = seen.height, reader().error, seen.terms_mm()
    assert error is not None
    assert height.std_mm is not None
    assert len(terms) == 10
    total = np.sqrt(sum(np.square(term) for term in terms.values()))
    stated = height.std_mm[error.every // 2 :: error.every, error.every // 2 :: error.every]
    rows, columns = min(total.shape[0], stated.shape[0]), min(total.shape[1], stated.shape[1])
    ratio = stated[:rows, :columns] / total[:rows, :columns]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.02)
    told = contributions_mm(height, terms)
    assert max(told, key=told.__getitem__) == "depth scale"
    assert (told["illumination"] > 0) == (warm > 0), "no drift, no doubt about it"
    assert told["steep edge"] == 0.0


def test_a_drift_that_is_known_exactly_costs_nothing() -> None:
    error = reader().error
    assert error is not None
    zero = ZeroPlane(0.0, (0.0, 0.0), 0.0, 1.0)
    coefficients = error.drift.depths.shape[0]
    assert not error.drift.variance(np.zeros((coefficients, coefficients)), zero).any()
    assert error.drift.variance(np.eye(coefficients), zero).max() > 0


def test_a_missing_colour_widens_depth_by_its_share_and_hardly_where_it_is_a_speck() -> None:
    depth = np.full((80, 100), 0.4, np.float32)
    share = np.zeros_like(depth)
    np.testing.assert_array_equal(missing_colour_variance(depth, share, every=2, mm_per_px=(0.06, 0.06)), 0.0)
    everywhere = missing_colour_variance(depth, share + np.float32(0.2), every=2, mm_per_px=(0.06, 0.06))
    np.testing.assert_allclose(np.sqrt(everywhere), 0.08, rtol=0.02)
    share[40:42, 50:52] = 1.0
    speck = missing_colour_variance(depth, share, every=2, mm_per_px=(0.06, 0.06))
    assert np.sqrt(speck.max()) < 0.01
