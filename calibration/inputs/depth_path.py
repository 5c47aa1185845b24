"""Depth between its samples, and presses whose depth and force clocks are out of phase."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.denoised_depth import FREE, HOLD, LOAD, SAME_MM, UNLOAD, denoised_depth, ways
from calibration.inputs.observations import Ints, Observations
from tactilevision.records.measured import Floats

# The way that the depth took between its samples: straight in each phase, with the corners that no sample hit.
#
# A rig that loads at one speed and then holds turns a sharp corner between two samples. Joined by a straight line
# the depth would be wrong there by up to speed times the gap; drawn on from both sides, the corner is found. A
# ramp so fast that one sample alone hit it goes at the speed of its press.

COMING_S = 1.0  # longer than any clock is off
CORNERS = ((FREE, LOAD), (LOAD, HOLD), (HOLD, UNLOAD), (HOLD, FREE), (LOAD, UNLOAD), (UNLOAD, FREE))


@dataclass(frozen=True, slots=True)
class _Course:
    """Corners of all presses: times since each press's first sample, the presses one after the other, and depths;
    the first and the last such time of each press, and where its samples lie.
    """

    time_s: Floats
    depth_mm: Floats
    begin_s: Floats
    end_s: Floats
    samples_s: Floats


_KEPT: deque[tuple[tuple[np.ndarray, ...], _Course]] = deque(maxlen=8)


def depth_at(data: Observations, later_s: float) -> Floats:
    """The depth as read (N,), at each sample's time plus `later_s`.

    Before a press that was caught on its way in, or in the gel, the punch comes at that press's speed, after one
    that was left on its way out it goes on; else it stands still.
    """
    course, press = _course(data), data.press
    asked = np.clip(course.samples_s + later_s, course.begin_s[press], course.end_s[press])
    return np.asarray(np.interp(asked, course.time_s, course.depth_mm))


def _course(data: Observations) -> _Course:
    """Kept for the last few data sets: the fit of a clock asks again and again."""
    key = (data.depth_mm, data.time_s, data.phase, data.press, data.presses.speed_mm_s)
    for known, course in _KEPT:
        if all(a is b for a, b in zip(known, key, strict=True)):
            return course
    course = _drawn(data)
    _KEPT.append((key, course))
    return course


def _drawn(data: Observations) -> _Course:
    branch, times, depths, samples, after = ways(data), list[Floats](), list[Floats](), list[Floats](), 0.0
    for start, end, speed in zip(data.first, [*data.first[1:], data.size], data.presses.speed_mm_s, strict=True):
        one = slice(start, end)
        time, depth = with_corners(
            data.time_s[one], data.depth_mm[one], branch=branch[one], speed_mm_s=float(speed)
        )
        if _coming(time, depth, float(speed)):
            time, depth = np.append(time[0] - COMING_S, time), np.append(depth[0] - speed * COMING_S, depth)
        if (going := _leaving(time, depth, int(branch[end - 1]), float(speed))) is not None:
            time, depth = np.append(time, time[-1] + COMING_S), np.append(depth, depth[-1] + going * COMING_S)
        times.append(time - time[0] + after)
        depths.append(depth)
        samples.append(data.time_s[one] - time[0] + after)
        after = float(times[-1][-1]) + COMING_S
    ends = np.array([(time[0], time[-1]) for time in times])
    return _Course(np.concatenate(times), np.concatenate(depths), ends[:, 0], ends[:, 1], np.concatenate(samples))


def _coming(time_s: Floats, depth_mm: Floats, speed_mm_s: float) -> bool:
    """Whether a press begins on its way in: in the gel, which no press begins in, or where it goes nearer to its
    speed than to rest over what readings' noise cannot make.
    """
    if not speed_mm_s > 0:
        return False
    far = int(np.argmax(speed_mm_s * (time_s - time_s[0]) > SAME_MM))
    first = _line(time_s[[0, far]], depth_mm[[0, far]]) if far else None
    return bool(depth_mm[0] > SAME_MM or (first is not None and first > speed_mm_s / 2))


def _leaving(time_s: Floats, depth_mm: Floats, last: int, speed_mm_s: float) -> float | None:
    """The speed (mm/s, negative) of a press that was left on its way out, None where it had come to rest: in air
    it is still on its way if it goes nearer to the speed of its press than to rest.
    """
    going = _line(time_s[-2:], depth_mm[-2:]) if time_s.size > 1 else None
    on_its_way = last == UNLOAD or (last == FREE and going is not None and going < -speed_mm_s / 2 < 0)
    return going if on_its_way else None


def with_corners(
    time_s: Floats, depth_mm: Floats, *, branch: Ints, speed_mm_s: float = np.nan
) -> tuple[Floats, Floats]:
    """Time (n,) in s and depth (n,) in mm of one press, with the corners between its phases put in."""
    ways = {LOAD: speed_mm_s, UNLOAD: -speed_mm_s}
    places, times, depths = [], [], []
    for k in np.flatnonzero(np.diff(branch)):
        corner = _corner(time_s, depth_mm, branch, int(k), ways)
        if corner is not None:
            places.append(k + 1)
            times.append(corner[0])
            depths.append(corner[1])
    return np.insert(time_s, places, times), np.insert(depth_mm, places, depths)


def _corner(
    time_s: Floats, depth_mm: Floats, branch: Ints, k: int, ways: Mapping[int, float]
) -> tuple[float, float] | None:
    """Where the lines on both sides of the gap after sample k meet; None where they do not meet in it."""
    kinds = (int(branch[k]), int(branch[k + 1]))
    if kinds not in CORNERS:
        return None
    before = _speed(time_s[k::-1], depth_mm[k::-1], branch[k::-1], ways)
    after = _speed(time_s[k + 1 :], depth_mm[k + 1 :], branch[k + 1 :], ways)
    if kinds[0] in (HOLD, FREE):
        before = 0.0
    if kinds[1] in (HOLD, FREE):
        after = ways[UNLOAD] if kinds[0] == HOLD else 0.0  # a way out that no sample hit ends at the next one
    if before is None or after is None or not np.isfinite(before - after) or before == after:
        return None
    gap = float(time_s[k + 1] - time_s[k])
    since = (float(depth_mm[k + 1] - depth_mm[k]) - after * gap) / (before - after)
    if not 0 < since < gap:
        return None
    return float(time_s[k]) + since, float(depth_mm[k]) + before * since


def _speed(time_s: Floats, depth_mm: Floats, branch: Ints, ways: Mapping[int, float]) -> float | None:
    """How fast a phase goes at its first sample, mm/s: along the line to the nearest of its samples that lies
    farther off than noise puts it, else at its press's speed.
    """
    own = branch.size if (branch == branch[0]).all() else int(np.argmax(branch != branch[0]))
    far = np.flatnonzero(np.abs(depth_mm[:own] - depth_mm[0]) > SAME_MM)
    return _line(time_s[[0, far[0]]], depth_mm[[0, far[0]]]) if far.size else ways.get(int(branch[0]))


def _line(time_s: Floats, depth_mm: Floats) -> float | None:
    step = float(time_s[1] - time_s[0])
    return float(depth_mm[1] - depth_mm[0]) / step if step else None


# Which presses the clocks of depth and force put out of phase, told before any law is fitted.

GRID_S = np.arange(-20, 21) / 100  # s: clocks that somebody has set lie no farther apart
MIN_GAIN = 2.0  # times less of the force is left at another offset than at none; 7 and more of 20, else 1.0 of 16
MISSED = 0.1  # of one radius' squared force, left at none; the search itself finds a clock that leaves less
MIN_SAMPLES = 20  # of a radius: of fewer a cubic at the best of all offsets leaves too little of mere noise
MAX_RAMP_SHARE = 0.5  # of a ramp: an offset that is longer leaves too little of its course


def in_phase(data: Observations) -> Observations:
    """Without the presses that clocks far apart put out of phase, where most are left; a warning says how far.

    A ramp that is over before the other clock sees it begin has no course of its own: the slow ones tell the
    clocks apart. Points, and curves without times, are handed back as they are.
    """
    if not data.is_curves or not np.isfinite(data.time_s).all():
        return data
    if not (offset := offset_by_phase(data)):
        return data
    deepest = np.maximum.reduceat(data.depth_mm, data.first)
    speed = np.nan_to_num(data.presses.speed_mm_s)
    out = (deepest > 0) & (speed * abs(offset) > MAX_RAMP_SHARE * deepest)
    at_least = "at least" if abs(offset) >= GRID_S[-1] else "some"
    said = f"the clocks of depth and force lie {at_least} {1e3 * abs(offset):.0f} ms apart"
    if 0 < np.count_nonzero(out) < data.count / 2:
        names = ", ".join(np.array(data.presses.label)[out])
        data, said = data.take(~out), f"{said}: left out are presses that go in within twice that time ({names})"
    return replace(data, warnings=(*data.warnings, f"{said}. Set the clocks right"))


def with_one_clock(data: Observations) -> Observations:
    """With the depths of the moments of the forces, by the offset that their phase tells; no law takes them."""
    if not data.is_curves or not np.isfinite(data.time_s).all() or not (offset := offset_by_phase(data)):
        return data
    steady = replace(data, depth_mm=denoised_depth(data))
    return replace(data, depth_mm=data.depth_mm + depth_at(steady, -offset) - steady.depth_mm)


def offset_by_phase(data: Observations) -> float:
    """The offset (s), of a grid, at which depths and forces come into phase; 0 unless they are far out of it.

    What a cubic of the depth through 0 leaves of each radius' force, at each offset: no law's detail is in it. It
    is told by the radii that much less is left of; of all forces together no more may be left there than at none.
    """
    steady = replace(data, depth_mm=denoised_depth(data))
    left = np.array([_left_of_force(steady, np.maximum(depth_at(steady, -offset), 0.0)) for offset in GRID_S])
    radii, which = np.unique(data.radius_mm, return_inverse=True)
    squares = np.maximum(np.bincount(which, data.normal_N**2, minlength=radii.size), 1e-300)
    share, none = left / squares, left[GRID_S.size // 2] / squares
    tell = (np.bincount(which) >= MIN_SAMPLES) & (none > np.maximum(MIN_GAIN * share.min(axis=0), MISSED))
    if not tell.any():
        return 0.0
    # told by shares: a wide punch's force would hide a narrow one's
    no_more = left.sum(axis=1) <= left[GRID_S.size // 2].sum()
    told = np.where(no_more, share[:, tell].sum(axis=1), np.inf)
    return float(GRID_S[int(np.argmin(told))])


def _left_of_force(data: Observations, depth_mm: Floats) -> Floats:
    """What a cubic of depths (N,) in mm leaves of each radius' squared force (q,), N^2."""
    left = []
    for radius in np.unique(data.radius_mm):
        mine = data.radius_mm == radius
        powers, force = depth_mm[mine, None] ** [1, 2, 3], data.normal_N[mine]
        error = force - powers @ np.linalg.lstsq(powers, force, rcond=None)[0]
        left.append(float(np.sum(error**2)))
    return np.array(left)
