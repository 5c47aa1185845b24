"""Prepare the force of one press: tare, phases, window, and first contact from the ramp."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tactilevision.records.contact_thresholds import CONTACT, reading_limit
from tactilevision.records.measured import Bools, Floats, ForceSeries, Pair
from tactilevision.records.rig import Press
from tactilevision.robust import second_difference_std

# The zero of the force: the F/T sensor's reading on the free gel before and after a press, linear in between.
#
#     zero(t) = mean before + (mean after - mean before) (t - t_before)/(t_after - t_before)
#
# Times on the F/T sensor's clock, forces in N.

_MIN_FREE_COUNT = 5  # readings of the free gel for a zero; tests.certificate.test_force_readings
_LONGEST_S = 2.0  # s nearest to the press: the zero drifts over longer times


@dataclass(frozen=True, slots=True)
class Tare:
    """The zero before and after a press: force (3,) at its mean time; None without free readings.

    `std_N` (3,) of the zero during the press.
    """

    before_N: Floats | None
    before_s: float
    after_N: Floats | None
    after_s: float
    std_N: Floats

    def at(self, time_s: Floats) -> Floats:
        """Return the zero (T, 3) at times (T,)."""
        if self.before_N is None and self.after_N is None:
            return np.zeros((len(time_s), 3))
        first = self.before_N if self.before_N is not None else self.after_N
        last = self.after_N if self.after_N is not None else self.before_N
        assert first is not None
        assert last is not None
        length = self.after_s - self.before_s
        part = np.clip((time_s - self.before_s) / length, 0, 1) if length > 0 else np.zeros(len(time_s))
        return np.asarray(first + part[:, None] * (last - first), dtype=np.float64)

    @property
    def known(self) -> bool:
        return self.before_N is not None or self.after_N is not None


def find_tare(forces: ForceSeries, contact_s: Pair, *, free_s: Pair) -> Tare:
    """Return the zero of a press in contact during `contact_s`, with free gel in the rest of `free_s`."""
    time = forces.time_s
    before = (time < contact_s[0]) & (time >= max(free_s[0], contact_s[0] - _LONGEST_S))
    after = (time > contact_s[1]) & (time <= min(free_s[1], contact_s[1] + _LONGEST_S))
    first, first_s, first_std = _mean(forces, before)
    last, last_s, last_std = _mean(forces, after)
    known = [std for std in (first_std, last_std) if std is not None]
    if not known:
        return Tare(None, np.nan, None, np.nan, np.full(3, np.nan))
    std = np.sqrt(np.mean(np.square(known), axis=0) / len(known))
    if first is not None and last is not None:  # half of its drift may not be linear in time
        std = np.hypot(std, np.abs(last - first) / np.sqrt(12))
    return Tare(first, first_s, last, last_s, np.asarray(std))


def subtract_tares(forces: ForceSeries, tares: Iterable[Tare]) -> ForceSeries:
    """Return the readings minus the zeros of these tares, linear in time between them; unchanged without tares.

    An uncorrected drift of a few millinewtons during a press delays its unloading by milliseconds.
    """
    knots = [
        (time, zero)
        for tare in tares
        for time, zero in ((tare.before_s, tare.before_N), (tare.after_s, tare.after_N))
        if zero is not None
    ]
    if not knots:
        return forces
    knots.sort(key=lambda knot: knot[0])
    times, zeros = np.array([time for time, _ in knots]), np.array([zero for _, zero in knots])
    level = np.stack([np.interp(forces.time_s, times, axis) for axis in zeros.T], axis=1)
    return replace(forces, force_N=forces.force_N - level)


def _mean(forces: ForceSeries, where: Bools) -> tuple[Floats | None, float, Floats | None]:
    readings = forces.force_N[where]
    readings = readings[np.isfinite(readings).all(axis=1)]
    if len(readings) >= _MIN_FREE_COUNT:  # the end of a jolt is no part of the zero
        apart = np.abs(readings - np.median(readings, axis=0))
        readings = readings[(apart <= 6 * np.asarray(forces.std_N) + 3 * np.median(apart, axis=0)).all(axis=1)]
    if len(readings) < _MIN_FREE_COUNT:
        return None, float("nan"), None
    spread = np.maximum(readings.std(axis=0), 0.3 * np.asarray(forces.std_N))
    return readings.mean(axis=0), float(forces.time_s[where].mean()), spread / np.sqrt(len(readings))


# The phase of each reading of a press: free, load, hold, unload, free.
#
# The threshold of contact and the tolerance of the hold come from the noise of the readings: contact is repeatedly
# more than 5 sigma from the zero, the hold within 4 sigma (or 2 %) of the top.


@dataclass(frozen=True, slots=True)
class Phases:
    """Indices of readings: the first of contact, the first and last of the hold, the first free one after.

    `noise` of one reading, in its unit.
    """

    onset: int
    hold: int
    release: int
    end: int
    noise: float

    def names(self, count: int) -> npt.NDArray[np.str_]:
        """Return the phase (N,) of each of `count` readings."""
        place = np.arange(count)
        names = np.full(count, "free", dtype="<U6")
        names[(place >= self.onset) & (place < self.hold)] = "load"
        names[(place >= self.hold) & (place <= self.release)] = "hold"
        names[(place > self.release) & (place < self.end)] = "unload"
        return names


def find_phases(reading: Floats) -> Phases | None:
    """Return the phases of a press by depths (mm) or forces (N), (N,), zero when free; None without contact."""
    noise = noise_of(reading)
    known = np.where(np.isfinite(reading), reading, -np.inf)
    top = float(np.median(np.sort(known)[-max(3, known.size // 20) :])) if known.size >= 5 else 0.0
    if not top > CONTACT.reading_top_sigma * noise or top <= 0:
        return None
    contact = known > reading_limit(noise, top)
    firm = contact & np.r_[contact[1:], contact[-1]]  # two in a row: a single outlier is no contact
    if not firm.any():
        return None
    main = _main_run(contact, np.where(contact, known, 0.0))
    high = np.flatnonzero(main & (known >= top - max(4 * noise, 0.02 * top)))
    if not high.size:
        return None
    hold, release = int(high[0]), int(high[-1])
    before = np.flatnonzero(~firm[:hold])
    after = np.flatnonzero(~contact[release:])
    return Phases(
        int(before[-1]) + 1 if before.size else 0,
        hold,
        release,
        release + int(after[0]) if after.size else known.size,
        noise,
    )


def _main_run(contact: Bools, reading: Floats) -> Bools:
    """Return the main contact: the run of the largest sum, not a jolt at the window's end."""
    edges = np.flatnonzero(np.diff(np.r_[0, contact.astype(np.int8), 0]))
    runs = list(zip(edges[::2], edges[1::2], strict=True))
    first, last = max(runs, key=lambda run: float(reading[run[0] : run[1]].sum()))
    chosen = np.zeros(contact.size, dtype=bool)
    chosen[first:last] = True
    return chosen


