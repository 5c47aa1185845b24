"""Which presses repeat each other, and what was recorded beside depth and force.

Presses of one radius at one rate (within a factor 2) are repeats of each other: how they differ is the error
model's business, whatever the law. The smooth bases of a group take the group's mean curve out, so that noise
is estimated from differences between repeats and from what is rough, never from what a law lacks.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calibration.data import Ints, Observations
from tactilevision.records import Floats

LOAD, HOLD, UNLOAD, FREE = 0, 1, 2, 3
BRANCHES = ("load", "hold", "unload", "free")
DEGREES = (4, 1, 3, 0)
SAME_MM = 0.02  # five press zeros: depths nearer than this may be one
COURSE, SAMPLES_A_DEGREE = 4, 4  # degree of a ramp's depth over time, at most and by its samples
_KEPT: deque[tuple[tuple[np.ndarray, ...], Floats]] = deque(maxlen=8)


@dataclass(frozen=True, slots=True)
class Covariate:
    """Something recorded: `values` (N,), NaN nowhere; `of_press` where it is one number a press."""

    name: str
    unit: str
    values: Floats
    of_press: bool


def branches(data: Observations) -> Ints:
    """LOAD, HOLD, UNLOAD or FREE for each sample (N,); from the depth itself where no phase was recorded."""
    known = np.select([data.phase == name for name in BRANCHES], range(4), default=-1)
    if (known >= 0).all():
        return np.asarray(known, dtype=np.int64)
    found = np.full(data.size, LOAD)
    for start, end in zip(data.first, [*data.first[1:], data.size], strict=True):
        depth = data.depth_mm[start:end]
        deepest = int(np.argmax(depth))
        found[start + deepest + 1 : end] = UNLOAD
        near = depth > 0.995 * depth[deepest]
        if near.sum() > 2:
            found[start:end][near] = HOLD
            found[start + int(np.argmax(near))] = LOAD
    return np.where(known >= 0, known, found)


def steady_depth(data: Observations) -> Floats:
    """Depth (N,) without most of its readings' noise: a hold's and the air's mean, a smooth course of the others.

    A plateau is many readings of one depth: sorted by what was read they would be sorted by their noise. Kept for
    the last few data sets, since every prediction of an effect that remembers asks again; not to be written to.
    """
    key = (data.depth_mm, data.time_s, data.phase, data.press)
    for known, steady in _KEPT:
        if all(a is b for a, b in zip(known, key, strict=True)):
            return steady
    steady = _steady(data) if data.is_curves else data.depth_mm.copy()
    steady.setflags(write=False)
    _KEPT.append((key, steady))
    return steady


def _steady(data: Observations) -> Floats:
    branch, steady = branches(data), data.depth_mm.copy()
    for start, end in zip(data.first, [*data.first[1:], data.size], strict=True):
        for kind in np.unique(branch[start:end]):
            mine = start + np.flatnonzero(branch[start:end] == kind)
            steady[mine] = _course(data.time_s[mine], data.depth_mm[mine], kind in (LOAD, UNLOAD))
    return steady


def nominal_depth(data: Observations) -> Floats:
    """The same with one depth for plateaus, and points, of one radius that a press's zero alone may part."""
    steady = steady_depth(data).copy()
    flat = np.isin(branches(data), (HOLD, FREE)) if data.is_curves else np.ones(data.size, dtype=bool)
    for radius in np.unique(data.radius_mm):
        mine = np.flatnonzero(flat & (data.radius_mm == radius))
        mine = mine[np.argsort(steady[mine], kind="stable")]
        if mine.size:
            number = _clusters(steady[mine], SAME_MM)
            steady[mine] = (np.bincount(number, steady[mine]) / np.bincount(number))[number]
    return steady


def _clusters(values: Floats, apart: float) -> Ints:
    """Which cluster each of the values (n,), sorted, belongs to: one begins where the last one's first is `apart`
    away, so that the readings of a ramp, however near each other, are no cluster.
    """
    ordered = np.sort(values)
    number, start = np.zeros(values.size, dtype=np.int64), 0
    while (start := int(np.searchsorted(ordered, ordered[start] + apart, side="right"))) < values.size:
        number[start:] += 1
    return number


