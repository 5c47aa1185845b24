"""Coarse slopes with fine windows in them come out as one solution of the whole picture does."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from each import each

from tactilevision.heightmap.poisson import TwoGridPoisson, _solved, integrate
from tactilevision.photometric.colour_change import Window
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Floats, Picture

SHAPE, STEP = (121, 163), (0.06, 0.07)


def punch(centre: tuple[float, float], radius: float = 1.2) -> tuple[Floats, Picture]:
    """Depth of a tilted face of .3 mm, its wall a few pixels wide, gel beside it; and its slopes (2, H, W)."""

    def depth(x: Floats, y: Floats) -> Floats:
        r = np.hypot(x - centre[0], y - centre[1])
        wall = 1.0 / (1.0 + np.exp((r - radius) / 0.07))
        return 0.3 * wall * (1 + 0.05 * (x - centre[0])) + 0.05 * np.exp(-(r**2) / 6.0) + 0.002 * x - 0.001 * y

    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    x, y, e = x * STEP[0], y * STEP[1], 1e-5
    slopes = [depth(x + e, y) - depth(x - e, y), depth(x, y + e) - depth(x, y - e)]
    return depth(x, y), np.asarray(np.stack(slopes) / (2 * e), np.float32)


def seen(slopes: Picture, px: int) -> Picture:
    height, width = (n // px for n in SHAPE)
    cells = slopes[:, : height * px, : width * px].reshape(2, height, px, width, px)
    return np.asarray(cells.mean(axis=(2, 4)), np.float32)


def window_about(centre: tuple[float, float], px: int) -> Window:
    ends = [
        (max(0, int((c - 2.2) / step)) // px * px, min(n, (int((c + 2.2) / step) // px + 1) * px))
        for c, step, n in zip(centre[::-1], STEP[::-1], SHAPE, strict=True)
    ]
    return slice(*ends[0]), slice(*ends[1])


@each("px", [2, 3, 4])
@each("centre", [(4.5, 4.0), (0.6, 4.0), (9.4, 8.1), (5.0, 0.4)])
def test_the_depth_of_a_contact_is_that_of_one_solution(px: int, centre: tuple[float, float]) -> None:
    _, slopes = punch(centre)
    window, grids = window_about(centre, px), TwoGridPoisson(SHAPE, px, STEP)
    fine = [slopes[:, *window]]
    found = grids.whole(grids.coarse(seen(slopes, px), [window], fine=fine), [window], fine=fine)
    off = found - integrate(SlopeMap(*slopes), STEP)
    off -= np.median(off)
    assert np.abs(off).max() < 1e-3
    assert np.abs(off[window]).mean() < 3e-4
    assert np.abs(off[window].mean()) < 2e-4


def test_a_window_of_the_whole_picture_is_one_solution() -> None:
    _, slopes = punch((4.5, 4.0))
    window, grids = (slice(0, SHAPE[0]), slice(0, SHAPE[1])), TwoGridPoisson(SHAPE, 3, STEP)
    found = grids.whole(grids.coarse(seen(slopes, 3), [window], fine=[slopes]), [window], fine=[slopes])
    one = integrate(SlopeMap(*slopes), STEP)
    assert np.abs((found - found.mean()) - one).max() < 1e-6


@pytest.mark.parametrize("centre", [(4.5, 4.0), (0.6, 4.0)])
def test_a_plane_taken_off_the_coarse_depth_is_off_the_whole(centre: tuple[float, float]) -> None:
    _, slopes = punch(centre)
    window, grids, tilt = window_about(centre, 3), TwoGridPoisson(SHAPE, 3, STEP), (0.004, -0.007)
    fine = [slopes[:, *window]]
    coarse = grids.coarse(seen(slopes, 3), [window], fine=fine)
    plain = grids.whole(coarse, [window], fine=fine)
    x, y = (step * np.arange(n) for n, step in zip(coarse.shape[::-1], grids.coarse_mm, strict=True))
    levelled = coarse - np.float32(tilt[0]) * x[None, :] - np.float32(tilt[1]) * y[:, None]
    off = plain - grids.whole(np.asarray(levelled, np.float32), [window], fine=fine, tilt=tilt)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    assert np.ptp(off - tilt[0] * STEP[0] * x - tilt[1] * STEP[1] * y) < 2e-6


def test_without_windows_the_surface_is_carried_on_to_the_border() -> None:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    depth = 1e-3 * (x * STEP[0] - 5.0) ** 2 - 2e-3 * y * STEP[1]
    slopes = np.stack([2e-3 * (x * STEP[0] - 5.0), np.full(SHAPE, -2e-3)]).astype(np.float32)
    grids = TwoGridPoisson(SHAPE, 4, STEP)
    off = grids.whole(grids.coarse(seen(slopes, 4), [], fine=[]), [], fine=[]) - depth
    assert np.ptp(off) < 2e-4


@pytest.mark.parametrize("shape", [(40, 53), (130, 121)])
def test_the_laplacian_of_a_solution_is_the_right_side_for_all_ends(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(8).normal(0, 1, shape).astype(np.float32)
    for top, bottom, left, right in product((False, True), repeat=4):
        side = random - random.mean() * (top and bottom and left and right)
        z = np.pad(_solved(side, STEP, ((top, bottom), (left, right))), 1, mode="edge").astype(np.float64)
        z[0] *= top
        z[-1] *= bottom
        z[:, 0] *= left
        z[:, -1] *= right
        along_x, along_y = (np.diff(z, 2, axis=axis) / step**2 for axis, step in zip((1, 0), STEP, strict=True))
        np.testing.assert_allclose(along_x[1:-1] + along_y[:, 1:-1], side, atol=1e-2)
