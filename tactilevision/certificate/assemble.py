"""From what was seen and felt of every press to points, curves and evidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from tactilevision.certificate.certificate import Certificate, ContactEvent, Finding
from tactilevision.certificate.depth.curves import press_curve
from tactilevision.certificate.depth.depth_scale import find_depth_scale, scale_warning
from tactilevision.certificate.depth.edge_profile import edge_profile
from tactilevision.certificate.depth.pile_up import (
    PileUp,
    blur_place,
    combine,
    computed_ratio,
    depth_std,
    map_error,
    press_pile_up,
    seen_ratio,
    unknown_pile_up,
)
from tactilevision.certificate.depth.surface_beside_punch import ring_gain_std
from tactilevision.certificate.evidence import evidence_of
from tactilevision.certificate.force.event_force import EventForce
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.recording_statistics import lean_scatter, recording_statistics
from tactilevision.certificate.rejection import PressEvidence, rejection_reasons
from tactilevision.certificate.touch.apply_travel_scale import apply_travel_scale
from tactilevision.certificate.touch.bevel_contact_depth import SURE
from tactilevision.certificate.touch.contact_times import Chain, ContactTimes, contact_times
from tactilevision.certificate.touch.force_crossing import ForceCrossing, force_crossing
from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.contact.bevel import mean_distance_mm
from tactilevision.photometric.card import MethodCard
from tactilevision.recording.names import some
from tactilevision.records import CertifiedPoint, Press
from tactilevision.uncertainty.depth import gain_std

_GENTLE = 0.3  # a slope that most calibrations hold
_UNSEEN = Finding("dropped_frames", "fewer than two sound frames show this press")


def assemble_certificate(chain: Chain) -> Certificate:
    """Points, curves and evidence of every press."""
    timed = contact_times(chain)
    rises = _rises(chain, timed)
    looks = _looks(chain, timed, rises)
    first = _said(chain, looks)
    # frames may be missing where a touch was seen, and not where the ruler puts it
    sound = [
        name
        for name, against in first.items()
        if name not in chain.strays and all(one.reason == "dropped_frames" for one in against)
    ]
    timed = apply_travel_scale(chain, timed, rises, sound)
    looks = _looks(chain, timed, rises)
    said = _said(chain, looks)
    leans = lean_scatter([look for name, look in looks.items() if not said[name]], recording_statistics(looks))
    points = []
    for press in chain.recording.presses:
        point = _point(
            chain, press, timed.get(press.press), rises.get(press.press), looks.get(press.press), leans_rad=leans
        )
        points.append(_judged(point, said.get(press.press, (_UNSEEN,))))
    faces = [
        (touch.depth_seen_mm, point.depth_mm)
        for point in points
        if point.accepted and (touch := looks[point.press].touch) is not None
    ]
    gauge = find_depth_scale(faces)
    doubts = filter(None, [scale_warning(faces, [ball.ball_radius_mm for ball in chain.recording.balls])])
    seen = [(looks[point.press], point) for point in points if point.press in looks]
    curves = [curve for look, point in seen if (curve := press_curve(look, point, gauge)) is not None]
    evidence = {
        point.press: evidence_of(chain.recording, chain.reconstructor, look, said[point.press])
        for look, point in seen
    }
    given = next((t.touched for t in timed.values()), None)
    return Certificate(
        points=tuple(points),
        curves=tuple(curves),
        clock_offset=chain.offset,
        evidence=evidence,
        rise=next(iter(rises.values()), None),
        bevel_distance_mm=given.distance_mm if given else None,
        gauge=gauge,
        warnings=(*_warnings(chain, timed, rises), *doubts),
    )


def _rises(chain: Chain, timed: Mapping[str, ContactTimes]) -> dict[str, PileUp]:
    """Rise at the bevel's edge for each press: seen in all presses of its bevel, computed for its own depth."""
    found: dict[float, list[tuple[np.ndarray, np.ndarray]]] = {}
    scales, errors = [], []
    for one in timed.values():
        distance, case = one.touched.distance_mm, one.touched.case
        if one.touch is None or one.touch.onset.gain <= SURE or distance is None:
            continue
        height = case.track.indenter.height_mm
        scales += [one.touch.depth_seen_mm / height] if height else []
        beside = mean_distance_mm(distance)
        before = case.use & (case.drive < one.touch.onset.at)
        single = press_pile_up(case.track, case.drive, before, distance_mm=beside)
        if single is not None:
            found.setdefault(distance, []).append(single)
            errors.append(map_error(case.track, case.drive, distance_mm=beside))
    scale_std = float(np.sqrt(np.mean((np.array(scales) - 1) ** 2))) if scales else 0.25
    known = [error for error in errors if np.isfinite(error)]
    map_std = float(np.median(known)) if known else 0.0
    rises, gel = {}, chain.recording.sensor.gel
    for name, one in timed.items():
        distance, indenter = one.touched.distance_mm, one.touched.case.track.indenter
        if distance is None or not indenter.height_mm:
            rises[name] = unknown_pile_up()
            continue
        beside = mean_distance_mm(distance)
        computed = computed_ratio(gel, indenter, distance_mm=beside)
        seen = seen_ratio(found.get(distance, []), scale_std=scale_std, map_std=map_std)
        rise = combine(seen, computed)
        rises[name] = rise if one.touched.distance_given else blur_place(rise, gel, indenter, distance_mm=beside)
    return rises


