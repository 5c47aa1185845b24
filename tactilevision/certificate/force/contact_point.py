"""When the face first met the gel, from the force of the ramp; and the ramp's steady pace as a measure of depth.

    P(t) = b1 (t - t0) + b2 (t - t0)²,  t0 <= t;   0 before t0

t0 is the zero of the law that the force follows, not the first reading that stands out of the noise. Where the
whole ramp does not fit within the noise (a gel that relaxes, a law with a cubic term), its longest first part that
does is taken. Times on the F/T sensor's clock, s; forces tared, N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.certificate.force.phases import noise_of
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.records import Floats

_MIN_PART = 0.3  # of the ramp: below it curvature and start cannot be told apart; test_travel_scale
_SHORTENING = 1.3  # factor by which the fitted part of the ramp shrinks; test_travel_scale
_STEPS = 8  # Gauss-Newton steps; test_travel_scale
_LEVEL_S = 0.1  # s of readings for a level or a rate: as long as a pause must be to be told from noise
_MIN_COUNT = 4  # readings of the ramp's end from which a rate is taken; test_travel_scale
_MAX_ITERATIONS = 6  # of the meeting of ramp and level; test_travel_scale
_MAX_SIGMA = 4.0  # of chi-square: the noise it is held against is itself known to some per cent; test_travel_scale


@dataclass(frozen=True, slots=True, eq=False)
class ContactPoint:
    """The force's zero and its std, F/T clock; `law` (b1, b2) and the covariance (3, 3) of the zero and it.

    `shared_s`: what the zeros of presses that share their law may be off by together.
    """

    time_s: float
    std_s: float
    law: Floats
    covariance: Floats
    shared_s: float = 0.0


def contact_point(window: ForceWindow, touch_s: float) -> ContactPoint | None:
    """The zero of the force on the way to a touch at `touch_s`.

    None where there is no contact, a stop of the rig in between, or no part of the ramp that fits.
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
        found = _fit(time[here], force[here], (rough, length), std_N) if here.sum() >= 16 else None
        if found is not None:
            return found
        part /= _SHORTENING
    return None


def _fit(time: Floats, force: Floats, ramp_s: tuple[float, float], std_N: float) -> ContactPoint | None:
    """Gauss-Newton from the best of a few starts; None where the law does not fit within the noise."""
    trials = [(start, *_law(time, force, start)) for start in ramp_s[0] + np.linspace(-0.1, 0.05, 16) * ramp_s[1]]
    start, law, _ = min(trials, key=lambda trial: trial[2])
    answer = np.array([start, *law])
    for _ in range(_STEPS):
        after = np.maximum(time - answer[0], 0)
        slope = np.where(after > 0, answer[1] + 2 * answer[2] * after, 0.0)
        jacobian = np.column_stack([-slope, after, after**2])
        residual = force - answer[1] * after - answer[2] * after**2
        answer = answer + np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    dof = max(force.size - 3, 1)
    reduced = float((residual**2).sum()) / dof / std_N**2
    if not np.isfinite(reduced) or reduced > 1 + _MAX_SIGMA * np.sqrt(2 / dof) or not answer[1] > 0:
        return None
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * std_N**2 * max(reduced, 1.0)
    return ContactPoint(float(answer[0]), float(np.sqrt(covariance[0, 0])), answer[1:], covariance)


def _law(time: Floats, force: Floats, start_s: float) -> tuple[Floats, float]:
    """b1, b2 for a given start, and the sum of squares that they leave."""
    after = np.maximum(time - start_s, 0)
    design = np.column_stack([after, after**2])
    answer = np.linalg.lstsq(design, force, rcond=None)[0]
    return np.asarray(answer, dtype=np.float64), float(((force - design @ answer) ** 2).sum())


def moving_s(window: ForceWindow, since_s: float, *, time_s: Floats) -> Floats:
    """How long (N,) the rig has moved on the way in since a time: stops and the hold do not count."""
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
    """When the way in ended: where the last of the ramp, drawn on, meets the level of the hold's beginning.

    The phase of the hold begins earlier, as soon as the force is within its tolerance of the top: of a deep press
    that is ten microns of travel.
    """
    assert window.phases is not None
    time, force, hold = window.time_s, window.force_N[:, 2], window.phases.hold
    count = max(round(_LEVEL_S / max(float(np.median(np.diff(time))), 1e-9)), 3)
    ramp = np.arange(max(hold - count, window.phases.onset), hold + 1)
    ramp = ramp[np.isfinite(force[ramp])]
    end = float(time[hold])
    if ramp.size < _MIN_COUNT:
        return end
    rate, there = np.polyfit(time[ramp] - time[hold], force[ramp], 1)
    for _ in range(_MAX_ITERATIONS):  # the level begins where the ramp ends
        first = int(np.searchsorted(time, end))
        level = float(window.smooth_N[first : min(first + count, window.phases.release + 1)].mean())
        if not rate > 0:
            break
        end = float(np.clip(time[hold] + (level - there) / rate, time[hold], time[window.phases.release]))
    return end