def _course(time_s: Floats, depth_mm: Floats, ramp: bool) -> Floats:
    """The mean of depths (n,), or a polynomial in the time through them; depths as read where they are too few,
    or lie farther from it than readings scatter.
    """
    degree = min(time_s.size // SAMPLES_A_DEGREE, COURSE) if ramp else 0
    if ramp and not (degree and np.isfinite(time_s).all() and np.ptp(time_s) > 0):
        return depth_mm
    if not degree:
        return np.full(time_s.size, np.mean(depth_mm))
    course = np.asarray(np.polynomial.Polynomial.fit(time_s, depth_mm, degree)(time_s))
    return course if np.abs(depth_mm - course).max() < SAME_MM else depth_mm


def repeat_groups(data: Observations) -> Ints:
    """Number of the group of like presses, (M,)."""
    rate = np.nan_to_num(np.round(np.log2(np.maximum(data.presses.speed_mm_s, 1e-9))), nan=-99)
    table = np.column_stack([data.presses.radius_mm, rate, np.nan_to_num(data.presses.lubricated)])
    return np.asarray(np.unique(table, axis=0, return_inverse=True)[1]).reshape(-1)


def group_basis(data: Observations) -> Floats:
    """Smooth curves of each group's branches, (N, k): polynomials in the depth, in a hold in the time.

    What lies above the gel is a constant for each phase: no smooth curve goes around the corner at the touch, and
    a gel that clings pulls in unloading alone.
    """
    groups = repeat_groups(data)[data.press]
    branch = branches(data) + np.where(data.depth_mm > 0, 0, len(BRANCHES))
    columns: list[Floats] = []
    for group in np.unique(groups):
        for kind in np.unique(branch[groups == group]):
            mine = (groups == group) & (branch == kind)
            along = data.depth_mm if kind != HOLD else data.time_s - data.time_s[data.first][data.press]
            columns += _polynomials(
                along, mine, DEGREES[int(kind)] if kind < len(BRANCHES) else 0, SAME_MM if kind != HOLD else None
            )
    return np.column_stack(columns)


def _polynomials(
    along: Floats, mine: npt.NDArray[np.bool_], degree: int, apart: float | None = None
) -> list[Floats]:
    """Of at most so many degrees as there are distinct places, less one; `apart` what parts two of them."""
    low, high = float(along[mine].min()), float(along[mine].max())
    unit = 2 * (along - low) / (high - low) - 1 if high > low else np.zeros(along.size)
    distinct = (
        np.unique(np.round(unit[mine], 6)).size if apart is None else int(_clusters(along[mine], apart)[-1]) + 1
    )
    kept = range(min(degree, distinct - 1) + 1)
    return [np.where(mine, np.polynomial.legendre.Legendre.basis(k)(np.clip(unit, -1, 1)), 0.0) for k in kept]


def covariates(data: Observations) -> tuple[Covariate, ...]:
    """Everything that was recorded and varies, in a fixed order."""
    presses, press = data.presses, data.press
    begin = data.time_s[data.first][press]
    rate = np.log10(np.maximum(presses.speed_mm_s, 1e-9))
    table = [
        ("w", "mm", data.depth_mm, False),
        ("w/h", "1", data.depth_mm / data.gel.thickness_mm, False),
        ("1/w", "1/mm", 1 / np.maximum(data.depth_mm, 0.02), False),
        ("P", "N", data.normal_N, False),
        ("t", "log10 s", np.log10(np.maximum(data.time_s - begin, 1e-3)), False),
        ("load/unload", "0 load, 1 hold, 2 unload, 3 free", branches(data).astype(float), False),
        ("Fx", "N", data.force_N[:, 0], False),
        ("Fy", "N", data.force_N[:, 1], False),
        ("a", "mm", data.radius_mm, True),
        ("log rate", "log10 mm/s", rate[press], True),
        ("order", "", presses.order[press], True),
        ("recording date", "d", presses.day[press], True),
        ("wait", "log10 s", np.log10(np.maximum(presses.rest_s, 1e-3))[press], True),
        ("x", "mm", presses.x_mm[press], True),
        ("y", "mm", presses.y_mm[press], True),
        ("azimuth", "rad", np.arctan2(presses.y_mm, presses.x_mm)[press], True),
        ("T", "C", data.temperature_C, True),
        ("indenter", "", presses.indenter[press].astype(float), True),
    ]
    found = []
    for name, unit, values, of_press in table:
        filled = _filled(np.asarray(values, dtype=float))
        if filled is not None:
            found.append(Covariate(name, unit, filled, of_press))
    return tuple(found)


def _filled(values: Floats) -> Floats | None:
    """The values with a few unknown ones at the median; None where it does not vary or half is unknown."""
    known = np.isfinite(values)
    if known.mean() < 0.5:
        return None
    values = np.where(known, values, np.median(values[known]))
    return values if np.ptp(values) > 1e-9 * max(1.0, float(np.max(np.abs(values)))) else None


def bins(covariate: Covariate, most: int) -> Ints:
    """Bin of each sample (N,), of about equal counts; each distinct value its own where there are few."""
    distinct = np.unique(covariate.values)
    if distinct.size <= most:
        return np.searchsorted(distinct, covariate.values)
    edges = np.quantile(covariate.values, np.linspace(0, 1, most + 1)[1:-1])
    return np.unique(np.searchsorted(np.unique(edges), covariate.values), return_inverse=True)[1]