def _said(chain: Chain, looks: Mapping[str, PressEvidence]) -> dict[str, tuple[Finding, ...]]:
    usual = recording_statistics(looks)
    return {
        name: _astray(chain, name) + rejection_reasons(look, usual, chain.forces) for name, look in looks.items()
    }


def _astray(chain: Chain, name: str) -> tuple[Finding, ...]:
    """A force that is read at the wrong time says nothing, and may look like one that is saturated."""
    if name not in chain.strays:
        return ()
    text = (
        f"depth and force go together only at another offset of the clocks, {chain.strays[name]:+.2f} s from here"
    )
    return (Finding("dropped_frames", text),)


def _looks(
    chain: Chain, timed: Mapping[str, ContactTimes], rises: Mapping[str, PileUp]
) -> dict[str, PressEvidence]:
    return {
        name: _look(chain, track, timed.get(name), rises.get(name))
        for name, track in chain.tracks.items()
        if track is not None
    }


def _look(chain: Chain, track: PressTrack, timed: ContactTimes | None, rise: PileUp | None) -> PressEvidence:
    name, window = track.press.press, chain.windows[track.press.press]
    touch, event = (timed.touch, timed.event) if timed else (None, None)
    expected = (track.indenter.height_mm or float("nan")) / (1 + (rise.ratio if rise else 0.0))
    event_s = float("nan")
    if touch is not None and touch.onset.gain > SURE:
        event_s = touch.time_s
    elif timed is not None and window is not None and np.isfinite(expected):
        due = force_crossing(window, float(timed.touched.law.force(expected)), 0.0)
        event_s = due.time_s - chain.offset_s if due is not None else float("nan")
    return PressEvidence(track=track, force=window, touch=touch, event=event, event_s=event_s, depth_mm=expected,
                distance_mm=timed.touched.distance_mm if timed else track.indenter.bevel_distance_mm,
                rest_s=chain.rest_s[name], offset_s=chain.offset_s)  # fmt: skip


def _shared_touch(timed: ContactTimes) -> float:
    """What all depths are off by alike: the ruler's zero, or the shape of the growing dent; a stop is its own."""
    assert timed.touch is not None
    assert timed.event is not None
    if timed.ruler is not None:
        return timed.ruler.zero_std_mm
    return 0.0 if timed.event.dwell else timed.touch.onset.shared_std


def _point(
    chain: Chain,
    press: Press,
    timed: ContactTimes | None,
    rise: PileUp | None,
    look: PressEvidence | None,
    *,
    leans_rad: float,
) -> CertifiedPoint:
    """The point of one press before its verdict; `leans_rad`: what faces lean by from press to press."""
    indenter = chain.recording.indenters[press.indenter]
    height = indenter.height_mm if indenter.height_mm is not None else float("nan")
    rise = rise or unknown_pile_up()
    depth = height / (1 + rise.ratio)
    distance = look.distance_mm if look is not None else None
    lean_std = leans_rad * (distance or 0.0) / (1 + rise.ratio)
    std = depth_std(depth, rise, height_std_mm=indenter.height_std_mm, lean_std_mm=lean_std)
    extra: dict[str, object] = {"rise_ratio": rise.ratio, "rise_ratio_std": rise.std, "lean_std_mm": lean_std}
    force, force_std, time_s = np.full(3, np.nan), float("nan"), float("nan")
    if timed is not None and timed.touch is not None and timed.event is not None and timed.crossed is not None:
        force, time_s = timed.event.force_N, timed.touch.time_s
        force_std = _force_std(chain.windows[press.press], timed, timed.event, timed.crossed)
        extra |= _felt(chain, timed, timed.touch, timed.event)
        if timed.ruler is not None:
            ratio = timed.ruler.relative_std(timed.touched.law.c_N_per_mm)
            std = depth_std(depth, rise, height_std_mm=indenter.height_std_mm, ruler_std=ratio)
            extra |= {
                "ruler_std": ratio,
                "touches_late_mm": timed.ruler.late_mm,
                "touches_late_std_mm": timed.ruler.late_std_mm,
            }
    if look is not None and look.track.footprint is not None:
        face = look.track.footprint
        extra |= {
            "centre_x_mm": face.centre_mm[0],
            "centre_y_mm": face.centre_mm[1],
            "face_radius_mm": face.radius_mm,
            "tilt_x": face.tilt[0],
            "tilt_y": face.tilt[1],
        }
    return CertifiedPoint(
        press=press.press, indenter=press.indenter, depth_mm=depth, fz_N=float(force[2]), depth_std_mm=std,
        fz_std_N=force_std, fx_N=float(force[0]), fy_N=float(force[1]), time_s=time_s,
        depth_uncorrected_mm=height, rest_s=chain.rest_s[press.press], speed_mm_s=press.speed_mm_s,
        x_mm=press.x_mm, y_mm=press.y_mm, extra=extra,
    )  # fmt: skip


