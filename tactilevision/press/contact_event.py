"""Read the contact event of each press from the fitted model: when the bevel touched, and the force then."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from tactilevision.contact.bevel import Onset, find_onset
from tactilevision.press.fit import ModelFit
from tactilevision.press.force_readings import ForceWindow
from tactilevision.press.model import LAW, Own, Whole
from tactilevision.records.measured import Floats, Pair

DETECTION_CHI2 = 25.0  # fall of chi-square that counts as a contact event: five sigma
READINGS = 200  # of the mean in a stop of the rig at most: 1 s at 200 Hz
LAST = 1 / 3  # of the ramp before the touch, on which tangential forces are read
AT_STOP = 3.0  # stds of a depth within which a stop of the rig stands at the event
AT_STOP_SHARE = 0.01  # of the depth, likewise
FORM_MM = 0.0003  # mm: a rounded edge moves the zero of a force law by .1 to .5 um (finite elements)
NEAR_S = 0.02  # s to either side of an event, over which its pace is taken
MIN_DEPTH_STD_MM = 1e-4  # mm: a tenth of a micrometre, finer than any stage


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """First touch of the bevel: camera time and std, the depth that the camera read then, channel, onset.

    `seen_s`: when the signal of this press alone shows it.
    """

    time_s: float
    std_s: float
    depth_seen_mm: float
    channel: str
    onset: Onset
    seen_s: float = float("nan")


@dataclass(frozen=True, slots=True)
class EventForce:
    """Force (3,) and its std (3,) at the event; its readings, and whether the rig stood still there."""

    force_N: Floats
    std_N: Floats
    readings: int
    dwell: bool


@dataclass(frozen=True, slots=True)
class PressEvent:
    """The contact event of one press. `event` is None where its depth was not reached.

    `scale_std` is the relative std common to all depths, `zero_std_mm` the common std of their zero.
    """

    touch: ContactEvent | None
    event: EventForce | None
    due_s: float
    distance_mm: float | None
    delay_mm: float = 0.0
    delay_std_mm: float = 0.0
    scale_std: float = float("nan")
    zero_std_mm: float = float("nan")


def press_events(fit: ModelFit, distances_mm: dict[str, float | None]) -> dict[str, PressEvent]:
    """Return the event of every press of a fit; `distances_mm` of their bevels."""
    found, slopes, depths = {}, [], []
    delay = fit.model.block(fit.shared, "recording")[Whole.DELAY]
    delay_std = float(np.sqrt(fit.covariance[Whole.DELAY, Whole.DELAY]))
    for k, one in enumerate(fit.model.presses):
        event = PressEvent(None, None, np.nan, distances_mm[one.name], float(delay), delay_std)
        if one.height >= 0:
            event, slope = _event(fit, k, event)
            if event.event is not None:
                slopes.append(slope)
                depths.append(one.nominal_mm)
        found[one.name] = event
    scale, zero = _common_std(fit, np.array(slopes), np.array(depths))
    return {name: replace(one, scale_std=scale, zero_std_mm=zero) for name, one in found.items()}


def _event(fit: ModelFit, k: int, event: PressEvent) -> tuple[PressEvent, Floats]:
    """Return the event of a press with a bevel, and the slope (S,) of its depth by the shared unknowns."""
    model, one, window = fit.model, fit.model.presses[k], fit.model.presses[k].window
    w, gain = one.nominal_mm, float(fit.own[k, Own.GAIN])
    law, power = model.block(fit.shared, "law")[one.kind], float(model.powers[one.kind])
    level, rate = (
        gain * float(model.force(law, np.array(w), power)),
        gain * float(model.rate(law, np.array(w), power)),
    )
    offset = float(fit.shared[Whole.OFFSET])
    onset = _onset(fit, k, one.track.time_s + offset)
    path = np.maximum.accumulate(np.nan_to_num(model.path(fit.shared, fit.own, k, window.time_s), nan=-np.inf))
    phases = window.phases
    assert phases is not None
    reached = path[: phases.release + 1]
    time_s = float(np.interp(w, reached, window.time_s[: reached.size])) if reached[-1] >= w else np.nan
    own_std_N, slope = _level_std(fit, k, level, rate)
    event = replace(event, due_s=time_s - offset)
    if onset is None or not np.isfinite(time_s):
        return event, slope
    std_mm = max(own_std_N / rate, MIN_DEPTH_STD_MM)
    before, after = np.interp([time_s - NEAR_S, time_s + NEAR_S], window.time_s, path)
    pace = max(float(after - before), 1e-6) / (2 * NEAR_S)
    seen = float(np.interp(time_s - offset, one.track.time_s, one.track.depth_mm))
    alone_s = float(np.interp(onset.at, reached, window.time_s[: reached.size]))
    std_s = float(np.hypot(std_mm / pace, fit.offset_std_s))
    touch = ContactEvent(time_s - offset, std_s, seen, "height map", onset, seen_s=alone_s - offset)
    stop = _stop(window, path, w, max(AT_STOP * std_mm, AT_STOP_SHARE * w))
    force = _in_stop(window, stop, w, path, rate) if stop else _on_ramp(window, time_s, level, own_std_N)
    if onset.gain <= DETECTION_CHI2:
        force = None
    return replace(event, touch=touch, event=force), slope


def _onset(fit: ModelFit, k: int, time_s: Floats) -> Onset | None:
    """Return the touch that the height map of this press alone shows, with the shape and size of the others."""
    model, one = fit.model, fit.model.presses[k]
    used = np.isfinite(one.signal_mm) & (time_s <= one.released_s)
    amplitude = float(np.exp(model.block(fit.shared, "amplitude")[one.kind, 0]))
    depth = model.path(fit.shared, fit.own, k, time_s[used])
    scatter = float(fit.prior.own_std[k, Own.DENT])
    return find_onset(
        depth, one.signal_mm[used], growth=model.growth(fit.shared), amplitude=(amplitude, scatter * amplitude)
    )


def _level_std(fit: ModelFit, k: int, level_N: float, rate: float) -> tuple[float, Floats]:
    """Return the own std (N) of the force at the event, and the slope (S,) of the depth by shared unknowns."""
    model, one = fit.model, fit.model.presses[k]
    place = model.blocks["law"][0]
    shared_slope, own_slope = np.zeros(fit.shared.size), np.zeros(fit.own.shape[1])
    own_slope[Own.GAIN] = level_N / fit.own[k, Own.GAIN]
    power = float(model.powers[one.kind])
    for column in range(LAW):
        at = place.start + LAW * one.kind + column
        law = model.block(fit.shared, "law")[one.kind].copy()
        law[column] += 1e-4
        moved = fit.own[k, Own.GAIN] * float(model.force(law, np.array(one.nominal_mm), power))
        shared_slope[at] = (moved - level_N) / 1e-4
    own_std, slope = fit.spread(shared_slope, own_slope, k)
    return own_std, slope / rate


def _common_std(fit: ModelFit, slopes: Floats, depths: Floats) -> tuple[float, float]:
    """Return relative std of the depths' scale, and std (mm) of their zero, by their common covariance."""
    if not depths.size:
        return np.nan, np.nan
    common = slopes @ fit.covariance @ slopes.T
    pairs = np.triu_indices(depths.size)
    design = np.column_stack([np.outer(depths, depths)[pairs], np.ones(pairs[0].size)])
    scale, zero = np.sqrt(nnls(design / depths.mean() ** 2, common[pairs] / depths.mean() ** 2)[0])
    return float(scale), float(np.hypot(zero, FORM_MM))


