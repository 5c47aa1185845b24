"""Determine contact events by the travel of the indenter since first contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.contact.bevel import SIDES
from tactilevision.press.bevel_contact import DETECTION_CHI2, fill_mm
from tactilevision.press.contact_times import (
    ContactTimes,
    RecordingMeasurements,
    TravelPoint,
    TravelScale,
    fit_travel_scale,
)
from tactilevision.press.event_force import EventForce, event_force
from tactilevision.press.force_readings import ContactPoint, ForceWindow, contact_point, moving_s, top_s
from tactilevision.press.track import face_tilt
from tactilevision.recording.model import StageSeries
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Indenter

# The travel of a press since its face met the gel: by the motion stage, or by pace times time.
#
# z(t) = stage(t) - stage(t0), or speed times the time of motion since t0, the zero of force. Times on the F/T
# sensor's clock, lengths in mm. The rig's deflection under the force is included.


@dataclass(frozen=True, slots=True, eq=False)
class IndenterTravel:
    """`travel_mm` (T,) at `time_s` (T,) from first contact to the top, never falling; `pace_mm_s` while it moves.

    `std_mm` of its own zero, `shared_mm` common to all zeros.
    """

    time_s: Floats
    travel_mm: Floats
    pace_mm_s: float
    std_mm: float
    shared_mm: float = 0.0

    def at(self, time_s: float) -> float:
        """Return the travel at a time."""
        return float(np.interp(time_s, self.time_s, self.travel_mm))

    def reached_s(self, travel_mm: float) -> float:
        """Return when a travel was first reached; the last time where it never was."""
        place = int(np.searchsorted(self.travel_mm, travel_mm))
        if place == 0 or place == self.time_s.size:
            return float(self.time_s[min(place, self.time_s.size - 1)])
        return float(
            np.interp(travel_mm, self.travel_mm[place - 1 : place + 1], self.time_s[place - 1 : place + 1])
        )


def first_contact(window: ForceWindow, touch_s: float) -> ContactPoint | None:
    """Return first contact, searched up to the rig's first stop, or to the touch at `touch_s`; or None."""
    if window.phases is None:
        return None
    onset = float(window.time_s[window.phases.onset])
    stops = [float(window.time_s[first]) for first, _ in window.dwells]
    return contact_point(window, min([stop for stop in stops if stop > onset] + [touch_s]))


def indenter_travel(
    window: ForceWindow, begun: ContactPoint, *, stage: StageSeries | None, pace_mm_s: float
) -> IndenterTravel | None:
    """Return the travel of one press since its first contact; None where neither stage nor pace is known, or where
    the
    stage still approached faster than it pressed.
    """
    end = top_s(window)
    inside = window.time_s[(window.time_s > begun.time_s) & (window.time_s < end)]
    times = np.concatenate([[begun.time_s], inside, [max(end, begun.time_s)]])
    if stage is not None and stage.time_s[0] <= times[0] and times[-1] <= stage.time_s[-1]:
        if _still_approaching(stage, times[0], times[-1]):
            return None
        place = np.interp(times, stage.time_s, stage.z_mm)
        travel = np.maximum.accumulate(place - place[0])
    elif np.isfinite(pace_mm_s):
        travel = pace_mm_s * moving_s(window, begun.time_s, time_s=times)
    else:
        return None
    moved = moving_s(window, begun.time_s, time_s=times[-1:])[0]
    pace = float(travel[-1]) / max(float(moved), 1e-9)
    if not pace > 0:
        return None
    return IndenterTravel(
        times, np.asarray(travel, dtype=np.float64), pace, pace * begun.std_s, pace * begun.shared_s
    )


def _still_approaching(stage: StageSeries, begun_s: float, end_s: float) -> bool:
    """Return whether the stage moves farther between two readings about first contact than ever on the way in.

    The zero of the travel then lies anywhere between those readings.
    """
    step = np.abs(np.diff(stage.z_mm))
    first = int(np.searchsorted(stage.time_s, begun_s))
    last = int(np.searchsorted(stage.time_s, end_s))
    about, later = step[max(first - 2, 0) : first + 1], step[first + 1 : last]
    return bool(later.size and about.size and about.max() > 2 * later.max())


