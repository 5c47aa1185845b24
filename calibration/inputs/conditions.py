"""Groups of repeated presses, and covariates recorded along with depth and force.

Presses of one radius at one rate (within a factor 2) are repeats of each other. A group's smooth basis removes its
mean curve, so that noise is estimated from differences between repeats and from roughness, not from what a law
lacks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.inputs.denoised_depth import BRANCHES, HOLD, SAME_MM, branches, clusters
from calibration.inputs.observations import Ints, Observations
from tactilevision.records.constants import TAILS95, TINY
from tactilevision.records.measured import Bools, Floats, Pair
from tactilevision.records.misfit import share_removed

PAUSE_S = 3600  # s, longest pause that counts as running time
SHORTEST_S = 1e-3  # s, of times whose logarithm is taken
APART = 0.1  # of a covariate's range: groups narrower than this and as far apart are one setting each
SESSION_D = 0.2  # d, longest session: its changes follow the order of pressing
DEGREES = (4, 1, 3, 0)  # of the mean curve over depth in load, hold, unload and free


@dataclass(frozen=True, slots=True)
class Covariate:
    """A recorded quantity: `values` (N,) without NaN; `of_press`: one number a press, or acting as one."""

    name: str
    unit: str
    values: Floats
    of_press: bool


def repeat_groups(data: Observations) -> Ints:
    """Return the index of each press's group of repeats, (M,)."""
    rate = np.nan_to_num(np.round(np.log2(np.maximum(data.presses.speed_mm_s, TINY))), nan=-99)
    table = np.column_stack([data.presses.radius_mm, rate, np.nan_to_num(data.presses.lubricated)])
    return np.asarray(np.unique(table, axis=0, return_inverse=True)[1]).reshape(-1)


def group_basis(data: Observations) -> Floats:
    """Return smooth curves of each group's branches, (N, k): polynomials in the depth, in a hold in the time.

    In air they are a constant for each phase, since the curve has a corner at the touch, and adhesion acts in
    unloading only.
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
    if data.slopes is not None:  # else drift of the picture counts as scatter of presses
        columns.append(data.depth_mm * running_share(data))
    return np.column_stack(columns)


def _polynomials(
    along: Floats, mine: npt.NDArray[np.bool_], degree: int, apart: float | None = None
) -> list[Floats]:
    """Return polynomials up to the number of distinct places less one; `apart` separates two places."""
    low, high = float(along[mine].min()), float(along[mine].max())
    unit = 2 * (along - low) / (high - low) - 1 if high > low else np.zeros(along.size)
    distinct = (
        np.unique(np.round(unit[mine], 6)).size if apart is None else int(clusters(along[mine], apart)[-1]) + 1
    )
    kept = range(min(degree, distinct - 1) + 1)
    return [np.where(mine, np.polynomial.legendre.Legendre.basis(k)(np.clip(unit, -1, 1)), 0.0) for k in kept]


# True repeats: presses of one punch at one place, speed, hold and depth. Their scatter needs no model.

SAME_PLACE_MM = 0.25  # a robot's own repeatability, with room
SAME_RATIO = 1.15  # of speeds, holds and depths that count as one setting
PARTS = 10  # of a branch, in each of which the presses of a group are compared with each other
MIN_DOF = 2  # repeated presses, less one a group, that determine a repeatability
KEPT = 16  # data sets whose repeatability is cached


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Std of one press among its true repeats, N (mm of a depth that was read), with its 95 % interval.

    `presses` that are repeated, in `groups` of like ones.
    """

    std: float
    interval95: Pair
    presses: int
    groups: int


@lru_cache(maxsize=KEPT)
def true_repeats(data: Observations) -> Repeatability | None:
    """Return the scatter of true repeats, a press as the unit; None where too few presses repeat.

        s^2 = sum over groups of SS n/(n - 1) / samples,    (dof) s^2/sigma^2 ~ chi^2,    dof = sum of n - 1

    SS is the sum of squares about the mean of a group's n presses, at equal depth and time. Source: Draper and
    Smith, Applied Regression Analysis, ch. 1 and 2.
    """
    from scipy.special import gammaincinv

    squares, samples, dof, presses, groups = 0.0, 0, 0, 0, 0
    for rows in _repeated(data):
        off, count = _off_mean(data, rows), np.unique(data.press[rows]).size
        squares += float(off @ off) * count / (count - 1)
        samples, dof = samples + off.size, dof + count - 1
        presses, groups = presses + count, groups + 1
    if dof < MIN_DOF or not squares > 0:
        return None
    std = math.sqrt(squares / samples)
    low, high = (std * math.sqrt(dof / 2 / float(gammaincinv(dof / 2, p))) for p in reversed(TAILS95))
    return Repeatability(std, (low, high), presses, groups)


