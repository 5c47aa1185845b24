"""Contacts cut by a region of interest or by the picture's border, against exact surfaces: right, or refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from each import each

from tactilevision.heightmap.poisson import integrate
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Floats, Pair

SHAPE, STEP, DEEP, WIDE = (120, 160), 0.1, 0.4, 1.6


def dent(centre_mm: Pair, shape: tuple[int, int] = SHAPE) -> tuple[Floats, SlopeMap, Floats]:
    """Depth DEEP exp(-r^2/WIDE^2), its slopes as written down, and r."""
    y, x = np.indices(shape) * STEP
    x, y = x - centre_mm[0], y - centre_mm[1]
    depth = DEEP * np.exp(-(x**2 + y**2) / WIDE**2)
    return depth, SlopeMap(-2 * x / WIDE**2 * depth, -2 * y / WIDE**2 * depth), np.hypot(x, y)


def off(found: npt.NDArray[np.floating[Any]], true: Floats, where: Bools, away: Bools) -> float:
    """Greatest error in parts of DEEP, counted from the untouched gel."""
    level = float(np.median((found - true)[where & away]))
    return float(np.abs(found - true - level)[where].max()) / DEEP


@each("left_mm", [5.0, 7.0, 8.0, 8.8])
def test_a_region_that_cuts_a_contact_keeps_its_depth(left_mm: float) -> None:
    """Slopes outside the region are nonsense; the cut goes beside, through and past the middle."""
    true, slopes, r = dent((8.0, 6.0))
    region = np.indices(SHAPE)[1] * STEP >= left_mm
    nonsense = np.random.default_rng(0).normal(0.0, 3.0, (2, *SHAPE))
    p, q = (np.where(region, s, n) for s, n in zip((slopes.dz_dx, slopes.dz_dy), nonsense, strict=True))
    assert off(integrate(SlopeMap(p, q, region), (STEP, STEP)), true, region, r > 4.0) < 0.01
    assert off(integrate(SlopeMap(p, q), (STEP, STEP)), true, region, r > 4.0) > 0.05, "left out, it spoils all"


def test_a_region_with_a_hole_carries_the_depth_round_it() -> None:
    true, slopes, r = dent((8.0, 6.0))
    region = np.hypot(*(np.indices(SHAPE) * STEP - np.array([6.0, 9.0])[:, None, None])) > 0.7
    p = np.where(region, slopes.dz_dx, np.nan)
    assert off(integrate(SlopeMap(p, slopes.dz_dy), (STEP, STEP)), true, region, r > 4.0) < 0.02


@each("centre_mm", [(0.0, 6.0), (1.0, 6.0), (8.0, 0.2), (0.5, 0.5)])
def test_a_free_border_keeps_the_depth_of_a_contact_that_it_cuts(centre_mm: Pair) -> None:
    true, slopes, r = dent(centre_mm)
    everywhere = np.ones(SHAPE, np.bool_)
    assert off(integrate(slopes, (STEP, STEP)), true, everywhere, r > 4.0) < 0.01