# First contacts of presses with a common force law, which determines what a single press leaves uncertain.
#
#     P = g_i (B1 x + B2 x²),    x = travel since first contact,    g_i = 1 +- tau
#
# A short ramp alone hardly separates its zero from its slope. Presses of one punch on one gel share slope and
# curvature except for individual gains (place, rest, temperature), whose scatter tau is the scatter of their laws
# beyond their errors. The joint estimate shrinks each law and its zero towards the common one accordingly. The
# uncertainty of the common law is common to all zeros. Presses whose laws differ in shape are not changed.
#
# Linear in the laws' errors; tau by moments (Paule and Mandel, J. Res. NBS 87 (1982) 377). Lengths in mm, N.

_MIN_COUNT = 3  # presses that determine a common law; tests.certificate.test_shared_contact_law
_MAX_SCATTER = 0.05  # of gains: beyond it a common law has little weight; test_shared_contact_law
_MAX_SIGMA = 4.0  # of chi-square beyond which laws differ in more than gains; test_shared_contact_law


@dataclass(frozen=True, slots=True, eq=False)
class _SharedLaw:
    """B (2,) in N/mm and N/mm², its covariance, tau, and whether the presses agree within it."""

    law: Floats
    covariance: Floats
    scatter: float
    fits: bool


def shared_contact_law(
    found: Mapping[str, ContactPoint], pace_mm_s: Mapping[str, float]
) -> dict[str, ContactPoint]:
    """Return the first contacts, each improved by the common law; unchanged where there is none."""
    own = {name: _by_travel(one, pace_mm_s[name]) for name, one in found.items()}
    laws = np.array([law for law, _ in own.values()]).reshape(-1, 2)
    spreads = np.array([spread for _, spread in own.values()]).reshape(-1, 3, 3)
    common = _shared_law(laws, spreads[:, 1:, 1:]) if len(found) >= _MIN_COUNT else None
    if common is None or not common.fits:
        return dict(found)
    return {
        name: _shrink(found[name], law, spread, common, pace_mm_s[name]) for name, (law, spread) in own.items()
    }


def _by_travel(one: ContactPoint, pace: float) -> tuple[Floats, Floats]:
    """Return b1, b2 over travel, and the covariance (3, 3) of the zero (mm) and them."""
    scale = np.array([pace, 1 / pace, pace**-2])
    return one.law * scale[1:], one.covariance * np.outer(scale, scale)


def _shared_law(laws: Floats, spreads: Floats) -> _SharedLaw:
    from scipy.optimize import brentq

    dof = 2 * (len(laws) - 1)
    alike, square = _at_scatter(laws, spreads, 0.0)
    if square <= dof:
        return alike
    apart, square = _at_scatter(laws, spreads, _MAX_SCATTER)
    if square > dof:
        return replace(apart, fits=square <= dof + _MAX_SIGMA * np.sqrt(2 * dof))
    scatter = brentq(lambda tau: _at_scatter(laws, spreads, tau)[1] - dof, 0.0, _MAX_SCATTER, xtol=1e-5)
    return _at_scatter(laws, spreads, float(scatter))[0]


def _at_scatter(laws: Floats, spreads: Floats, scatter: float) -> tuple[_SharedLaw, float]:
    """Return the common law for a given tau, and chi-square of the presses about it."""
    law = np.median(laws, axis=0)
    for _ in range(3):
        weights = np.linalg.inv(spreads + scatter**2 * np.outer(law, law))
        covariance = np.linalg.inv(weights.sum(axis=0))
        law = covariance @ np.einsum("kij,kj->i", weights, laws)
    apart = laws - law
    return _SharedLaw(law, covariance, scatter, True), float(np.einsum("ki,kij,kj->", apart, weights, apart))


def _shrink(one: ContactPoint, law: Floats, spread: Floats, common: _SharedLaw, pace: float) -> ContactPoint:
    whole = spread[1:, 1:] + common.scatter**2 * np.outer(common.law, common.law)
    pull = np.linalg.solve(whole, spread[1:, 0])
    zero = one.time_s + float(pull @ (common.law - law)) / pace
    own = max(float(spread[0, 0] - pull @ spread[1:, 0]), 0.0)
    shared = float(np.sqrt(pull @ common.covariance @ pull))
    return replace(one, time_s=zero, std_s=float(np.sqrt(own)) / pace, shared_s=shared / pace)


# Contact events of sound presses, placed by the travel scale of their bevel, and the force read there.

# mm: a rounded edge bends the law's first 20 um; by finite elements, edges of .05 to .15 mm move its zero by
# .1 to .5 um
FORM_MM = 0.0003
_AT_STOP = 3.0  # sigmas of travel and scale within which a stop stands at the event; test_certify