def above_repeats(data: Observations, before: float, after: float) -> dict[str, Any]:
    """Return the scatter of true repeats, and the share of the removable error that was removed, for a file."""
    repeats = true_repeats(data)
    share = math.nan if repeats is None else share_removed(before, after, repeats.std)
    return {"repeats": repeats and asdict(repeats), "share_removed": share if math.isfinite(share) else None}


def _repeated(data: Observations) -> Iterator[Bools]:
    """Yield the samples (N,) of each group of at least two true repeats, of slopes those outside the faces."""
    presses, ratio = data.presses, math.log(SAME_RATIO)
    deepest = np.maximum.reduceat(data.depth_mm, data.first)
    settings = [(presses.indenter, 0.5), (presses.recording, 0.5), (np.nan_to_num(presses.lubricated), 0.5)]
    settings += [(np.nan_to_num(place), SAME_PLACE_MM) for place in (presses.x_mm, presses.y_mm)]
    sizes = [presses.speed_mm_s, presses.hold_s, *([deepest] if data.is_curves else [])]
    settings += [(np.log(np.maximum(np.nan_to_num(one), TINY)), ratio) for one in sizes]
    columns = []
    for values, apart in settings:
        order = np.argsort(values, kind="stable")
        columns.append(np.empty(data.count))
        columns[-1][order] = clusters(np.asarray(values, float), apart)
    group = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].reshape(-1)
    beside = np.ones(data.size, bool) if data.slopes is None else np.isfinite(data.slopes.slope)
    for number in np.flatnonzero(np.bincount(group) > 1):
        rows = (group == number)[data.press] & beside
        if np.unique(data.press[rows]).size > 1:
            yield rows


def _off_mean(data: Observations, rows: Bools) -> Floats:
    """Return the readings of a group's samples less the mean of its presses at equal depth and time."""
    readings, press = data.normal_N.copy(), data.press
    if data.is_curves:
        branch, cell = branches(data), np.zeros(data.size, dtype=np.int64)
        for kind in np.unique(branch[rows]):
            mine = rows & (branch == kind)
            along = data.depth_mm if kind != HOLD else data.time_s - data.time_s[data.first][press]
            columns = np.column_stack(_polynomials(along, mine, DEGREES[int(kind)], SAME_MM))[mine]
            readings[mine] -= columns @ np.linalg.lstsq(columns, readings[mine], rcond=None)[0]
            for one in np.unique(press[mine]):
                own = np.flatnonzero(mine & (press == one))
                cell[own] = PARTS * int(kind) + PARTS * np.arange(own.size) // own.size
    else:
        slopes, cell = data.slopes, np.zeros(data.size, dtype=np.int64)
        if slopes is not None:
            about = np.nan_to_num(np.column_stack([slopes.from_mm, slopes.azimuth_deg]))
            cell = np.unique(about, axis=0, return_inverse=True)[1].reshape(-1)
        readings *= float(data.depth_mm[rows].mean()) / data.depth_mm
    found = []
    for part in np.unique(cell[rows]):
        mine = rows & (cell == part)
        _, which, count = np.unique(press[mine], return_inverse=True, return_counts=True)
        means = np.bincount(which, readings[mine]) / count
        found.append(readings[mine] - means.mean())
    return np.concatenate(found)


