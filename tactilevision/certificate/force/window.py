"""The force of one press: its readings, tared, with their phases, and what it was when each frame was taken.

Times on the F/T sensor's clock, forces in N.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactilevision.certificate.force.phases import Phases, find_phases, noise_of
from tactilevision.certificate.force.tare import Tare, find_tare
from tactilevision.records import Bools, Floats, ForceSeries, Pair, Press
from tactilevision.records.contact_thresholds import CONTACT, reading_limit

_RATE_S = 0.1  # s over which the rate of loading is read: 20 readings at 200 Hz
_STILL = 0.2  # of the median rate: slower is a pause, in which a gel may relax; test_force_readings
_DWELL_S = 0.15  # s, shorter pauses hold too few readings for a mean
_SMOOTH = 9  # readings: 45 ms at 200 Hz, a tenth of the shortest ramp worth certifying
_GAP = 3 * _SMOOTH  # readings beside contact that are not taken for free


@dataclass(frozen=True, slots=True, eq=False)
class ForceWindow:
    """`time_s` (T,), tared `force_N` (T, 3), smoothed normal force `smooth_N` (T,), phases (None: no contact).

    `ramp_N_s` is the median rate of loading, `dwells` the (first, last) readings between which the rig stands
    still, on the way in and at the top. `drive_N` (T,) is the smoothed force with what it relaxes by in the
    dwells put back: it stands still where the depth does.
    """

    time_s: Floats
    force_N: Floats
    smooth_N: Floats
    tare: Tare
    phases: Phases | None
    ramp_N_s: float
    dwells: tuple[tuple[int, int], ...]
    drive_N: Floats

    def at(self, time_s: Floats) -> Floats:
        """Driving force (N,) at times (N,), NaN outside the readings."""
        return np.interp(time_s, self.time_s, self.drive_N, left=np.nan, right=np.nan)


def force_window(forces: ForceSeries, press: Press, *, free_s: Pair, offset_s: float) -> ForceWindow | None:
    """Readings of one press. `free_s` (camera clock) reaches from the press before to the one after it."""
    first, last = free_s[0] + offset_s, free_s[1] + offset_s
    inside = (forces.time_s >= first) & (forces.time_s <= last)
    if inside.sum() < 10:
        return None
    time, raw = forces.time_s[inside], forces.force_N[inside]
    rough = _smooth(raw[:, 2])
    rough = rough - _free_level(time, rough)
    contact = find_phases(rough)
    free = forces.force_N.copy()
    if contact is not None:
        touching = _touching(rough, noise_of(raw[:, 2]) / np.sqrt(_SMOOTH), contact)
        free[np.flatnonzero(inside)[touching]] = np.nan  # a first try is no zero
        span = (float(time[max(contact.onset - _GAP, 0)]), float(time[min(contact.end + _GAP, time.size - 1)]))
    else:
        span = (press.start_s + offset_s, press.end_s + offset_s)
    tare = find_tare(replace(forces, force_N=free), span, free_s=(first, last))
    tared = raw - tare.at(time)
    smooth = _smooth(tared[:, 2])
    phases = find_phases(smooth)
    rate, dwells = _dwells(time, smooth, phases) if phases is not None else (0.0, ())
    return ForceWindow(time, tared, smooth, tare, phases, rate, dwells, _undrained(smooth, dwells))


def _dwells(time: Floats, force: Floats, phases: Phases) -> tuple[float, tuple[tuple[int, int], ...]]:
    """Usual rate of loading, and where the force stays within a small part of it for long enough."""
    interval = max(float(np.median(np.diff(time))), 1e-9)
    half = max(round(0.5 * _RATE_S / interval), 1)
    rate = np.zeros(force.size)
    rate[half:-half] = (force[2 * half :] - force[: -2 * half]) / (2 * half * interval)
    load = rate[phases.onset : max(phases.hold, phases.onset + 2)]
    growing = load[load > 0.25 * load.max()] if load.size else load
    median_rate = max(float(np.median(growing)) if growing.size else 0.0, 1e-9)
    still = np.zeros(force.size, dtype=bool)
    still[phases.onset : phases.release + 1] = rate[phases.onset : phases.release + 1] < _STILL * median_rate
    edges = np.flatnonzero(np.diff(np.r_[0, still.astype(np.int8), 0]))
    # a mean rate over a window falls below the limit some time after the corner that it looks across
    lag = round((0.5 - _STILL) * _RATE_S / interval)
    runs = [
        (max(int(a) - lag, phases.onset), min(int(b) - 1 + lag, phases.release))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    return median_rate, tuple(run for run in runs if (run[1] - run[0]) * interval >= _DWELL_S)


def _undrained(force: Floats, dwells: tuple[tuple[int, int], ...]) -> Floats:
    drive = force.copy()
    for first, last in dwells:
        drive[last:] += drive[first] - drive[last]
        drive[first:last] = drive[first]
    return drive


def _free_level(time: Floats, force: Floats) -> Floats:
    """Level of the free gel (N,): a line through the medians of the lowest fifths before and after the top.

    One level would let a zero that drifts by more than the noise make free readings look like contact. A side
    whose lowest fifth climbs holds no free gel, and is left out.
    """
    top = int(np.nanargmax(force)) if np.isfinite(force).any() else 0
    ends = []
    for side in (slice(0, top + 1), slice(top, None)):
        low = force[side] <= np.nanquantile(force[side], 0.2)
        level = float(np.median(force[side][low]))
        ends.append((float(np.std(force[side][low])) / max(float(force[top]) - level, 1e-9), level, side, low))
    ends = [end for end in ends if end[0] <= CONTACT.reading_share] or [min(ends, key=lambda end: end[1])]
    when = [float(np.median(time[side][low])) for _, _, side, low in ends]
    return np.interp(time, when, [level for _, level, _, _ in ends])


def _touching(force: Floats, noise: float, contact: Phases) -> Bools:
    """Readings (N,) near one that stands out of the zero, beyond what `noise` of a smoothed one lets expect."""
    top = float(np.median(force[contact.hold : contact.release + 1]))
    out = (force > reading_limit(noise, top)).astype(float)
    return np.asarray(np.convolve(out, np.ones(2 * _GAP + 1), mode="same") > 0.5)


def _smooth(force: Floats) -> Floats:
    half = min(_SMOOTH, max(force.size // 4, 1)) // 2
    if half == 0:
        return force
    good = np.flatnonzero(np.isfinite(force))
    known = np.interp(np.arange(force.size), good, force[good])
    padded = np.pad(known, half, mode="edge")
    return np.asarray(np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid"))