def apply_travel_scale(
    measurements: RecordingMeasurements,
    events: Mapping[str, ContactTimes],
    *,
    pile_up_ratios: Mapping[str, float],
    sound: Sequence[str],
) -> dict[str, ContactTimes]:
    """Return `events` with those of the `sound` presses where the travel scale of their bevel puts them.

    The motion stage is the scale where it was recorded, else the pace. Unchanged: presses whose first contact
    or pace is unknown, or whose bevel's scale does not fit. `pile_up_ratios`: the gel's rise at the bevel
    over the depth.
    """
    scaled = dict(events)
    staged = measurements.recording.stage is not None
    for group in _groups(measurements, events, sound).values():
        points = {
            name: _travel_point(measurements, events[name], travel, pile_up_ratios[name])
            for name, travel in group.items()
        }
        tilt_shift = float(np.median([point.tilt_shift_mm for point in points.values()]))
        points = {
            name: replace(point, tilt_shift_mm=point.tilt_shift_mm - tilt_shift) for name, point in points.items()
        }
        # their forces follow one law of the travel, within the examined range: up to a stop
        even = all(travel.shared_mm > 0 and not _stops(measurements, name) for name, travel in group.items())
        scale = fit_travel_scale(list(points.values()), scale=1.0 if staged else None, even=even)
        if scale is None:
            continue
        for (name, point), use in zip(points.items(), scale.used, strict=True):
            if use:
                scaled[name] = _moved(measurements, events[name], scale, group[name], point)
    return scaled


def _groups(
    measurements: RecordingMeasurements, events: Mapping[str, ContactTimes], sound: Sequence[str]
) -> dict[tuple[object, ...], dict[str, IndenterTravel]]:
    """Return the approaches of presses of one bevel and radius with a certain touch."""
    begun: dict[tuple[object, ...], dict[str, ContactPoint]] = {}
    for name in sound:
        one, window = events.get(name), measurements.windows[name]
        if one is None or one.touch is None or one.event is None or one.crossed is None or window is None:
            continue
        indenter = one.bevel_contact.press_signal.track.indenter
        if (
            one.touch.onset.gain <= DETECTION_CHI2
            or one.bevel_contact.distance_mm is None
            or not indenter.height_mm
        ):
            continue
        first = first_contact(window, one.crossed.time_s)
        if first is not None:
            key = indenter.bevel, one.bevel_contact.distance_mm, indenter.radius_mm
            begun.setdefault(key, {})[name] = first
    pace = _paces(measurements, sound)
    ways = {key: _travels(measurements, events, group, pace) for key, group in begun.items()}
    return {key: group for key, group in ways.items() if group}


def _travels(
    measurements: RecordingMeasurements,
    events: Mapping[str, ContactTimes],
    begun: Mapping[str, ContactPoint],
    pace_mm_s: Mapping[str, float],
) -> dict[str, IndenterTravel]:
    """Return the approaches, each from a first contact improved by the common law."""

    def ways(since: Mapping[str, ContactPoint]) -> dict[str, IndenterTravel]:
        found = {}
        for name, first in since.items():
            window, crossed = measurements.windows[name], events[name].crossed
            assert window is not None
            assert crossed is not None
            way = indenter_travel(window, first, stage=measurements.recording.stage, pace_mm_s=pace_mm_s[name])
            if way is not None and way.at(crossed.time_s) > 0:
                found[name] = way
        return found

    alone = ways(begun)
    return ways(
        shared_contact_law(
            {name: begun[name] for name in alone}, {name: way.pace_mm_s for name, way in alone.items()}
        )
    )


def _stops(measurements: RecordingMeasurements, name: str) -> bool:
    """Return whether the rig stopped on the way in."""
    window = measurements.windows[name]
    assert window is not None
    assert window.phases is not None
    return any(first < window.phases.hold for first, _ in window.dwells)


def _paces(measurements: RecordingMeasurements, names: Sequence[str]) -> dict[str, float]:
    """Return stated speeds; 1 for all where none is stated, which requires equal paces."""
    stated = {press.press: press.speed_mm_s for press in measurements.recording.presses if press.press in names}
    if not any(np.isfinite(speed) for speed in stated.values()):
        return dict.fromkeys(stated, 1.0)
    return stated


