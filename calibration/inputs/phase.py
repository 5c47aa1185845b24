"""Which presses the clocks of depth and force put out of phase, told before any law is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.inputs.denoised_depth import denoised_depth
from calibration.inputs.depth_path import depth_at
from calibration.inputs.observations import Observations
from tactilevision.records import Floats

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