def _force_std(
    window: ForceWindow | None, timed: ContactTimes, event: EventForce, crossed: ForceCrossing
) -> float:
    """Of fz at the touch: its readings, the force's zero, and when it was."""
    tare = float(window.tare.std_N[2]) if window is not None and window.tare.known else 0.0
    from_time = timed.stop_std_N if event.dwell else event.rate_N_s * crossed.std_s
    return float(np.sqrt(event.std_N[2] ** 2 + tare**2 + from_time**2))


def _felt(chain: Chain, timed: ContactTimes, touch: ContactEvent, event: EventForce) -> dict[str, object]:
    """What is kept of a touch beside its depth and force."""
    return {
        "touch_std_s": touch.std_s,
        "touch_shared_std_mm": _shared_touch(timed),
        "touch_channel": touch.channel,
        "touch_sigmas": touch.onset.gain**0.5,
        "force_readings": event.readings,
        "force_dwell": int(event.dwell),
        "reconstructed_depth_mm": touch.depth_seen_mm,
        "reconstructed_std_mm": touch.depth_seen_mm * _shared_std(chain, timed.touched.case.track),
        **_beside(chain, timed, touch),
    }


def _beside(chain: Chain, timed: ContactTimes, touch: ContactEvent) -> dict[str, float]:
    """The falls of the gel beside the face, what a quarter's slopes may be off by (relative), and the steepest
    slope that the light was made from; nothing where none is seen.
    """
    track = timed.touched.case.track
    falls = edge_profile(track, touch, bevel_distance_mm=timed.touched.distance_mm)
    method = getattr(chain.reconstructor, "method", None)
    steepest = float(getattr(method, "card", {}).get("steepest_slope", _GENTLE))
    return {**falls, "slope_gain_std": ring_gain_std(method), "ball_slope": steepest} if falls else {}


def _shared_std(chain: Chain, track: PressTrack) -> float:
    """How far off a face's reconstructed depth may be in all presses alike, relative; NaN where no map says.

    The height map's std counts the scale of a single ball as unsure; what all presses share is the scale's mean
    over the balls that it was made from.
    """
    face, seen = track.footprint, track.face_map
    if face is None or seen.std_mm is None:
        return float("nan")
    inside = face.mask & seen.valid & (seen.depth_mm > 0)
    if not inside.any():
        return float("nan")
    whole = float(np.median(seen.std_mm[inside] / seen.depth_mm[inside]))
    card = getattr(getattr(chain.reconstructor, "method", None), "card", MethodCard())
    single, balls = gain_std(card, 0.0), max(float(card.balls or 1), 1.0)
    rest = max(whole**2 - single**2, 0.0)
    return float(np.sqrt(rest + single**2 / balls))


def _judged(point: CertifiedPoint, said: tuple[Finding, ...]) -> CertifiedPoint:
    """The point with its verdict; all findings are kept in `extra`."""
    if not said and not np.isfinite(point.fz_N):
        said = (Finding("bevel_not_touched", "no force could be read at the touch"),)
    if not said:
        return point
    every = {"findings": "; ".join(f"{finding.reason}: {finding.text}" for finding in said)}
    return replace(point, accepted=False, reason=said[0].reason, extra={**point.extra, **every})


def _warnings(chain: Chain, timed: Mapping[str, ContactTimes], rises: Mapping[str, PileUp]) -> Iterator[str]:
    yield from chain.notes
    if chain.offset.value is None:
        yield f"The clocks could not be aligned ({chain.offset.why}); they are taken to agree."
    torn = [bad.name for track in chain.tracks.values() if track is not None for bad in track.missing]
    if torn:
        yield f"Frames that cannot be read were passed over: {some(torn)}."
    untared = [name for name, window in chain.windows.items() if window is not None and not window.tare.known]
    if untared:
        yield f"No force reading of the free gel for presses {', '.join(untared)}: their zero is as recorded."
    if any(t.touched.distance_mm is not None and not t.touched.distance_given for t in timed.values()):
        place = next(t.touched.distance_mm for t in timed.values() if t.touched.distance_mm is not None)
        yield f"The bevel's edge is not stated; it was found at {place:.1f} mm from the axis."
    if any(t.touched.distance_mm is None for t in timed.values()):
        yield (
            "The bevel's place is neither stated nor seen: depths are the machined heights, which may be "
            "too deep by up to 13 %."
        )
    contrary = [rise for rise in rises.values() if rise.disagreement > 3]
    if contrary:
        seen, computed = contrary[0].seen, contrary[0].computed
        assert seen is not None
        assert computed is not None
        yield (
            f"The gel's rise at the bevel is {seen[0]:.3f} of the depth in the height map and {computed[0]:.3f} "
            "as computed: they contradict each other, and the uncertainty of the depths was widened."
        )