def noise_of(reading: Floats) -> float:
    """Return the noise of one reading of (N,), in its unit.

    From second differences: a ramp does not count, nor do its few corners.
    """
    known = reading[np.isfinite(reading)]
    if known.size < 5:
        return 0.0
    return second_difference_std(known)


# The force of one press: its tared readings with their phases, and the force at each frame.
#
# Times on the F/T sensor's clock, forces in N.

_RATE_S = 0.1  # s over which the rate of loading is determined: 20 readings at 200 Hz
_STILL = 0.2  # of the median rate: slower is a pause, in which a gel may relax; test_force_readings
_DWELL_S = 0.15  # s, shorter pauses hold too few readings for a mean
_SMOOTH = 9  # readings: 45 ms at 200 Hz, a tenth of the shortest ramp suited to certification
_GAP = 3 * _SMOOTH  # readings next to contact that do not count as free


@dataclass(frozen=True, slots=True, eq=False)
class ForceWindow:
    """`time_s` (T,), tared `force_N` (T, 3), smoothed normal force `smooth_N` (T,), phases (None: no contact).

    `ramp_N_s` is the median rate of loading, `dwells` the (first, last) readings between which the rig stands
    still, on the way in and at the top. `drive_N` (T,) is the smoothed force corrected for relaxation in the
    dwells: it
    is constant where the depth is.
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
        """Return the driving force (N,) at times (N,), NaN outside the readings."""
        return np.interp(time_s, self.time_s, self.drive_N, left=np.nan, right=np.nan)


def force_window(forces: ForceSeries, press: Press, *, free_s: Pair, offset_s: float) -> ForceWindow | None:
    """Return the readings of one press. `free_s` (camera clock): from the previous press to the next one."""
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
        free[np.flatnonzero(inside)[touching]] = np.nan  # the first estimate is no zero
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
    """Return the usual rate of loading, and where the force is nearly constant for long enough."""
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
    # a mean rate over a window falls below the limit some time after the corner within it
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
    """Return the level of the free gel (N,): a line through the medians of the lowest fifths before and after the
    top.

    With a constant level, drift beyond the noise would make free readings look like contact. A side whose lowest
    fifth
    climbs contains no free gel, and is excluded.
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
    """Return which readings (N,) are near a significant one, for `noise` of a smoothed reading."""
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


# First contact of the face with the gel, from the force of the ramp; and the ramp's steady pace as a depth
# measure.
#
#     P(t) = b1 (t - t0) + b2 (t - t0)²,  t0 <= t;   0 before t0
#
# t0 is the zero of the force law, not the first significant reading. Where the whole ramp does not fit within the
# noise (a gel that relaxes, a law with a cubic term), its longest first part that does is taken. Times on the F/T
# sensor's clock, s; forces tared, N.

_MIN_PART = 0.3  # of the ramp: below it curvature and start are not separable; test_travel_scale
_SHORTENING = 1.3  # factor by which the fitted part of the ramp shrinks; test_travel_scale
_STARTS = (-0.1, 0.05)  # of the ramp, from its rough start: where first contact is sought
_MIN_READINGS = 16  # of a ramp that is fitted; test_travel_scale
_LEVEL_S = 0.1  # s of readings for a level or a rate: minimum duration of a pause
_MIN_RAMP_COUNT = 4  # readings of the ramp's end from which a rate is taken; test_travel_scale
_MAX_ITERATIONS = 6  # of the intersection of ramp and level; test_travel_scale
_MAX_SIGMA = 4.0  # of chi-square: the noise estimate itself is uncertain by some per cent; test_travel_scale


