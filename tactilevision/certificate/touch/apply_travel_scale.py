"""Contact events of sound presses, placed by the travel scale of their bevel, and the force read there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tactilevision.certificate.force.contact_point import ContactPoint
from tactilevision.certificate.force.event_force import EventForce
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2, fill_mm
from tactilevision.certificate.touch.contact_times import ContactTimes, RecordingMeasurements
from tactilevision.certificate.touch.force_crossing import event_force
from tactilevision.certificate.touch.indenter_travel import IndenterTravel, first_contact, indenter_travel
from tactilevision.certificate.touch.press_track import face_tilt
from tactilevision.certificate.touch.shared_contact_law import shared_contact_law
from tactilevision.certificate.touch.travel_scale import TravelPoint, TravelScale, fit_travel_scale
from tactilevision.contact.bevel import SIDES
from tactilevision.records import Indenter

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
    """`events` with those of the `sound` presses where the travel scale of their bevel puts them.

    The motion stage is the scale where it was recorded, else the pace. As they were: presses whose first contact
    or pace is not known, or whose bevel's scale does not fit. `pile_up_ratios`: the gel's rise at the bevel
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
        # their forces follow one law of the travel, as far as that was looked at: up to a stop
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
    """The ways in of presses of one bevel and radius that came to a sure touch."""
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
    """The ways in, each since a first contact that knows the law of the others."""

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
    """Whether the rig stopped on the way in."""
    window = measurements.windows[name]
    assert window is not None
    assert window.phases is not None
    return any(first < window.phases.hold for first, _ in window.dwells)


def _paces(measurements: RecordingMeasurements, names: Sequence[str]) -> dict[str, float]:
    """Stated speeds; 1 for all where none is stated, which asks for presses that come alike."""
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
    if one.event.dwell:  # the rig stopped about the touch: how far from it, the force tells
        there += scale * (
            onset.at - float(one.bevel_contact.law.depth(window.at(np.array([one.crossed.time_s])))[0])
        )
    own = scale**2 * max(onset.std**2 - onset.shared_std**2, 0.0) + travel.std_mm**2
    # an edge that was found lies anywhere in its window: seen beyond it, the touch comes by the bevel's fall later
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
    """The press with its event where the travel scale puts it, and the force read there."""
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
    """The force of a stop carried on to a touch `beyond_mm` behind it, along the press's own law."""
    force = event.force_N.copy()
    force[2] += _rate(one, window) * beyond_mm
    return replace(event, force_N=force)


def _rate(one: ContactTimes, window: ForceWindow) -> float:
    """Force per driving depth (N/mm) where the rig stood."""
    assert one.crossed is not None
    law = one.bevel_contact.law
    depth = float(law.depth(window.at(np.array([one.crossed.time_s])))[0])
    return float(law.force(depth + 1e-3) - law.force(depth)) / 1e-3
