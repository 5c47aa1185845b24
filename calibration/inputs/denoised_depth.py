"""Depth of the punch without most of its readings' noise.

A plateau is many readings of one depth, a ramp is smooth in time, and presses whose depths differ by no more than
their zeros have one nominal depth. Sorting residuals by the depths as read would sort them by their common noise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from calibration.inputs.observations import TYPICAL_ZERO_MM, Ints, Observations
from tactilevision.records.measured import Bools, Floats
from tactilevision.robust import mad_std

LOAD, HOLD, UNLOAD, FREE = range(4)
BRANCHES = ("load", "hold", "unload", "free")
MIN_HELD = 3  # samples of a plateau
OFF_PLATEAU = 5  # std of a reading beyond which a sample is not of a plateau: some noises have far outliers
CORNER = 2.0  # std beyond which a plateau's end is of the ramp whose line it lies nearer to
LINE = 4  # samples of a ramp that determine its line
FINEST_MM = 2e-4  # mm, least std of a depth
SAME_MM = 5 * TYPICAL_ZERO_MM  # nearer depths may be one
COURSE = 4  # highest degree of a ramp's depth over time
NEARLY_ALL = 0.9  # share of a ramp's readings near its polynomial
SAMPLES_A_DEGREE = 4  # that each degree needs
AS_NEAR = 1.5  # largest rms over that of the highest degree, for a lower one to suffice
Made = TypeVar("Made")


def branches(data: Observations) -> Ints:
    """Return LOAD, HOLD, UNLOAD or FREE for each sample (N,); from the depth where no phase was recorded."""
    known = np.select([data.phase == name for name in BRANCHES], range(4), default=-1)
    if (known >= 0).all():
        return np.asarray(known, dtype=np.int64)
    found = np.full(data.size, LOAD)
    for one in data.spans:
        depth, kind = data.depth_mm[one], found[one]
        deepest = int(np.argmax(depth))
        kind[deepest + 1 :] = UNLOAD
        near = np.flatnonzero(depth > depth[deepest] - SAME_MM / 2)
        if near.size > 2:
            kind[near[0] + 1 : near[-1] + 1] = HOLD
    return np.where(known >= 0, known, found)


def unloading(data: Observations) -> Bools:
    """Return which samples (N,) are in unloading, by branch: the deepest reading of a hold is noise."""
    return np.asarray(branches(data) == UNLOAD)


def after_deepest(data: Observations) -> Bools:
    """Return which samples (N,) follow the deepest of their press."""
    after = np.zeros(data.size, dtype=bool)
    for one in data.spans:
        after[one][int(np.argmax(data.depth_mm[one])) + 1 :] = True
    return after


def ways(data: Observations) -> Ints:
    """Return the branches (N,) with limits moved to where the depth changes: phases may follow another clock.

    A depth that no longer moves at its press's speed is in air.
    """
    way, depth, noise, timed = branches(data).copy(), data.depth_mm, _reading_noise(data), data.is_timed
    for one, speed in zip(data.spans, data.presses.speed_mm_s, strict=True):
        for first, last in _runs(way[one] == HOLD):
            if last - first + 1 >= MIN_HELD:
                _fit_plateau(way[one], depth[one], first, last, noise_mm=noise)
                _fit_corners(way[one], depth[one], data.time_s[one], (first + last) // 2, noise_mm=noise)
        if speed > 0 and timed:
            on = float(speed) * (data.time_s[one] - data.time_s[one.start])
            _fit_turn(way[one], depth[one], on)
            _fit_rest(way[one], depth[one], on, UNLOAD, noise)
            _fit_rest(way[one][::-1], depth[one][::-1], on[::-1], LOAD, noise)
    return way


def _reading_noise(data: Observations) -> float:
    """Return the std of a reading, mm, from all plateaus together."""
    way, off = branches(data), [np.zeros(0)]
    for first, last in _runs((way == HOLD) & (np.diff(data.press, prepend=-1) == 0)):
        if last - first + 1 >= MIN_HELD:
            off.append(data.depth_mm[first : last + 1] - np.median(data.depth_mm[first : last + 1]))
    all_off = np.concatenate(off)
    return max(mad_std(all_off, centre=0.0), FINEST_MM) if all_off.size else FINEST_MM


def _fit_plateau(way: Ints, depth_mm: Floats, first: int, last: int, *, noise_mm: float) -> None:
    """Move the ends of the plateau first to last of one press, in place."""
    flat = np.abs(depth_mm - np.median(depth_mm[first : last + 1])) <= OFF_PLATEAU * noise_mm
    for beside, end, step in ((LOAD, first, -1), (UNLOAD, last, 1)):
        k = end + step
        while 0 <= k < way.size and way[k] == beside and flat[k]:
            way[k], k = HOLD, k + step
        k = end
        while first <= k <= last and not flat[k]:
            way[k], k = beside, k - step


def _fit_corners(way: Ints, depth_mm: Floats, time_s: Floats, inside: int, *, noise_mm: float) -> None:
    """Assign the ends of the plateau around sample `inside` to the ramps whose lines they lie nearer to, in place.

    The last sample of a fast ramp may lie as near the plateau as an outlier of it.
    """
    runs = [run for run in _runs(way == HOLD) if run[0] <= inside <= run[1]]
    for first, last in runs if np.isfinite(time_s).all() else ():
        level = np.median(depth_mm[first : last + 1])
        for beside, end, step in ((LOAD, first, -1), (UNLOAD, last, 1)):
            ramp = end + step * np.arange(1, LINE + 1)
            ramp = ramp[(ramp >= 0) & (ramp < way.size)]
            if ramp.size < LINE or (way[ramp] != beside).any() or last - first < MIN_HELD:
                continue
            on = time_s[ramp] - time_s[end]
            if np.ptp(on) == 0:
                continue
            expected = depth_mm[ramp].mean() - on.mean() * np.polyfit(on, depth_mm[ramp], 1)[0]
            off = abs(depth_mm[end] - level)
            if off > CORNER * noise_mm and off > abs(depth_mm[end] - expected):
                way[end] = beside


def _fit_turn(way: Ints, depth_mm: Floats, on_mm: Floats) -> None:
    """Move the turn of a press without a plateau to its deepest sample, in place; `on_mm` (n,): speed x time."""
    moving = np.flatnonzero(way != FREE)
    turns = np.flatnonzero(np.diff(way[moving]))
    if (way == HOLD).any() or turns.size != 1 or way[moving[0]] != LOAD:
        return
    last, top = moving[turns[0]], moving[int(np.argmax(depth_mm[moving]))]
    risen, fallen = (
        abs(depth_mm[top] - depth_mm[b] - abs(on_mm[top] - on_mm[b])) if b in moving else np.inf
        for b in (top - 1, top + 1)
    )
    beyond = depth_mm[top] - np.max(depth_mm[last : last + 2])
    uneven = abs(risen - fallen) if np.isfinite(risen + fallen) else 0.0  # next to air, or an end, it is unknown
    if max(beyond, uneven) <= SAME_MM / 2:  # within noise
        return
    way[moving] = np.where(moving < top + (risen <= fallen), LOAD, UNLOAD)


def _fit_rest(way: Ints, depth_mm: Floats, on_mm: Floats, kind: int, noise_mm: float) -> None:
    """Mark the end of a press as air, in place, where it is of this kind and stands still but should move.

    So the last sample alone, at the touch or above, where the step to it is shorter than expected.
    """
    limit = SAME_MM + OFF_PLATEAU * noise_mm  # beyond zeros and noise
    still = (way == kind) & (np.abs(depth_mm - depth_mm[-1]) <= OFF_PLATEAU * noise_mm)
    begin = int(still.size - np.argmin(still[::-1])) if not still.all() else 0
    if begin < still.size - 1 and abs(on_mm[-1] - on_mm[begin]) > limit:
        way[begin:] = FREE
    elif (way[-3:] == kind).all() and way.size > 2:
        gone, on = np.abs(np.diff(depth_mm[-3:])), np.abs(np.diff(on_mm[-3:]))
        short = gone[0] / on[0] * on[1] - gone[1] if on[0] > SAME_MM else 0.0
        if depth_mm[-1] <= SAME_MM and short > limit:
            way[-1] = FREE


def _runs(inside: Bools) -> list[tuple[int, int]]:
    """Return the first and last index of each run of True."""
    edges = np.diff(inside.astype(np.int64), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def denoised_depth(data: Observations) -> Floats:
    """Return the depth (N,) with a plateau's mean and a polynomial of each ramp; read-only."""
    return _depths(data)[0]