def _stop(window: ForceWindow, path: Floats, depth_mm: float, within_mm: float) -> Pair | None:
    """Return first and last time of the rig's stop at the event, on the way in."""
    assert window.phases is not None
    for start, end in window.dwells:
        if start < window.phases.hold and abs(path[start] - depth_mm) <= within_mm:
            edge = (end - start) // 10
            return float(window.time_s[start + edge]), float(window.time_s[end - edge])
    return None


def _in_stop(window: ForceWindow, stop: Pair, depth_mm: float, path: Floats, rate: float) -> EventForce | None:
    """Return the mean of the readings in a stop, moved along the law to the event's depth."""
    inside = np.flatnonzero(
        (window.time_s >= stop[0]) & (window.time_s <= stop[1]) & np.isfinite(window.force_N).all(axis=1)
    )[:READINGS]
    if inside.size < 5:
        return None
    chosen = window.force_N[inside]
    force = chosen.mean(axis=0)
    force[2] += rate * (depth_mm - float(path[inside[0]]))
    return EventForce(force, chosen.std(axis=0, ddof=1) / np.sqrt(inside.size), inside.size, True)


def _on_ramp(window: ForceWindow, time_s: float, level_N: float, std_N: float) -> EventForce:
    """Return the fitted normal force, and the tangential one by a line over the last part of the ramp."""
    assert window.phases is not None
    begun = float(window.time_s[window.phases.onset])
    late = (window.time_s >= time_s - LAST * (time_s - begun)) & (window.time_s <= time_s)
    late &= np.isfinite(window.force_N).all(axis=1)
    force, std = np.array([0.0, 0.0, level_N]), np.array([np.nan, np.nan, std_N])
    count = int(late.sum())
    if count >= 4:
        design = np.column_stack([np.ones(count), window.time_s[late] - time_s])
        answer, *_ = np.linalg.lstsq(design, window.force_N[late, :2], rcond=None)
        spread = (window.force_N[late, :2] - design @ answer).std(axis=0, ddof=2)
        force[:2] = answer[0]
        std[:2] = spread * np.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    return EventForce(force, std, count, False)
