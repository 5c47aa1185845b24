"""From what was seen and felt of every press to points, curves and evidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tactilevision.certificate.certificate import Certificate
from tactilevision.certificate.certified_point import certified_point, judge_point
from tactilevision.certificate.depth.curves import press_curve
from tactilevision.certificate.depth.depth_scale import find_depth_scale, scale_warning
from tactilevision.certificate.depth.pile_up import PileUp
from tactilevision.certificate.depth.press_pile_ups import press_pile_ups
from tactilevision.certificate.evidence import evidence_of
from tactilevision.certificate.recording_statistics import lean_scatter, recording_statistics
from tactilevision.certificate.rejection import Finding, PressEvidence, rejection_reasons
from tactilevision.certificate.touch.apply_travel_scale import apply_travel_scale
from tactilevision.certificate.touch.bevel_contact_depth import SURE
from tactilevision.certificate.touch.contact_times import Chain, ContactTimes, contact_times
from tactilevision.certificate.touch.force_crossing import force_crossing
from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.recording.names import some

_UNSEEN = Finding("dropped_frames", "fewer than two sound frames show this press")


def assemble_certificate(chain: Chain) -> Certificate:
    """Points, curves and evidence of every press."""
    timed = contact_times(chain)
    rises = press_pile_ups(timed, chain.recording.sensor.gel)
    looks = _looks(chain, timed, rises)
    first = _said(chain, looks)
    # frames may be missing where a touch was seen, and not where the ruler puts it
    sound = [
        name
        for name, against in first.items()
        if name not in chain.strays and all(one.reason == "dropped_frames" for one in against)
    ]
    timed = apply_travel_scale(chain, timed, {name: rise.ratio for name, rise in rises.items()}, sound)
    looks = _looks(chain, timed, rises)
    said = _said(chain, looks)
    leans = lean_scatter([look for name, look in looks.items() if not said[name]], recording_statistics(looks))
    points = []
    for press in chain.recording.presses:
        name = press.press
        point = certified_point(
            chain, press, timed.get(name), rises.get(name), looks.get(name), tilt_scatter_rad=leans
        )
        points.append(judge_point(point, said.get(name, (_UNSEEN,))))
    faces = [
        (touch.depth_seen_mm, point.depth_mm)
        for point in points
        if point.accepted and (touch := looks[point.press].touch) is not None
    ]
    gauge = find_depth_scale(faces)
    doubts = filter(None, [scale_warning(faces, [ball.ball_radius_mm for ball in chain.recording.balls])])
    seen = [(looks[point.press], point) for point in points if point.press in looks]
    curves = [
        press_curve(look.track, look.force, point, touch=look.touch, offset_s=look.offset_s, gauge=gauge)
        for look, point in seen
    ]
    evidence = {
        point.press: evidence_of(chain.recording, chain.reconstructor, look, said[point.press])
        for look, point in seen
    }
    given = next((t.touched for t in timed.values()), None)
    return Certificate(
        points=tuple(points),
        curves=tuple(curve for curve in curves if curve is not None),
        clock_offset=chain.offset,
        evidence=evidence,
        rise=next(iter(rises.values()), None),
        bevel_distance_mm=given.distance_mm if given else None,
        gauge=gauge,
        warnings=(*_warnings(chain, timed, rises), *doubts),
    )


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