def nominal_depth(data: Observations) -> Floats:
    """Return the depth (N,), mm, also without the scatter of presses' zeros; read-only.

    Presses of one radius whose deepest points differ by no more than their zeros reach one depth; so do plateaus.
    """
    return _depths(data)[1]


def by_times(make: Callable[[Observations], Made]) -> Callable[[Observations], Made]:
    """Cache what `make` returns for the last data sets of other depths, times or phases, whatever their forces.

    Effects of history ask at every prediction.
    """
    kept: deque[tuple[tuple[np.ndarray, ...], Made]] = deque(maxlen=8)

    def cached(data: Observations) -> Made:
        key = (data.depth_mm, data.time_s, data.phase, data.press, data.presses.speed_mm_s)
        for known, made in kept:
            if all(a is b for a, b in zip(known, key, strict=True)):
                return made
        kept.append((key, make(data)))
        return kept[-1][1]

    return cached


@by_times
def _depths(data: Observations) -> tuple[Floats, Floats]:
    """Return both, read-only."""
    steady = _steady(data) if data.is_curves else data.depth_mm.copy()
    nominal = _nominal(data, steady)
    for table in (steady, nominal):
        table.setflags(write=False)
    return steady, nominal


def _steady(data: Observations) -> Floats:
    branch, steady = ways(data), data.depth_mm.copy()
    begins = np.flatnonzero(np.diff(branch, prepend=-1) | np.diff(data.press, prepend=-1))
    parts = [slice(b, e) for b, e in zip(begins, [*begins[1:], data.size], strict=True)]
    for part in (part for part in parts if branch[part][0] == HOLD):  # not those in air
        steady[part] = np.mean(data.depth_mm[part])
    for kind in (LOAD, UNLOAD):
        ramps = [part for part in parts if branch[part][0] == kind]
        found = [_courses(data.time_s[part], data.depth_mm[part]) for part in ramps]
        degree = _shared_degree([rms for _, rms in found])
        for part, (courses, rms) in zip(ramps, found, strict=True):
            steady[part] = _course(data.depth_mm[part], courses, rms, degree)
    return steady


