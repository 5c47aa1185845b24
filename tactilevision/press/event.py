"""When the touch happened on either clock, and whether the rig stood still there.

The touch is found as a depth (touch.py); the force, read 200 times a second, tells when that depth was
reached. Times in s, forces in N, depths in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.press.event_force import EventForce, force_in_dwell, force_on_ramp
from tactilevision.press.force_window import ForceWindow
from tactilevision.records import Floats, ForceSeries, Pair

_NEAR_S = 0.1
_DWELL_S = 0.15  # shorter pauses hold too few readings for a mean


@dataclass(frozen=True, slots=True)
class Crossing:
    """When the force first reached a level: F/T clock, std from the level's own, rate; the dwell there, if
    any.
    """

    time_s: float
    std_s: float
    rate_N_s: float
    dwell_s: Pair | None


def crossing(window: ForceWindow, level_N: float, level_std_N: float) -> Crossing | None:
    """First passage of the normal force through a level on the way in; None where it never gets there."""
    phases = window.phases
    if phases is None or not level_N > 0:
        return None
    time, force = window.time_s, window.smooth_N
    first, last = phases.onset, phases.release
    above = np.flatnonzero(force[first : last + 1] >= level_N)
    if not above.size:
        return None
    place = first + int(above[0])
    ramp = _ramp_rate(window)
    dwell = _dwell(window, level_N, max(2 * level_std_N, 3 * phases.noise), ramp)
    near = np.flatnonzero(np.abs(time - time[place]) <= _NEAR_S)
    near = near[(near >= first) & (near <= max(phases.hold, place))]
    if dwell is not None or near.size < 8:
        return Crossing(float(time[place]), level_std_N / max(ramp, 1e-9), ramp, dwell)
    rate, value = np.polyfit(time[near] - time[place], window.force_N[near, 2], 1)
    rate = max(float(rate), 0.2 * ramp)
    at = float(time[place]) + (level_N - float(value)) / rate
    return Crossing(at, level_std_N / rate, rate, None)


def _ramp_rate(window: ForceWindow) -> float:
    """Typical rate of the normal force while it grows."""
    assert window.phases is not None
    load = slice(window.phases.onset, max(window.phases.hold, window.phases.onset + 2) + 1)
    time, force = window.time_s[load], window.smooth_N[load]
    step = max(int(0.05 * time.size), 1)
    rates = (force[step:] - force[:-step]) / np.maximum(time[step:] - time[:-step], 1e-9)
    growing = rates[rates > 0.25 * rates.max()] if rates.size else rates
    return float(np.median(growing)) if growing.size else 1e-9


def _dwell(window: ForceWindow, level_N: float, tolerance_N: float, ramp_N_s: float) -> Pair | None:
    """The time during which the force stays at a level much longer than the ramp would take past it."""
    assert window.phases is not None
    load = slice(window.phases.onset, window.phases.release + 1)
    time = window.time_s[load]
    inside = np.flatnonzero(np.abs(window.smooth_N[load] - level_N) <= tolerance_N)
    if inside.size < 3:
        return None
    span = float(time[inside[-1]] - time[inside[0]])
    if span < max(_DWELL_S, 4 * 2 * tolerance_N / ramp_N_s):
        return None
    edge = 0.1 * span
    return float(time[inside[0]]) + edge, float(time[inside[-1]]) - edge


def event_force(window: ForceWindow, forces: ForceSeries, crossed: Crossing) -> EventForce | None:
    """Force at the event: mean in the dwell, else the one-sided fit up to the touch."""
    assert window.phases is not None
    if crossed.dwell_s is not None:
        return force_in_dwell(window.time_s, window.force_N, crossed.dwell_s, event_s=crossed.time_s)
    onset = float(window.time_s[window.phases.onset])
    return force_on_ramp(
        window.time_s, window.force_N, np.asarray(forces.std_N), onset_s=onset, touch_s=crossed.time_s
    )


def touch_speed(time_s: Floats, depth_mm: Floats, event_s: float) -> float:
    """Speed of the face about an event, from depths (N,) at times (N,)."""
    near = np.isfinite(depth_mm) & (np.abs(time_s - event_s) <= 0.25)
    if near.sum() < 4 or np.ptp(time_s[near]) <= 0:
        return float("nan")
    return float(np.polyfit(time_s[near] - event_s, depth_mm[near], 1)[0])
