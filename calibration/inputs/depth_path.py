"""Depth between its samples, and presses whose depth and force clocks are out of phase."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibration.inputs.denoised_depth import (
    FREE,
    HOLD,
    LOAD,
    SAME_MM,
    UNLOAD,
    branches,
    by_times,
    denoised_depth,
    ways,
)
from calibration.inputs.observations import Ints, Observations
from tactilevision.records.constants import KILO, NONZERO
from tactilevision.records.measured import Floats

COMING_S = 1.0  # s, longer than any clock offset
CORNERS = ((FREE, LOAD), (LOAD, HOLD), (HOLD, UNLOAD), (HOLD, FREE), (LOAD, UNLOAD), (UNLOAD, FREE))


def depth_at(data: Observations, later_s: Floats | float) -> Floats:
    """Return the depth (N,) at each sample's time plus `later_s`.

    The depth is linear in each phase, with corners between the samples where two phases meet: linear interpolation
    of the samples would be wrong there by up to speed times the gap. Outside the samples the punch moves on at the
    press's speed where the press begins on its way in or ends on its way out; else it stands still.
    """
    time_s, depth_mm, samples_s, (begin_s, end_s) = _course(data)
    asked = np.clip(samples_s + later_s, begin_s[data.press], end_s[data.press])
    return np.asarray(np.interp(asked, time_s, depth_mm))


def rate_at(data: Observations, later_s: Floats | float) -> Floats:
    """Return the rate of `depth_at` (N,), mm/s; 0 before and after the press moves."""
    time_s, depth_mm, samples_s, (begin_s, end_s) = _course(data)
    asked = samples_s + later_s
    place = np.clip(np.searchsorted(time_s, asked, side="right"), 1, time_s.size - 1)
    rate = (depth_mm[place] - depth_mm[place - 1]) / np.maximum(time_s[place] - time_s[place - 1], NONZERO)
    return np.where((asked > begin_s[data.press]) & (asked < end_s[data.press]), rate, 0.0)


@by_times
def _course(data: Observations) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the piecewise linear depth of all presses, one after the other.

    Times and depths of corners and samples (k,), times of the samples (N,), and the first and the last time of
    each press (2, M).
    """
    branch, times, depths, samples, after = ways(data), list[Floats](), list[Floats](), list[Floats](), 0.0
    for one, speed in zip(data.spans, data.presses.speed_mm_s, strict=True):
        time, depth = with_corners(
            data.time_s[one], data.depth_mm[one], branch=branch[one], speed_mm_s=float(speed)
        )
        if _coming(time, depth, float(speed)):
            time, depth = np.append(time[0] - COMING_S, time), np.append(depth[0] - speed * COMING_S, depth)
        if (going := _leaving(time, depth, int(branch[one][-1]), float(speed))) is not None:
            time, depth = np.append(time, time[-1] + COMING_S), np.append(depth, depth[-1] + going * COMING_S)
        times.append(time - time[0] + after)
        depths.append(depth)
        samples.append(data.time_s[one] - time[0] + after)
        after = float(times[-1][-1]) + COMING_S
    ends = np.array([(time[0], time[-1]) for time in times]).T
    return np.concatenate(times), np.concatenate(depths), np.concatenate(samples), ends


def _coming(time_s: Floats, depth_mm: Floats, speed_mm_s: float) -> bool:
    """Return whether a press begins on its way in: in the gel, or at more than half its speed beyond noise."""
    if not speed_mm_s > 0:
        return False
    far = int(np.argmax(speed_mm_s * (time_s - time_s[0]) > SAME_MM))
    first = _line(time_s[[0, far]], depth_mm[[0, far]]) if far else None
    return bool(depth_mm[0] > SAME_MM or (first is not None and first > speed_mm_s / 2))


def _leaving(time_s: Floats, depth_mm: Floats, last: int, speed_mm_s: float) -> float | None:
    """Return the speed (mm/s, negative) of a press that ends on its way out; None where it has come to rest.

    In air it still moves if it goes at more than half the press's speed.
    """
    going = _line(time_s[-2:], depth_mm[-2:]) if time_s.size > 1 else None
    on_its_way = last == UNLOAD or (last == FREE and going is not None and going < -speed_mm_s / 2 < 0)
    return going if on_its_way else None


def with_corners(
    time_s: Floats, depth_mm: Floats, *, branch: Ints, speed_mm_s: float = np.nan
) -> tuple[Floats, Floats]:
    """Return time (n,) in s and depth (n,) in mm of one press with the corners between its phases inserted."""
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
    """Return where the lines on both sides of the gap after sample k meet; None where they do not meet in it."""
    kinds = (int(branch[k]), int(branch[k + 1]))
    if kinds not in CORNERS:
        return None
    before = _speed(time_s[k::-1], depth_mm[k::-1], branch[k::-1], ways)
    after = _speed(time_s[k + 1 :], depth_mm[k + 1 :], branch[k + 1 :], ways)
    if kinds[0] in (HOLD, FREE):
        before = 0.0
    if kinds[1] in (HOLD, FREE):
        after = ways[UNLOAD] if kinds[0] == HOLD else 0.0  # unloading without a sample ends at the next one
    if before is None or after is None or not np.isfinite(before - after) or before == after:
        return None
    gap = float(time_s[k + 1] - time_s[k])
    since = (float(depth_mm[k + 1] - depth_mm[k]) - after * gap) / (before - after)
    if not 0 < since < gap:
        return None
    return float(time_s[k]) + since, float(depth_mm[k]) + before * since