def _travel_point(
    measurements: RecordingMeasurements, one: ContactTimes, travel: IndenterTravel, pile_up_ratio: float
) -> TravelPoint:
    assert one.crossed is not None and one.touch is not None and one.event is not None  # noqa: PT018
    assert one.bevel_contact.distance_mm is not None
    track, onset = one.bevel_contact.press_signal.track, one.touch.onset
    indenter, window = track.indenter, measurements.windows[track.press.press]
    assert window is not None
    there = travel.at(one.crossed.time_s)
    scale = there / onset.at
    if one.event.dwell:  # the rig stopped about the touch: the force gives the distance from it
        there += scale * (
            onset.at - float(one.bevel_contact.law.depth(window.at(np.array([one.crossed.time_s])))[0])
        )
    own = scale**2 * max(onset.std**2 - onset.shared_std**2, 0.0) + travel.std_mm**2
    # an edge that was found lies anywhere in its window: seen beyond it, the touch is later by the bevel's fall
    shape = 0.0 if one.bevel_contact.distance_given else 0.5 * fill_mm(indenter)
    zero = float(np.hypot(travel.shared_mm, scale * FORM_MM))
    shared = (
        scale**2 * (onset.shared_std**2 + shape**2)
        + (travel.pace_mm_s * (measurements.offset.std or 0.0)) ** 2
        + zero**2
    )
    tilt_shift = float(face_tilt(track) @ np.array(SIDES[track.side])) * one.bevel_contact.distance_mm
    return TravelPoint(
        depth_mm=_height(indenter) / (1 + pile_up_ratio),
        travel_mm=there,
        own_std_mm=float(np.sqrt(own)),
        shared_std_mm=float(np.sqrt(shared)),
        force_N=float(one.event.force_N[2]),
        height=indenter.name,
        height_std_mm=indenter.height_std_mm / (1 + pile_up_ratio),
        tilt_shift_mm=tilt_shift / (1 + pile_up_ratio),
        zero_std_mm=zero,
    )


def _height(indenter: Indenter) -> float:
    assert indenter.height_mm is not None
    return indenter.height_mm


def _moved(
    measurements: RecordingMeasurements,
    one: ContactTimes,
    scale: TravelScale,
    travel: IndenterTravel,
    point: TravelPoint,
) -> ContactTimes:
    """Return the press with its event where the travel scale puts it, and the force read there."""
    assert one.crossed is not None
    assert one.touch is not None
    assert one.event is not None
    track = one.bevel_contact.press_signal.track
    window = measurements.windows[track.press.press]
    assert window is not None
    target = scale.travel_mm(point.depth_mm, point.force_N)
    beyond = target - travel.at(one.crossed.time_s)
    moving = max(travel.reached_s(target), float(travel.time_s[0]))
    off = scale.relative_std(one.bevel_contact.law.c_N_per_mm) * target
    sure = float(np.linalg.norm([travel.std_mm, travel.shared_mm, off]))
    if one.event.dwell and beyond > -_AT_STOP * sure:
        event = _beyond_stop(one, one.event, window, beyond / point.travel_mm * one.touch.onset.at)
        return replace(one, event=event, travel_scale=scale, stop_std_N=abs(_rate(one, window)) * travel.std_mm)
    crossed = replace(one.crossed, time_s=moving, std_s=travel.std_mm / travel.pace_mm_s, dwell_s=None)
    found = event_force(window, measurements.forces, crossed=crossed)
    if found is None:
        return one
    time_s = moving - measurements.offset_s
    touch = replace(
        one.touch,
        time_s=time_s,
        std_s=float(np.hypot(crossed.std_s, measurements.offset.std or 0.0)),
        depth_seen_mm=float(np.interp(time_s, track.time_s, track.depth_mm)),
        seen_s=one.touch.time_s,
    )
    return replace(one, crossed=crossed, touch=touch, event=found, travel_scale=scale, stop_std_N=0.0)


def _beyond_stop(one: ContactTimes, event: EventForce, window: ForceWindow, beyond_mm: float) -> EventForce:
    """Return the force of a stop extrapolated to a touch `beyond_mm` after it, along the press's own law."""
    force = event.force_N.copy()
    force[2] += _rate(one, window) * beyond_mm
    return replace(event, force_N=force)


def _rate(one: ContactTimes, window: ForceWindow) -> float:
    """Return the force per driving depth (N/mm) where the rig stood."""
    assert one.crossed is not None
    law = one.bevel_contact.law
    depth = float(law.depth(window.at(np.array([one.crossed.time_s])))[0])
    return float(law.force(depth + 1e-3) - law.force(depth)) / 1e-3
