"""The touches of the sound presses put on the ruler of their way in, and the force read there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tactilevision.certificate.force.contact_point import ContactPoint
from tactilevision.certificate.force.event_force import EventForce
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.touch.bevel_contact_depth import SURE, fill_mm
from tactilevision.certificate.touch.contact_times import Chain, ContactTimes
from tactilevision.certificate.touch.force_crossing import event_force
from tactilevision.certificate.touch.indenter_travel import IndenterTravel, begin_of, indenter_travel
from tactilevision.certificate.touch.press_track import face_tilt
from tactilevision.certificate.touch.shared_contact_law import shared_contact_law
from tactilevision.certificate.touch.travel_scale import TravelPoint, TravelScale, fit_travel_scale
from tactilevision.contact.bevel import SIDES
from tactilevision.records import Indenter

# A rounded edge bends the law's first 20 um: by finite elements, edges of .05 to .15 mm move its zero by .1 to .5.
FORM_MM = 0.0003
_AT_STOP = 3.0  # sigmas of travel and ruler within which a stop stands at the touch


def apply_travel_scale(
    chain: Chain, timed: Mapping[str, ContactTimes], pile_up_ratios: Mapping[str, float], sound: Sequence[str]
) -> dict[str, ContactTimes]:
    """`timed` with the touches of the `sound` presses where the ruler of their bevel puts them.

    The motion stage is the ruler where it was recorded, else the pace. As they were: presses whose first contact
    or pace is not known, or whose bevel's ruler does not fit. `pile_up_ratios`: the gel's rise at the bevel
    over the depth.
    """
    ruled = dict(timed)
    staged = chain.recording.stage is not None
    for group in _groups(chain, timed, sound).values():
        marks = {name: _mark(chain, timed[name], travel, pile_up_ratios[name]) for name, travel in group.items()}
        lean = float(np.median([mark.lean_mm for mark in marks.values()]))
        marks = {name: replace(mark, lean_mm=mark.lean_mm - lean) for name, mark in marks.items()}
        # their forces follow one law of the travel, as far as that was looked at: up to a stop
        even = all(travel.shared_mm > 0 and not _stops(chain, name) for name, travel in group.items())
        ruler = fit_travel_scale(list(marks.values()), scale=1.0 if staged else None, even=even)
        if ruler is None:
            continue
        for (name, mark), use in zip(marks.items(), ruler.used, strict=True):
            if use:
                ruled[name] = _moved(chain, timed[name], ruler, group[name], mark)
    return ruled


def _groups(
    chain: Chain, timed: Mapping[str, ContactTimes], sound: Sequence[str]
) -> dict[tuple[object, ...], dict[str, IndenterTravel]]:
    """The ways in of presses of one bevel and radius that came to a sure touch."""
    begun: dict[tuple[object, ...], dict[str, ContactPoint]] = {}
    for name in sound:
        one, window = timed.get(name), chain.windows[name]
        if one is None or one.touch is None or one.event is None or one.crossed is None or window is None:
            continue
        indenter = one.touched.case.track.indenter
        if one.touch.onset.gain <= SURE or one.touched.distance_mm is None or not indenter.height_mm:
            continue
        first = begin_of(window, one.crossed.time_s)
        if first is not None:
            key = indenter.bevel, one.touched.distance_mm, indenter.radius_mm
            begun.setdefault(key, {})[name] = first
    pace = _paces(chain, sound)
    ways = {key: _travels(chain, timed, group, pace) for key, group in begun.items()}
    return {key: group for key, group in ways.items() if group}


def _travels(
    chain: Chain,
    timed: Mapping[str, ContactTimes],
    begun: Mapping[str, ContactPoint],
    pace_mm_s: Mapping[str, float],
) -> dict[str, IndenterTravel]:
    """The ways in, each since a first contact that knows the law of the others."""

    def ways(since: Mapping[str, ContactPoint]) -> dict[str, IndenterTravel]:
        found = {}
        for name, first in since.items():
            window, crossed = chain.windows[name], timed[name].crossed
            assert window is not None
            assert crossed is not None
            way = indenter_travel(window, first, stage=chain.recording.stage, pace_mm_s=pace_mm_s[name])
            if way is not None and way.at(crossed.time_s) > 0:
                found[name] = way
        return found

    alone = ways(begun)
    return ways(
        shared_contact_law(
            {name: begun[name] for name in alone}, {name: way.pace_mm_s for name, way in alone.items()}
        )
    )


def _stops(chain: Chain, name: str) -> bool:
    """Whether the rig stopped on the way in."""
    window = chain.windows[name]
    assert window is not None
    assert window.phases is not None
    return any(first < window.phases.hold for first, _ in window.dwells)


def _paces(chain: Chain, names: Sequence[str]) -> dict[str, float]:
    """Stated speeds; 1 for all where none is stated, which asks for presses that come alike."""
    stated = {press.press: press.speed_mm_s for press in chain.recording.presses if press.press in names}
    if not any(np.isfinite(speed) for speed in stated.values()):
        return dict.fromkeys(stated, 1.0)
    return stated


def _mark(chain: Chain, one: ContactTimes, travel: IndenterTravel, pile_up_ratio: float) -> TravelPoint:
    assert one.crossed is not None
    assert one.touch is not None
    assert one.event is not None
    assert one.touched.distance_mm is not None
    track, onset = one.touched.case.track, one.touch.onset
    indenter, window = track.indenter, chain.windows[track.press.press]
    assert window is not None
    there = travel.at(one.crossed.time_s)
    scale = there / onset.at
    if one.event.dwell:  # the rig stopped about the touch: how far from it, the force tells
        there += scale * (onset.at - float(one.touched.law.depth(window.at(np.array([one.crossed.time_s])))[0]))
    own = scale**2 * max(onset.std**2 - onset.shared_std**2, 0.0) + travel.std_mm**2
    # an edge that was found lies anywhere in its window: seen beyond it, the touch comes by the bevel's fall later
    shape = 0.0 if one.touched.distance_given else 0.5 * fill_mm(indenter)
    zero = float(np.hypot(travel.shared_mm, scale * FORM_MM))
    shared = (
        scale**2 * (onset.shared_std**2 + shape**2) + (travel.pace_mm_s * (chain.offset.std or 0.0)) ** 2 + zero**2
    )
    lean = float(face_tilt(track) @ np.array(SIDES[track.side])) * one.touched.distance_mm
    return TravelPoint(
        depth_mm=_height(indenter) / (1 + pile_up_ratio),
        travel_mm=there,
        own_std_mm=float(np.sqrt(own)),
        shared_std_mm=float(np.sqrt(shared)),
        force_N=float(one.event.force_N[2]),
        height=indenter.name,
        height_std_mm=indenter.height_std_mm / (1 + pile_up_ratio),
        lean_mm=lean / (1 + pile_up_ratio),
        zero_std_mm=zero,
    )


def _height(indenter: Indenter) -> float:
    assert indenter.height_mm is not None
    return indenter.height_mm


def _moved(
    chain: Chain, one: ContactTimes, ruler: TravelScale, travel: IndenterTravel, mark: TravelPoint
) -> ContactTimes:
    """The press with its touch where the ruler puts it, and the force read there."""
    assert one.crossed is not None
    assert one.touch is not None
    assert one.event is not None
    track = one.touched.case.track
    window = chain.windows[track.press.press]
    assert window is not None
    target = ruler.travel_mm(mark.depth_mm, mark.force_N)
    beyond = target - travel.at(one.crossed.time_s)
    moving = max(travel.reached_s(target), float(travel.time_s[0]))
    off = ruler.relative_std(one.touched.law.c_N_per_mm) * target
    sure = float(np.linalg.norm([travel.std_mm, travel.shared_mm, off]))
    if one.event.dwell and beyond > -_AT_STOP * sure:
        event = _beyond_stop(one, one.event, window, beyond / mark.travel_mm * one.touch.onset.at)
        return replace(one, event=event, ruler=ruler, stop_std_N=abs(_rate(one, window)) * travel.std_mm)
    crossed = replace(one.crossed, time_s=moving, std_s=travel.std_mm / travel.pace_mm_s, dwell_s=None)
    found = event_force(window, chain.forces, crossed)
    if found is None:
        return one
    time_s = moving - chain.offset_s
    touch = replace(
        one.touch,
        time_s=time_s,
        std_s=float(np.hypot(crossed.std_s, chain.offset.std or 0.0)),
        depth_seen_mm=float(np.interp(time_s, track.time_s, track.depth_mm)),
    )
    return replace(one, crossed=crossed, touch=touch, event=found, ruler=ruler, stop_std_N=0.0)


def _beyond_stop(one: ContactTimes, event: EventForce, window: ForceWindow, beyond_mm: float) -> EventForce:
    """The force of a stop carried on to a touch `beyond_mm` behind it, along the press's own law."""
    force = event.force_N.copy()
    force[2] += _rate(one, window) * beyond_mm
    return replace(event, force_N=force)


def _rate(one: ContactTimes, window: ForceWindow) -> float:
    """Force per driving depth (N/mm) where the rig stood."""
    assert one.crossed is not None
    law = one.touched.law
    depth = float(law.depth(window.at(np.array([one.crossed.time_s])))[0])
    return float(law.force(depth + 1e-3) - law.force(depth)) / 1e-3