def covariates(data: Observations) -> tuple[Covariate, ...]:
    """Return every recorded quantity that varies, in a fixed order."""
    presses, press = data.presses, data.press
    begin = data.time_s[data.first][press]
    rate = np.log10(np.maximum(presses.speed_mm_s, TINY))
    table = [
        ("w", "mm", data.depth_mm, False),
        ("w/h", "1", data.depth_mm / data.gel.thickness_mm, False),
        ("1/w", "1/mm", 1 / np.maximum(data.depth_mm, SAME_MM), False),
        ("P", "N", data.normal_N, False),
        ("t", "log10 s", np.log10(np.maximum(data.time_s - begin, SHORTEST_S)), False),
        ("load/unload", "0 load, 1 hold, 2 unload, 3 free", branches(data).astype(float), False),
        ("Fx", "N", data.force_N[:, 0], False),
        ("Fy", "N", data.force_N[:, 1], False),
        ("a", "mm", data.radius_mm, True),
        ("log rate", "log10 mm/s", rate[press], True),
        ("order", "", presses.order[press], True),
        ("recording date", "d", _of_sessions(presses.day)[press], True),
        ("wait", "log10 s", np.log10(np.maximum(presses.rest_s, SHORTEST_S))[press], True),
        ("x", "mm", presses.x_mm[press], True),
        ("y", "mm", presses.y_mm[press], True),
        ("azimuth", "rad", np.arctan2(presses.y_mm, presses.x_mm)[press], True),
        ("T", "°C", data.temperature_C, True),
        ("indenter", "", presses.indenter[press].astype(float), True),
    ]
    if data.slopes is not None:
        table += [
            ("slope", "mm/mm", data.slopes.slope, True),
            ("azimuth beside the face", "deg", data.slopes.azimuth_deg, True),
        ]
    if data.resultants is not None:
        table.append(("outline cut", "1", data.resultants.cut, True))
    found = []
    for name, unit, values, of_press in table:
        filled = _filled(np.asarray(values, dtype=float))
        if filled is not None:
            found.append(Covariate(name, unit, filled, of_press))
    return tuple(found)


def covariate(data: Observations, name: str) -> Floats:
    """Return one recorded quantity (N,) by its name in `covariates`; zeros where it does not vary."""
    return next((one.values for one in covariates(data) if one.name == name), np.zeros(data.size))


def _of_sessions(day: Floats) -> Floats:
    """Return the days (M,) of several sessions; NaN for one session, whose days follow the order."""
    known = day[np.isfinite(day)]
    return day if known.size and np.ptp(known) >= SESSION_D else np.full_like(day, np.nan)


def _filled(values: Floats) -> Floats | None:
    """Return the values with unknown ones at the median; None where they do not vary or half are unknown."""
    known = np.isfinite(values)
    if known.mean() < 0.5:
        return None
    values = np.where(known, values, np.median(values[known]))
    return values if np.ptp(values) > TINY * max(1.0, float(np.max(np.abs(values)))) else None


def bins(covariate: Covariate, most: int) -> Ints:
    """Return the bin of each sample (N,), of about equal counts.

    Few distinct values have a bin each; so has each group of values, as of a speed that was set.
    """
    distinct = np.unique(covariate.values)
    if distinct.size <= most:
        return np.searchsorted(distinct, covariate.values)
    apart = APART * float(np.ptp(distinct))
    group = clusters(distinct, apart)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    if 1 < first.size <= most and np.min(distinct[first[1:]] - distinct[first[1:] - 1]) > apart:
        return group[np.searchsorted(distinct, covariate.values)]
    edges = np.quantile(covariate.values, np.linspace(0, 1, most + 1)[1:-1])
    return np.unique(np.searchsorted(np.unique(edges), covariate.values), return_inverse=True)[1]


def missing_course(data: Observations) -> str:
    """Return why effects over time within a press cannot be seen; empty where they can."""
    if data.is_timed:
        return ""
    if data.is_curves:
        return "needs times that grow from sample to sample in every press"
    return "needs depth and force over time within a press (curves)"


def missing_times(data: Observations) -> str:
    """Return why `running_share` is not known; empty where it is."""
    timed = np.isfinite(data.time_s).all() and np.ptp(data.time_s) > 0 and data.count >= 3
    return "" if timed else "needs times of several presses"


def running_share(data: Observations) -> Floats:
    """Return the share of the rig's running time that has passed at each sample (N,), 0 to 1."""
    passed = running_s(data)
    return np.asarray(passed / passed.max())


def settling_share(data: Observations, settles: Floats | float) -> Floats:
    """Return the share (N,) of a drift over the running time that settles after the share `settles` of it.

    (1 - exp(-s/k)) / (1 - exp(-1/k)),    s the share of the running time, k = `settles`
    """
    share: Floats = np.expm1(-running_share(data) / settles) / np.expm1(-1 / settles)
    return share


def running_s(data: Observations) -> Floats:
    """Return the running time of the rig at each sample (N,), s; a longer pause counts as PAUSE_S."""
    order = np.argsort(data.time_s, kind="stable")
    passed = np.cumsum(np.minimum(np.diff(data.time_s[order], prepend=data.time_s[order[0]]), PAUSE_S))
    running = np.empty(data.size)
    running[order] = passed
    return running
