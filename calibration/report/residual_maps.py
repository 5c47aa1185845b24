"""The height map against the surface that theory lets expect: what is left of the picture, press by press.

    residual(x, y) = measured depth - [w under the face, -w rise(r) beside it]

averaged over presses on a grid about the punch's axis. The rise is linear layer theory's at the gel's stated nu
(.48 where none is), so a few um of it are nu's. Towards the bevel nothing is compared: its edge touches there.
Two tests, each press one number: does what is left beside the punch depend on the azimuth (Hotelling's T^2 of its
first harmonic: a tilt, a light that is off), and does it grow towards the punch (Student's t, the height map's own
std taken as shared by all presses: a gain, another nu)?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.diagnosis.score_test import Scored
from tactilevision.mechanics.profile import exact_profile
from tactilevision.records import Bools, Floats, Gel, HeightMap, Pair

HALF = 3.0  # half the width of the grid, in radii of the punch
STEPS = 61  # places across the grid: a tenth of a radius apart
NEAR = (1.15, 1.7)  # ring beside the punch, in radii: past its wall
FAR = (2.0, 2.8)  # ring that the near one is compared with, in radii
MIN_COUNT = 4  # presses: Hotelling's test of two components needs three and one more
TOWARDS = {"right": 0.0, "bottom": np.pi / 2, "left": np.pi, "top": -np.pi / 2}
BEVEL_HALF_ANGLE = np.pi / 3  # rad either side of the bevel's azimuth that is left out


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """One press's height map, where its punch stood, and what is certified of it."""

    height_map: HeightMap
    centre_mm: Pair
    radius_mm: float
    depth_mm: float
    bevel: str | None


@dataclass(frozen=True, slots=True, eq=False)
class ResidualMap:
    """Mean residual (STEPS, STEPS) in mm over `count` presses, x and y at `axis` (STEPS,) in radii; the tests."""

    residual_mm: Floats
    axis: Floats
    count: int
    covariates: tuple[Scored, ...]


def residual_map(surfaces: Sequence[Surface], gel: Gel) -> ResidualMap | None:
    """What the height maps of these presses leave; None for fewer than four."""
    if len(surfaces) < MIN_COUNT:
        return None
    axis = np.linspace(-HALF, HALF, STEPS)
    x, y = np.meshgrid(axis, axis)
    maps = np.array([_residual(one, gel, x, y) for one in surfaces])
    known = np.isfinite(maps)
    mean = np.where(known.any(axis=0), np.nansum(maps, axis=0) / np.maximum(known.sum(axis=0), 1), np.nan)
    tests = (_azimuth(maps, x, y), _radius(maps, surfaces, x, y))
    found = [test for test in tests if test is not None]
    both = tuple(Scored(s.key, s.statistic, s.p, min(1.0, len(found) * s.p)) for s in found)
    return ResidualMap(mean, axis, len(surfaces), both)


def _residual(one: Surface, gel: Gel, x: Floats, y: Floats) -> Floats:
    nu = 0.48 if gel.poisson_ratio is None else gel.poisson_ratio
    r = np.hypot(x, y)
    table = np.linspace(1.02, HALF * 1.5, 80)
    rise, _ = exact_profile(table, nu, a_over_h=one.radius_mm / gel.thickness_mm)
    expected = one.depth_mm * np.where(r < 1, 1.0, -np.interp(r, table, rise))
    measured = _sample(one.height_map, one.centre_mm, one.radius_mm * x, one.radius_mm * y)
    wall = (r > 0.9) & (r < 1.1)  # a step has no depth of its own
    return np.where(wall | _towards(one.bevel, x, y), np.nan, measured - expected)


def _towards(bevel: str | None, x: Floats, y: Floats) -> Bools:
    if bevel is None:
        return np.zeros(x.shape, dtype=bool)
    turn = np.angle(np.exp(1j * (np.arctan2(y, x) - TOWARDS[bevel])))
    return np.asarray((np.abs(turn) < BEVEL_HALF_ANGLE) & (np.hypot(x, y) > 1))


def _sample(seen: HeightMap, centre_mm: Pair, x_mm: Floats, y_mm: Floats) -> Floats:
    """Depth at places about the centre, nearest pixel; NaN outside the picture or where it is not valid."""
    rows, columns = seen.depth_mm.shape
    column = np.rint((centre_mm[0] + x_mm) / seen.mm_per_px[0] + (columns - 1) / 2).astype(int)
    row = np.rint((centre_mm[1] + y_mm) / seen.mm_per_px[1] + (rows - 1) / 2).astype(int)
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    row, column = np.where(inside, row, 0), np.where(inside, column, 0)
    return np.where(inside & seen.valid[row, column], seen.depth_mm[row, column], np.nan)


def _azimuth(maps: Floats, x: Floats, y: Floats) -> Scored | None:
    """Hotelling's T^2 of the first harmonic beside the punch over the presses."""
    from scipy.stats import f

    r, angle = np.hypot(x, y), np.arctan2(y, x)
    ring = (r > NEAR[0]) & (r < FAR[1])
    rows = []
    for one in maps:
        use = ring & np.isfinite(one)
        if np.count_nonzero(use) > 50:
            table = np.column_stack([np.ones(use.sum()), np.cos(angle[use]), np.sin(angle[use])])
            rows.append(np.linalg.lstsq(table, one[use], rcond=None)[0][1:])
    count = len(rows)
    if count < MIN_COUNT:
        return None
    mean, spread = np.mean(rows, axis=0), np.cov(np.array(rows).T)
    squared = float(count * mean @ np.linalg.solve(spread, mean)) * (count - 2) / (2 * (count - 1))
    p = float(f.sf(squared, 2, count - 2))
    return Scored("height map: azimuth", squared, p, p)


def _radius(maps: Floats, surfaces: Sequence[Surface], x: Floats, y: Floats) -> Scored | None:
    """Student's t of the near ring less the far one, against presses' scatter and the height map's own std."""
    from scipy.stats import t

    r = np.hypot(x, y)
    rings = [(r > low) & (r < high) for low, high in (NEAR, FAR)]
    steps = [_mean(one[rings[0]]) - _mean(one[rings[1]]) for one in maps]
    known = np.array([step for step in steps if np.isfinite(step)])
    if known.size < MIN_COUNT:
        return None
    own = [_mean(s.height_map.std_mm[s.height_map.valid]) for s in surfaces if s.height_map.std_mm is not None]
    shared = float(np.median(own)) if own else 0.0
    error = np.sqrt(known.var(ddof=1) / known.size + shared**2)
    statistic = float(known.mean() / error)
    p = float(2 * t.sf(abs(statistic), known.size - 1))
    return Scored("height map: radius", statistic**2, p, p)


def _mean(values: npt.NDArray[np.floating[Any]]) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