def _speed(time_s: Floats, depth_mm: Floats, branch: Ints, ways: Mapping[int, float]) -> float | None:
    """Return the speed of a phase at its first sample, mm/s, else its press's speed.

    From the line to the nearest of its samples that is farther away than noise explains.
    """
    own = branch.size if (branch == branch[0]).all() else int(np.argmax(branch != branch[0]))
    far = np.flatnonzero(np.abs(depth_mm[:own] - depth_mm[0]) > SAME_MM)
    return _line(time_s[[0, far[0]]], depth_mm[[0, far[0]]]) if far.size else ways.get(int(branch[0]))


def _line(time_s: Floats, depth_mm: Floats) -> float | None:
    step = float(time_s[1] - time_s[0])
    return float(depth_mm[1] - depth_mm[0]) / step if step else None


GRID_S = np.arange(-20, 21) / 100  # s, clock offsets tried
MIN_GAIN = 2.0  # least ratio of residuals at no offset and at another; 7 and more where clocks differ, else 1.0
MISSED = 0.1  # least residual at no offset, of one radius' squared force; a fit finds the offset of smaller ones
MIN_SAMPLES = 20  # of a radius: of fewer a cubic at the best of all offsets fits noise
MAX_RAMP_SHARE = 0.5  # longest usable offset over the duration of a ramp


def in_phase(data: Observations) -> Observations:
    """Return the data without presses whose ramps are too short for the clock offset, unless these are most.

    A warning names the hysteresis and what may cause it. Points, and curves without times, are returned unchanged.
    """
    if not (offset := offset_by_phase(data)):
        return data
    deepest = np.maximum.reduceat(data.depth_mm, data.first)
    speed = np.nan_to_num(data.presses.speed_mm_s)
    out = (deepest > 0) & (speed * abs(offset) > MAX_RAMP_SHARE * deepest)
    at_least = "at least" if abs(offset) >= GRID_S[-1] else "about"
    gap_N, largest_N = _hysteresis_N(data), float(np.max(np.abs(data.normal_N)))
    said = (
        f"loading and unloading differ by {KILO * gap_N:.3g} mN ({100 * gap_N / largest_N:.2g} % of the largest "
        f"force), as relaxation, drag or adhesion, or clocks of depth and force {at_least} "
        f"{KILO * abs(offset):.0f} ms apart, would make them"
    )
    if 0 < np.count_nonzero(out) < data.count / 2:
        names = ", ".join(np.array(data.presses.label)[out])
        data, said = data.take(~out), f"{said}; presses that load within twice that time are excluded ({names})"
    return data.warned(f"{said}. A fit lies between the two")


def _hysteresis_N(data: Observations) -> float:
    """Return the median over presses of the largest difference of force, N, between loading and unloading."""
    found, branch = [0.0], branches(data)
    for one in data.spans:
        depth, force = data.depth_mm[one], data.normal_N[one]
        load, unload = (branch[one] == kind for kind in (LOAD, UNLOAD))
        if load.sum() > 1 and unload.any():
            along = np.argsort(depth[load], kind="stable")
            between = unload & (depth >= depth[load].min()) & (depth <= depth[load].max())
            expected = np.interp(depth[between], depth[load][along], force[load][along])
            found.append(float(np.abs(force[between] - expected).max(initial=0.0)))
    return float(np.median(found[1:] or found))


def with_one_clock(data: Observations) -> Observations:
    """Return the data with depths at the times of the forces, by the offset of their phases; for checks only."""
    if not (offset := offset_by_phase(data)):
        return data
    steady = replace(data, depth_mm=denoised_depth(data))
    return replace(data, depth_mm=data.depth_mm + depth_at(steady, -offset) - steady.depth_mm)


def offset_by_phase(data: Observations) -> float:
    """Return the offset (s), of a grid, at which depths and forces are in phase; 0 unless they are far out of it.

    0 also for points, and for curves without times.

    At each offset a cubic of the depth through 0 is fitted to each radius' force, independent of any law. The
    offset is chosen by the radii whose residual falls most, and the residual of all forces together must not grow.
    """
    if not data.is_timed:
        return 0.0
    steady = replace(data, depth_mm=denoised_depth(data))
    residual = np.array([_residual_of_cubic(steady, np.maximum(depth_at(steady, -o), 0.0)) for o in GRID_S])
    _, which = np.unique(data.radius_mm, return_inverse=True)
    share = residual / np.maximum(np.bincount(which, data.normal_N**2), NONZERO)  # a wide punch has larger forces
    now = GRID_S.size // 2
    decide = (np.bincount(which) >= MIN_SAMPLES) & (share[now] > np.maximum(MIN_GAIN * share.min(axis=0), MISSED))
    if not decide.any():
        return 0.0
    allowed = residual.sum(axis=1) <= residual[now].sum()
    return float(GRID_S[int(np.argmin(np.where(allowed, share[:, decide].sum(axis=1), np.inf)))])


def _residual_of_cubic(data: Observations, depth_mm: Floats) -> Floats:
    """Return the squared residual (q,), N^2, of a cubic of depths (N,) in mm through 0, for each radius."""
    squares = []
    for radius in np.unique(data.radius_mm):
        mine = data.radius_mm == radius
        powers, force = depth_mm[mine, None] ** [1, 2, 3], data.normal_N[mine]
        error = force - powers @ np.linalg.lstsq(powers, force, rcond=None)[0]
        squares.append(float(error @ error))
    return np.array(squares)
