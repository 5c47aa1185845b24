"""How deep the punch was, without the noise of what was read.

A plateau is many readings of one depth, a ramp a smooth course, and presses that go equally deep but for their own
zeros go equally deep: sorted, compared or remembered by what was read, residuals would be sorted by that noise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from calibration.inputs.observations import Ints, Observations
from tactilevision.records.measured import Bools, Floats
from tactilevision.robust import mad_std

LOAD, HOLD, UNLOAD, FREE = range(4)
BRANCHES = ("load", "hold", "unload", "free")
MIN_HELD = 3  # samples of a plateau; fewer have no median of their own
BESIDE = (
    5.0  # std of a reading that a sample lies off a plateau's depth which is none of it: some have far outliers
)
CORNER = 2.0  # of these std that a sample lies off a plateau whose neighbours on the ramp it continues
LINE = 4  # samples of a ramp that tell where it goes on
FINEST_MM = 2e-4  # mm, std of a depth that is read very well
SAME_MM = 0.02  # five press zeros: depths nearer than this may be one
COURSE = 4  # highest degree of a ramp's depth over time
NEARLY_ALL = 0.9  # share of a ramp's readings that lie near its course: some noises have far outliers
SAMPLES_A_DEGREE = 4  # that each degree of it needs
AS_NEAR = 1.5  # times the rms of the highest: what a lower degree leaves of the course is then readings' noise
_KEPT: deque[tuple[tuple[np.ndarray, ...], Floats, Floats]] = deque(maxlen=8)


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
        near = np.flatnonzero(depth > depth[deepest] - SAME_MM / 2)  # no finer, or readings' noise would sort them
        if near.size > 2:
            found[start + near[0] + 1 : start + near[-1] + 1] = HOLD
    return np.where(known >= 0, known, found)


def after_deepest(data: Observations) -> Bools:
    """Samples (N,) after the deepest of their press."""
    after = np.zeros(data.size, dtype=bool)
    for start, end in zip(data.first, [*data.first[1:], data.size], strict=True):
        after[start + int(np.argmax(data.depth_mm[start:end])) + 1 : end] = True
    return after


def ways(data: Observations) -> Ints:
    """The same (N,), but that a phase begins and ends where the depth does: phases go by one clock, and depths may
    by another. A depth that no longer moves at its press's speed is air.
    """
    way, depth, noise = branches(data).copy(), data.depth_mm, _reading_noise(data)
    ends = [*data.first[1:], data.size]
    for begin, end, speed in zip(data.first, ends, data.presses.speed_mm_s, strict=True):
        one = slice(int(begin), int(end))
        for first, last in _runs(way[one] == HOLD):
            if last - first + 1 >= MIN_HELD:
                _fit_plateau(way[one], depth[one], first, last, noise_mm=noise)
                _fit_corners(way[one], depth[one], data.time_s[one], (first + last) // 2, noise_mm=noise)
        if speed > 0 and data.is_curves:
            on = float(speed) * (data.time_s[one] - data.time_s[int(begin)])
            _fit_turn(way[one], depth[one], on)
            _fit_rest(way[one], depth[one], on, UNLOAD, noise)
            _fit_rest(way[one][::-1], depth[one][::-1], on[::-1], LOAD, noise)
    return way


def _reading_noise(data: Observations) -> float:
    """Std of a reading, mm, from all plateaus: one alone has too few to tell."""
    way, off = branches(data), [np.zeros(0)]
    for first, last in _runs((way == HOLD) & (np.diff(data.press, prepend=-1) == 0)):
        if last - first + 1 >= MIN_HELD:
            off.append(data.depth_mm[first : last + 1] - np.median(data.depth_mm[first : last + 1]))
    all_off = np.concatenate(off)
    return max(mad_std(all_off, centre=0.0), FINEST_MM) if all_off.size else FINEST_MM


def _fit_plateau(way: Ints, depth_mm: Floats, first: int, last: int, *, noise_mm: float) -> None:
    """Move the ends of the plateau first to last of one press, in place."""
    flat = np.abs(depth_mm - np.median(depth_mm[first : last + 1])) <= BESIDE * noise_mm
    for beside, end, step in ((LOAD, first, -1), (UNLOAD, last, 1)):
        k = end + step
        while 0 <= k < way.size and way[k] == beside and flat[k]:
            way[k], k = HOLD, k + step
        k = end
        while first <= k <= last and not flat[k]:
            way[k], k = beside, k - step


def _fit_corners(way: Ints, depth_mm: Floats, time_s: Floats, inside: int, *, noise_mm: float) -> None:
    """Give the samples at the ends of the plateau round sample `inside` to the ramps whose lines they lie nearer
    to, in place: a fast one has its last sample so near the plateau that an outlier of that could lie there.
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
            expected = depth_mm[ramp].mean() - on.mean() * np.polyfit(on, depth_mm[ramp], 1)[0]
            off = abs(depth_mm[end] - level)
            if off > CORNER * noise_mm and off > abs(depth_mm[end] - expected):
                way[end] = beside


def _fit_turn(way: Ints, depth_mm: Floats, on_mm: Floats) -> None:
    """Let a press without a plateau turn where it is deepest, in place; `on_mm` (n,): time at its speed."""
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
    uneven = abs(risen - fallen) if np.isfinite(risen + fallen) else 0.0  # beside air, or an end, nothing is told
    if max(beyond, uneven) <= SAME_MM / 2:  # noise parts them as well
        return
    way[moving] = np.where(moving < top + (risen <= fallen), LOAD, UNLOAD)


