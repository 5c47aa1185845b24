"""Estimate the force at the moment of the first bevel contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.press.force_readings import ForceWindow, fit_ramp
from tactilevision.records.measured import Bools, Floats, ForceSeries, Pair

# The force at the moment of first touch.
#
# Where the rig dwells there: the mean of up to 200 readings. On a ramp: a one-sided fit up to the touch, since
# beyond it the bevel carries force too,
#
#     P(t) = b1 (t - t0) + b2 (t - t0)²,  t0 <= t <= touch;   0 before t0
#
# evaluated at the touch. Where the ramp's speed was not even, so that this does not fit within the noise, a
# parabola over the last part that fits. Times on the F/T sensor's clock, s; forces tared, N.

READINGS = 200  # of a dwell's mean at most: 1 s at 200 Hz


@dataclass(frozen=True, slots=True)
class EventForce:
    """Force (3,), its std (3,) excluding the touch time's; `rate_N_s` of the normal force; its source."""

    force_N: Floats
    std_N: Floats
    rate_N_s: float
    readings: int
    dwell: bool


def force_in_dwell(time_s: Floats, force_N: Floats, *, dwell_s: Pair, event_s: float) -> EventForce | None:
    """Return the mean of up to READINGS readings (T, 3) N at times (T,) s in the dwell, nearest to the event."""
    inside = np.flatnonzero((time_s >= dwell_s[0]) & (time_s <= dwell_s[1]) & np.isfinite(force_N).all(axis=1))
    if inside.size < 5:
        return None
    nearest = inside[np.argsort(np.abs(time_s[inside] - event_s), kind="stable")[:READINGS]]
    chosen = force_N[nearest]
    return EventForce(
        chosen.mean(axis=0), chosen.std(axis=0, ddof=1) / np.sqrt(len(chosen)), 0.0, len(chosen), True
    )


def force_on_ramp(
    time_s: Floats, force_N: Floats, std_N: Floats, *, onset_s: float, touch_s: float
) -> EventForce | None:
    """Return the one-sided fit up to the touch, to forces (n, 3) in N; `onset_s`: rough first contact.

    `std_N` (3,) is the deviation of one reading.
    """
    good = np.isfinite(force_N).all(axis=1)
    ramp = touch_s - onset_s
    free = good & (time_s >= onset_s - ramp) & (time_s < onset_s)
    load = good & (time_s >= onset_s) & (time_s <= touch_s)
    if load.sum() < 4:
        return None
    normal = _whole_ramp(time_s, force_N[:, 2], free | load, (onset_s, touch_s), float(std_N[2]))
    if normal is None:
        normal = _last_part(time_s, force_N[:, 2], load, touch_s, float(std_N[2]))
    value, std, rate, count = normal
    late = load & (time_s >= touch_s - ramp / 3)
    late = late if late.sum() >= 4 else load
    force, spread = np.empty(3), np.empty(3)
    for axis in (0, 1):
        force[axis], spread[axis], *_ = _polynomial(time_s[late] - touch_s, force_N[late, axis], 1)
        spread[axis] *= std_N[axis]
    force[2], spread[2] = value, std
    return EventForce(force, spread, rate, count, False)


def _whole_ramp(
    time: Floats, force: Floats, where: Bools, ramp_s: Pair, std: float
) -> tuple[float, float, float, int] | None:
    """Return value, std and slope at the touch of the law from first contact on; None for a misfit."""
    begun = fit_ramp(time[where], force[where], (ramp_s[0], ramp_s[1] - ramp_s[0]), std)
    if begun is None:
        return None
    end = ramp_s[1] - begun.time_s
    at_touch = np.array([-(begun.law[0] + 2 * begun.law[1] * end), end, end**2])
    spread = float(np.sqrt(at_touch @ begun.covariance @ at_touch))
    count = int((where & (time > begun.time_s)).sum())
    return float(begun.law @ at_touch[1:]), spread, float(-at_touch[0]), count


def _last_part(
    time: Floats, force: Floats, load: Bools, touch_s: float, std: float
) -> tuple[float, float, float, int]:
    """Return a parabola over the ramp's longest fitting last part; the shortest has its misfit in the std."""
    places = np.flatnonzero(load)
    count = places.size
    while True:
        chosen = places[-count:]
        x, y = time[chosen] - touch_s, force[chosen]
        value, spread, rate, rms = _polynomial(x, y, 2 if count >= 12 else 1)
        if rms <= np.sqrt(_fitting(count)) * std or count <= 16:
            return value, spread * max(rms, std), rate, count
        count = max(16, int(count / 1.5))


def _fitting(count: int) -> float:
    """Return the reduced chi-square that a correct model exceeds once in forty times."""
    return float(1 + 2 * np.sqrt(2 / max(count, 1)))


def _polynomial(x: Floats, y: Floats, degree: int) -> tuple[float, float, float, float]:
    """Return the value at 0, its std for readings of std 1, the slope there, and the rms residual per freedom."""
    answer, covariance = np.polyfit(x, y, degree, cov="unscaled")
    square = float(((y - np.polyval(answer, x)) ** 2).sum())
    rms = np.sqrt(square / max(y.size - degree - 1, 1))
    return float(answer[-1]), float(np.sqrt(covariance[-1, -1])), float(answer[-2]), float(rms)


# When the touch happened on either clock, and whether the rig stood still there.
#
# The touch is found as a depth; the force, read 200 times a second, gives the time at that depth. Times in s,
# forces in N, depths in mm.

_NEAR_S = 0.1  # s about the crossing over which the force is a line


@dataclass(frozen=True, slots=True)
class ForceCrossing:
    """When the force first reached a level: F/T clock, std from the level's own, rate; the dwell there, if any."""

    time_s: float
    std_s: float
    rate_N_s: float
    dwell_s: Pair | None


def force_crossing(window: ForceWindow, level_N: float, *, level_std_N: float) -> ForceCrossing | None:
    """Return the driving force's first passage through a level on the way in; None if there is none."""
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
    """Return the force at the event: mean in the dwell, else the one-sided fit up to the touch."""
    assert window.phases is not None
    if crossed.dwell_s is not None:
        return force_in_dwell(window.time_s, window.force_N, dwell_s=crossed.dwell_s, event_s=crossed.time_s)
    onset = float(window.time_s[window.phases.onset])
    return force_on_ramp(
        window.time_s, window.force_N, np.asarray(forces.std_N), onset_s=onset, touch_s=crossed.time_s
    )
