"""When the touch happened on either clock, and whether the rig stood still there.

The touch is found as a depth (touch.py); the force, read 200 times a second, tells when that depth was
reached. Times in s, forces in N, depths in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.certificate.force.event_force import EventForce, force_in_dwell, force_on_ramp
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.records import ForceSeries, Pair

_NEAR_S = 0.1  # s about the crossing over which the force is a line


@dataclass(frozen=True, slots=True)
class ForceCrossing:
    """When the force first reached a level: F/T clock, std from the level's own, rate; the dwell there, if
    any.
    """

    time_s: float
    std_s: float
    rate_N_s: float
    dwell_s: Pair | None


def force_crossing(window: ForceWindow, level_N: float, *, level_std_N: float) -> ForceCrossing | None:
    """First passage of the driving force through a level on the way in; None where it never gets there."""
    phases = window.phases
    if phases is None or not level_N > 0:
        return None
    time, force, ramp = window.time_s, window.drive_N, max(window.ramp_N_s, 1e-9)
    first, last = phases.onset, phases.release
    tolerance = max(2 * level_std_N, 3 * phases.noise)
    for start, end in window.dwells:
        if start < phases.hold and abs(force[start] - level_N) <= tolerance:
            edge = (end - start) // 10
            span = (float(time[start + edge]), float(time[end - edge]))
            arrival_std = float(window.time_s[1] - window.time_s[0]) + phases.noise / ramp
            return ForceCrossing(float(time[start]), arrival_std, ramp, span)
    above = np.flatnonzero(force[first : last + 1] >= level_N)
    if not above.size:
        return None
    place = first + int(above[0])
    near = np.flatnonzero(np.abs(time - time[place]) <= _NEAR_S)
    near = near[(near >= first) & (near <= max(phases.hold, place))]
    for start, end in window.dwells:
        near = near[(near < start) | (near > end)] if not start <= place <= end else near
    if near.size < 8:
        return ForceCrossing(float(time[place]), level_std_N / ramp, ramp, None)
    readings = window.force_N[near, 2] + (force - window.smooth_N)[near]
    rate, value = np.polyfit(time[near] - time[place], readings, 1)
    rate = max(float(rate), 0.2 * ramp)
    at = float(time[place]) + (level_N - float(value)) / rate
    return ForceCrossing(at, level_std_N / rate, rate, None)


def event_force(window: ForceWindow, forces: ForceSeries, *, crossed: ForceCrossing) -> EventForce | None:
    """Force at the event: mean in the dwell, else the one-sided fit up to the touch."""
    assert window.phases is not None
    if crossed.dwell_s is not None:
        return force_in_dwell(window.time_s, window.force_N, dwell_s=crossed.dwell_s, event_s=crossed.time_s)
    onset = float(window.time_s[window.phases.onset])
    return force_on_ramp(
        window.time_s, window.force_N, np.asarray(forces.std_N), onset_s=onset, touch_s=crossed.time_s
    )
