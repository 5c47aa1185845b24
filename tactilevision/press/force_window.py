"""The force of one press: its readings, tared, with their phases, and what it was when each frame was taken.

Times on the F/T sensor's clock, forces in N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.press.phases import Phases, find_phases
from tactilevision.press.tare import Tare, find_tare
from tactilevision.press.watch import Watch
from tactilevision.records import Floats, ForceSeries, Pair

_SMOOTH = 9  # readings: 45 ms at 200 Hz, a tenth of the shortest ramp worth certifying


@dataclass(frozen=True, slots=True, eq=False)
class ForceWindow:
    """`time_s` (T,), tared `force_N` (T, 3), smoothed normal force `smooth_N` (T,), its phases (None: no
    contact).
    """

    time_s: Floats
    force_N: Floats
    smooth_N: Floats
    tare: Tare
    phases: Phases | None

    def at(self, time_s: Floats) -> Floats:
        """Smoothed normal force (N,) at times (N,), NaN outside the readings."""
        return np.interp(time_s, self.time_s, self.smooth_N, left=np.nan, right=np.nan)


def force_window(forces: ForceSeries, watch: Watch, *, free_s: Pair, offset_s: float) -> ForceWindow | None:
    """Readings of one press. `free_s` (camera clock) reaches from the press before to the one after it."""
    first, last = free_s[0] + offset_s, free_s[1] + offset_s
    inside = (forces.time_s >= first) & (forces.time_s <= last)
    if inside.sum() < 10:
        return None
    time, raw = forces.time_s[inside], forces.force_N[inside]
    rough = _smooth(raw[:, 2] - _floor(raw[:, 2]))
    contact = find_phases(rough)
    if contact is not None:
        gap = 3 * _SMOOTH
        span = (float(time[max(contact.onset - gap, 0)]), float(time[min(contact.end + gap, time.size - 1)]))
    else:
        span = (watch.press.start_s + offset_s, watch.press.end_s + offset_s)
    tare = find_tare(forces, span, free_s=(first, last))
    tared = raw - tare.at(time)
    smooth = _smooth(tared[:, 2])
    return ForceWindow(time, tared, smooth, tare, find_phases(smooth))


def _floor(force: Floats) -> float:
    """Level of the free gel: the median of the lowest fifth."""
    known = force[np.isfinite(force)]
    return float(np.median(known[known <= np.quantile(known, 0.2)])) if known.size else 0.0


def _smooth(force: Floats) -> Floats:
    half = min(_SMOOTH, max(force.size // 4, 1)) // 2
    if half == 0:
        return force
    good = np.flatnonzero(np.isfinite(force))
    known = np.interp(np.arange(force.size), good, force[good])
    padded = np.pad(known, half, mode="edge")
    return np.asarray(np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid"))
