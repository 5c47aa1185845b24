"""The way that the depth took between its samples: straight in each phase, with the corners that no sample hit.

A rig that loads at one speed and then holds turns a sharp corner between two samples. Joined by a straight line
the depth would be wrong there by up to speed times the gap; drawn on from both sides, the corner is found. A ramp
so fast that one sample alone hit it goes at the speed of its press.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.data import Ints, Observations
from calibration.measured.depths import HOLD, LOAD, UNLOAD, ways
from tactilevision.records import Floats

COMING_S = 1.0  # longer than any clock is off
CORNERS = ((LOAD, HOLD), (HOLD, UNLOAD), (LOAD, UNLOAD))


def depth_at(data: Observations, later_s: float) -> Floats:
    """The depth as read (N,), at each sample's time plus `later_s`. Before a press that was caught on its way in
    the punch comes at that press's speed, after one that was left on its way out it goes on; else it stands still.
    """
    branch = ways(data)
    parts = []
    for start, end, speed in zip(data.first, [*data.first[1:], data.size], data.presses.speed_mm_s, strict=True):
        one = slice(start, end)
        time, depth = with_corners(data.time_s[one], data.depth_mm[one], branch[one], float(speed))
        if _coming(time, depth, float(speed)):
            time, depth = np.append(time[0] - COMING_S, time), np.append(depth[0] - speed * COMING_S, depth)
        if branch[end - 1] == UNLOAD and (going := _line(time[-2:], depth[-2:])) is not None:
            time, depth = np.append(time, time[-1] + COMING_S), np.append(depth, depth[-1] + going * COMING_S)
        parts.append(np.interp(data.time_s[start:end] + later_s, time, depth))
    return np.concatenate(parts)


def _coming(time_s: Floats, depth_mm: Floats, speed_mm_s: float) -> bool:
    """Whether a press begins on its way in: nearer to the speed of its loading than to rest."""
    first = _line(time_s[:2], depth_mm[:2]) if time_s.size > 1 else None
    return first is not None and np.isfinite(speed_mm_s) and first > speed_mm_s / 2 > 0


def with_corners(
    time_s: Floats, depth_mm: Floats, branch: Ints, speed_mm_s: float = np.nan
) -> tuple[Floats, Floats]:
    """Time and depth of one press with the corners between its phases put in."""
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
    before, after = (ways.get(kind) for kind in kinds)
    if k and branch[k - 1] == branch[k]:
        before = _line(time_s[k - 1 : k + 1], depth_mm[k - 1 : k + 1])
    if k + 2 < len(branch) and branch[k + 2] == branch[k + 1]:
        after = _line(time_s[k + 1 : k + 3], depth_mm[k + 1 : k + 3])
    if kinds[0] == HOLD:
        before = 0.0
    if kinds[1] == HOLD:
        after = 0.0
    if before is None or after is None or not np.isfinite(before - after) or before == after:
        return None
    gap = float(time_s[k + 1] - time_s[k])
    since = (float(depth_mm[k + 1] - depth_mm[k]) - after * gap) / (before - after)
    if not 0 < since < gap:
        return None
    return float(time_s[k]) + since, float(depth_mm[k]) + before * since


def _line(time_s: Floats, depth_mm: Floats) -> float | None:
    step = float(time_s[1] - time_s[0])
    return float(depth_mm[1] - depth_mm[0]) / step if step > 0 else None