def _fit_rest(way: Ints, depth_mm: Floats, on_mm: Floats, kind: int, noise_mm: float) -> None:
    """Take the end of a press for air, in place, where it is of this kind and stands still but should move; so the
    last sample alone, at the touch or above, where the way to it is shorter than the one before lets expect.
    """
    told = SAME_MM + BESIDE * noise_mm  # neither a zero nor noise makes so much
    still = (way == kind) & (np.abs(depth_mm - depth_mm[-1]) <= BESIDE * noise_mm)
    begin = int(still.size - np.argmin(still[::-1])) if not still.all() else 0
    if begin < still.size - 1 and abs(on_mm[-1] - on_mm[begin]) > told:
        way[begin:] = FREE
    elif (way[-3:] == kind).all() and way.size > 2:
        gone, on = np.abs(np.diff(depth_mm[-3:])), np.abs(np.diff(on_mm[-3:]))
        short = gone[0] / on[0] * on[1] - gone[1] if on[0] > SAME_MM else 0.0
        if depth_mm[-1] <= SAME_MM and short > told:
            way[-1] = FREE


def _runs(inside: Bools) -> list[tuple[int, int]]:
    """First and last index of each stretch of True."""
    edges = np.diff(inside.astype(np.int64), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def denoised_depth(data: Observations) -> Floats:
    """Depth (N,) without most of its readings' noise: a plateau's mean, a smooth course of the others.

    Not to be written to.
    """
    return _depths(data)[0]


def nominal_depth(data: Observations) -> Floats:
    """Depth (N,), mm, without presses' own zeros as far as equal depths show them.

    Presses of one radius whose deepest points their zeros alone may part reach one depth; so do plateaus.

    Not to be written to.
    """
    return _depths(data)[1]


def _depths(data: Observations) -> tuple[Floats, Floats]:
    """Both, kept for the last few data sets, since every prediction of an effect that remembers asks again."""
    key = (data.depth_mm, data.time_s, data.phase, data.press, data.presses.speed_mm_s)
    for known, steady, nominal in _KEPT:
        if all(a is b for a, b in zip(known, key, strict=True)):
            return steady, nominal
    steady = _steady(data) if data.is_curves else data.depth_mm.copy()
    nominal = _nominal(data, steady)
    for table in (steady, nominal):
        table.setflags(write=False)
    _KEPT.append((key, steady, nominal))
    return steady, nominal


def _steady(data: Observations) -> Floats:
    branch, steady = ways(data), data.depth_mm.copy()
    begins = np.flatnonzero(np.diff(branch, prepend=-1) | np.diff(data.press, prepend=-1))
    parts = [slice(b, e) for b, e in zip(begins, [*begins[1:], data.size], strict=True)]
    for part in (part for part in parts if branch[part][0] == HOLD):  # air may come and go as it likes
        steady[part] = np.mean(data.depth_mm[part])
    for kind in (LOAD, UNLOAD):
        ramps = [part for part in parts if branch[part][0] == kind]
        found = [_courses(data.time_s[part], data.depth_mm[part]) for part in ramps]
        degree = _shared_degree([rms for _, rms in found])
        for part, (courses, rms) in zip(ramps, found, strict=True):
            steady[part] = _course(data.depth_mm[part], courses, rms, degree)
    return steady


def _courses(time_s: Floats, depth_mm: Floats) -> tuple[Floats, Floats]:
    """A ramp's polynomials in time of rising degree (k, n), and how far depths lie off each (k,), mm rms; none
    where it has too few samples.
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
    """The lowest degree, less 1, whose course leaves most ramps little more than their highest does.

    One for all: each ramp's own choice would follow its readings' noise, which is in the residual too, and more so
    where neighbours are alike.
    """
    told = [one for one in rms if one.size]
    for k in range(COURSE):
        if not told or np.median([one[min(k, one.size - 1)] / one[-1] for one in told]) <= AS_NEAR:
            return k
    return COURSE - 1


def _course(depth_mm: Floats, courses: Floats, rms: Floats, degree: int) -> Floats:
    """The course (n,) of this degree; where more than a tenth of the depths lie farther from it than readings
    scatter, that of least rms, or depths as read.
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
    """Deepest points (M,) at the mean of those of their radius that zeros alone may part.

    Ramps that are read at any moment end anywhere: depths that follow each other over more than zeros do are none.
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
    """Depths (n,) at the mean of those of their radius that zeros alone may part."""
    alike = depths.copy()
    for one in np.unique(radius):
        mine = np.flatnonzero(radius == one)
        mine = mine[np.argsort(depths[mine], kind="stable")]
        number = clusters(depths[mine], SAME_MM)
        alike[mine] = (np.bincount(number, depths[mine]) / np.bincount(number))[number]
    return alike


def clusters(values: Floats, apart: float) -> Ints:
    """Which cluster each of the values (n,), sorted, belongs to: one begins where the last one's first is `apart`
    away, so that the readings of a ramp, however near each other, are no cluster.
    """
    ordered = np.sort(values)
    number, start = np.zeros(values.size, dtype=np.int64), 0
    while (start := int(np.searchsorted(ordered, ordered[start] + apart, side="right"))) < values.size:
        number[start:] += 1
    return number