@dataclass(frozen=True, slots=True, eq=False)
class ContactPoint:
    """The force's zero and its std, F/T clock; `law` (b1, b2) and the covariance (3, 3) of the zero and it.

    `shared_s`: common std of the zeros of presses that share their law.
    """

    time_s: float
    std_s: float
    law: Floats
    covariance: Floats
    shared_s: float = 0.0


def contact_point(window: ForceWindow, touch_s: float) -> ContactPoint | None:
    """Return the zero of the force before a touch at `touch_s`.

    None without contact, with a stop of the rig in between, or where no part of the ramp fits.
    """
    if window.phases is None:
        return None
    time, force = window.time_s, window.force_N[:, 2]
    std_N = max(noise_of(force), 1e-9)
    rough = float(time[window.phases.onset])
    length = touch_s - rough
    stops = [float(time[first]) for first, _ in window.dwells]
    if not length > 0 or any(rough < stop < touch_s - 0.05 * length for stop in stops):
        return None
    part = 1.0
    while part >= _MIN_PART:
        here = (time >= rough - 0.5 * length) & (time <= rough + part * length) & np.isfinite(force)
        found = fit_ramp(time[here], force[here], (rough, length), std_N)
        if found is not None:
            return found
        part /= _SHORTENING
    return None


def fit_ramp(time_s: Floats, force_N: Floats, ramp_s: Pair, std_N: float) -> ContactPoint | None:
    """Return the law of forces (N,) from first contact on, for a ramp of a rough start and length (s).

    None with few readings or a misfit beyond the noise.
    """
    from scipy.optimize import curve_fit

    if force_N.size < _MIN_READINGS:
        return None

    def ramp(time: Floats, start: float, linear: float, square: float) -> Floats:
        after = np.maximum(time - start, 0)
        return np.asarray(linear * after + square * after**2)

    def law(start: float) -> tuple[Floats, float]:
        design = np.column_stack([ramp(time_s, start, 1, 0), ramp(time_s, start, 0, 1)])
        answer = np.linalg.lstsq(design, force_N, rcond=None)[0]
        return np.asarray(answer), float(((force_N - design @ answer) ** 2).sum())

    starts = ramp_s[0] + np.linspace(*_STARTS, _MIN_READINGS) * ramp_s[1]
    start = min(starts, key=lambda trial: law(trial)[1])
    sigma = np.full(force_N.size, std_N)
    try:
        answer, covariance = curve_fit(ramp, time_s, force_N, (start, *law(start)[0]), sigma, absolute_sigma=True)
    except RuntimeError:  # no convergence
        return None
    dof = force_N.size - 3
    reduced = float(((force_N - ramp(time_s, *answer)) ** 2).sum()) / dof / std_N**2
    if not reduced <= 1 + _MAX_SIGMA * np.sqrt(2 / dof) or not answer[1] > 0:
        return None
    covariance = covariance * max(reduced, 1.0)
    return ContactPoint(float(answer[0]), float(np.sqrt(covariance[0, 0])), answer[1:], covariance)


def moving_s(window: ForceWindow, since_s: float, *, time_s: Floats) -> Floats:
    """Return how long (N,) the rig has moved on the way in since a time: stops and the hold do not count."""
    assert window.phases is not None
    end = top_s(window)
    reached = np.minimum(time_s, end)
    moved = reached - since_s
    for first, last in window.dwells:
        start, stop = float(window.time_s[first]), float(window.time_s[last])
        if start < end:
            moved = moved - np.clip(
                reached - max(start, since_s), 0.0, max(min(stop, end) - max(start, since_s), 0.0)
            )
    return np.asarray(moved, dtype=np.float64)


def top_s(window: ForceWindow) -> float:
    """Return when the way in ended: where the extrapolated end of the ramp meets the level of the hold's
    beginning.

    The phase of the hold begins earlier, when the force enters the tolerance of the top: for a deep press ten
    microns of travel earlier.
    """
    assert window.phases is not None
    time, force, hold = window.time_s, window.force_N[:, 2], window.phases.hold
    count = max(round(_LEVEL_S / max(float(np.median(np.diff(time))), 1e-9)), 3)
    ramp = np.arange(max(hold - count, window.phases.onset), hold + 1)
    ramp = ramp[np.isfinite(force[ramp])]
    end = float(time[hold])
    if ramp.size < _MIN_RAMP_COUNT:
        return end
    rate, there = np.polyfit(time[ramp] - time[hold], force[ramp], 1)
    for _ in range(_MAX_ITERATIONS):  # the level begins where the ramp ends
        first = int(np.searchsorted(time, end))
        level = float(window.smooth_N[first : min(first + count, window.phases.release + 1)].mean())
        if not rate > 0:
            break
        end = float(np.clip(time[hold] + (level - there) / rate, time[hold], time[window.phases.release]))
    return end