def _courses(time_s: Floats, depth_mm: Floats) -> tuple[Floats, Floats]:
    """Return a ramp's polynomials in time of rising degree (k, n) and their residuals (k,), mm rms.

    None where it has too few samples.
    """
    highest = min(time_s.size // SAMPLES_A_DEGREE, COURSE)
    if not (highest and np.isfinite(time_s).all() and np.ptp(time_s) > 0):
        return np.zeros((0, time_s.size)), np.zeros(0)
    along = np.polynomial.legendre.legvander(2 * (time_s - time_s.min()) / np.ptp(time_s) - 1, highest)
    q, _ = np.linalg.qr(along)
    courses = np.cumsum(q * (q.T @ depth_mm), axis=1).T[1:]
    dof = time_s.size - np.arange(2, highest + 2)
    return courses, np.sqrt(np.sum((depth_mm - courses) ** 2, axis=1) / dof + FINEST_MM**2)


def _shared_degree(rms: Sequence[Floats]) -> int:
    """Return the lowest degree, less 1, that fits most ramps nearly as well as their highest.

    One for all: a choice for each ramp would follow its readings' noise, which is also in the residual.
    """
    known = [one for one in rms if one.size]
    for k in range(COURSE):
        if not known or np.median([one[min(k, one.size - 1)] / one[-1] for one in known]) <= AS_NEAR:
            return k
    return COURSE - 1


def _course(depth_mm: Floats, courses: Floats, rms: Floats, degree: int) -> Floats:
    """Return the polynomial (n,) of this degree, else that of least rms, else the depths as read.

    A polynomial is accepted if NEARLY_ALL of the depths lie within SAME_MM of it.
    """
    for k in (min(degree, len(courses) - 1), int(np.argmin(rms))) if len(courses) else ():
        if np.quantile(np.abs(depth_mm - courses[k]), NEARLY_ALL) < SAME_MM:
            return np.asarray(courses[k])
    return depth_mm


def _nominal(data: Observations, steady: Floats) -> Floats:
    deepest = np.maximum.reduceat(steady, data.first)
    nominal = steady + (_reached(deepest, data.presses.radius_mm) - deepest)[data.press]
    flat = np.isin(branches(data), (HOLD, FREE)) if data.is_curves else np.ones(data.size, dtype=bool)
    nominal[flat] = _alike(nominal[flat], data.radius_mm[flat])
    return np.asarray(nominal)


def _reached(deepest: Floats, radius: Floats) -> Floats:
    """Return the deepest points (M,), those of one radius within the zeros' scatter at their mean.

    A longer sequence of neighbouring depths stays as read: ramps may end anywhere.
    """
    alike = deepest.copy()
    for one in np.unique(radius):
        mine = np.flatnonzero(radius == one)
        mine = mine[np.argsort(deepest[mine], kind="stable")]
        for row in np.split(mine, np.flatnonzero(np.diff(deepest[mine]) > SAME_MM) + 1):
            if np.ptp(deepest[row]) < 2 * SAME_MM:
                alike[row] = deepest[row].mean()
    return alike


def _alike(depths: Floats, radius: Floats) -> Floats:
    """Return depths (n,), those of one radius within the zeros' scatter at their mean."""
    alike = depths.copy()
    for one in np.unique(radius):
        mine = np.flatnonzero(radius == one)
        mine = mine[np.argsort(depths[mine], kind="stable")]
        number = clusters(depths[mine], SAME_MM)
        alike[mine] = (np.bincount(number, depths[mine]) / np.bincount(number))[number]
    return alike


def clusters(values: Floats, apart: float) -> Ints:
    """Return the cluster of each of the sorted values (n,); each begins `apart` beyond the last one's first."""
    ordered = np.sort(values)
    number, start = np.zeros(values.size, dtype=np.int64), 0
    while (start := int(np.searchsorted(ordered, ordered[start] + apart, side="right"))) < values.size:
        number[start:] += 1
    return number
