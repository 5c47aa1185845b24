"""Certificate of a recording: points, curves and evidence from the measurements of every press."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from tactilevision.certificate.certificate import Certificate
from tactilevision.certificate.certified_point import certified_point, judge_point
from tactilevision.certificate.common_tilt import tilt_warning
from tactilevision.certificate.depth.certified_faces import certified_of
from tactilevision.certificate.depth.curves import press_curve
from tactilevision.certificate.depth.depth_scale import find_depth_scale
from tactilevision.certificate.depth.pile_up import PileUp
from tactilevision.certificate.depth.press_pile_ups import press_pile_ups
from tactilevision.certificate.depth.scale_doubt import doubt_of_scale
from tactilevision.certificate.evidence import evidence_of
from tactilevision.certificate.recording_statistics import recording_statistics, tilt_scatter_to_bevel
from tactilevision.certificate.rejection import Finding, PressEvidence, rejection_reasons
from tactilevision.certificate.touch.apply_travel_scale import apply_travel_scale
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2
from tactilevision.certificate.touch.contact_times import ContactTimes, RecordingMeasurements, contact_times
from tactilevision.certificate.touch.force_crossing import force_crossing
from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.recording.names import some
from tactilevision.records import CertifiedPoint

UNSEEN_PRESS = Finding("dropped_frames", "fewer than two sound frames show this press")


def assemble_certificate(measurements: RecordingMeasurements) -> Certificate:
    """Points, curves and evidence of every press."""
    events = contact_times(measurements)
    pile_ups = press_pile_ups(events, measurements.recording.sensor.gel)
    first = _findings(measurements, _press_evidence(measurements, events, pile_ups))
    # frames may be missing where an event was seen, and not where the travel scale puts it
    sound = [
        name
        for name, against in first.items()
        if name not in measurements.clock_outliers and all(one.reason == "dropped_frames" for one in against)
    ]
    ratios = {name: pile_up.ratio for name, pile_up in pile_ups.items()}
    events = apply_travel_scale(measurements, events, pile_up_ratios=ratios, sound=sound)
    evidence = _press_evidence(measurements, events, pile_ups)
    findings = _findings(measurements, evidence)
    points = _points(measurements, events, pile_ups, evidence, findings)
    faces = [
        (touch.depth_seen_mm, point.depth_mm)
        for point in points
        if point.accepted and (touch := evidence[point.press].touch) is not None
    ]
    given = next((one.bevel_contact for one in events.values()), None)
    doubt = doubt_of_scale(
        measurements.recording, measurements.reconstructor, pairs=faces, certified=certified_of(points)
    )
    askew = tilt_warning([evidence[point.press] for point in points if point.accepted])
    certificate = Certificate(
        points=points,
        curves=(),
        clock_offset=measurements.offset,
        evidence={},
        pile_ups=pile_ups,
        bevel_distance_mm=given.distance_mm if given else None,
        depth_scale=find_depth_scale(faces),
        warnings=(*_warnings(measurements, events, pile_ups), *(said for said in (doubt, askew) if said)),
    )
    return _with_presses(certificate, measurements, evidence, findings)


def _points(
    measurements: RecordingMeasurements,
    events: Mapping[str, ContactTimes],
    pile_ups: Mapping[str, PileUp],
    evidence: Mapping[str, PressEvidence],
    findings: Mapping[str, tuple[Finding, ...]],
) -> tuple[CertifiedPoint, ...]:
    """The point of every press with its verdict, in the recording's order."""
    sound = [one for name, one in evidence.items() if not findings[name]]
    tilt_scatter = tilt_scatter_to_bevel(sound, recording_statistics(evidence))
    points = []
    for press in measurements.recording.presses:
        name = press.press
        known = (events.get(name), pile_ups.get(name), evidence.get(name))
        point = certified_point(measurements, press, *known, tilt_scatter_rad=tilt_scatter)
        points.append(judge_point(point, findings.get(name, (UNSEEN_PRESS,))))
    return tuple(points)


def _with_presses(
    certificate: Certificate,
    measurements: RecordingMeasurements,
    evidence: Mapping[str, PressEvidence],
    findings: Mapping[str, tuple[Finding, ...]],
) -> Certificate:
    """The certificate with the curve and the evidence of every press that was seen."""
    seen = [(evidence[point.press], point) for point in certificate.points if point.press in evidence]
    scale = certificate.depth_scale
    curves = [
        press_curve(one.track, one.force, point=point, touch=one.touch, offset_s=one.offset_s, depth_scale=scale)
        for one, point in seen
    ]
    recording, reconstructor = measurements.recording, measurements.reconstructor
    return replace(
        certificate,
        curves=tuple(curve for curve in curves if curve is not None),
        evidence={
            point.press: evidence_of(recording, reconstructor, press_evidence=one, findings=findings[point.press])
            for one, point in seen
        },
    )


def _findings(
    measurements: RecordingMeasurements, press_evidence: Mapping[str, PressEvidence]
) -> dict[str, tuple[Finding, ...]]:
    statistics = recording_statistics(press_evidence)
    return {
        name: _clock_finding(measurements, name)
        + rejection_reasons(evidence, statistics, forces=measurements.forces)
        for name, evidence in press_evidence.items()
    }


def _clock_finding(measurements: RecordingMeasurements, name: str) -> tuple[Finding, ...]:
    """A force that is read at the wrong time says nothing, and may look like one that is saturated."""
    if name not in measurements.clock_outliers:
        return ()
    away = f"{measurements.clock_outliers[name]:+.2f} s from here"
    text = f"depth and force go together only at another offset of the clocks, {away}"
    return (Finding("dropped_frames", text),)


def _press_evidence(
    measurements: RecordingMeasurements, events: Mapping[str, ContactTimes], pile_ups: Mapping[str, PileUp]
) -> dict[str, PressEvidence]:
    return {
        name: _evidence(measurements, track, events.get(name), pile_ups.get(name))
        for name, track in measurements.tracks.items()
        if track is not None
    }


def _evidence(
    measurements: RecordingMeasurements, track: PressTrack, events: ContactTimes | None, pile_up: PileUp | None
) -> PressEvidence:
    name, window = track.press.press, measurements.windows[track.press.press]
    touch, event = (events.touch, events.event) if events else (None, None)
    expected = (track.indenter.height_mm or float("nan")) / (1 + (pile_up.ratio if pile_up else 0.0))
    event_s = float("nan")
    if touch is not None and touch.onset.gain > DETECTION_CHI2:
        event_s = touch.time_s
    elif events is not None and window is not None and np.isfinite(expected):
        due = force_crossing(window, float(events.bevel_contact.law.force(expected)), level_std_N=0.0)
        event_s = due.time_s - measurements.offset_s if due is not None else float("nan")
    return PressEvidence(track=track, force=window, touch=touch, event=event, event_s=event_s, depth_mm=expected,
                distance_mm=events.bevel_contact.distance_mm if events else track.indenter.bevel_distance_mm,
                rest_s=measurements.rest_s[name], offset_s=measurements.offset_s)  # fmt: skip


def _warnings(
    measurements: RecordingMeasurements, events: Mapping[str, ContactTimes], pile_ups: Mapping[str, PileUp]
) -> Iterator[str]:
    yield from measurements.notes
    if measurements.offset.value is None:
        yield f"The clocks could not be aligned ({measurements.offset.why}); they are taken to agree."
    torn = [bad.name for track in measurements.tracks.values() if track is not None for bad in track.missing]
    if torn:
        yield f"Frames that cannot be read were passed over: {some(torn)}."
    untared = [
        name for name, window in measurements.windows.items() if window is not None and not window.tare.known
    ]
    if untared:
        yield f"No force reading of the free gel for presses {', '.join(untared)}: their zero is as recorded."
    if any(
        t.bevel_contact.distance_mm is not None and not t.bevel_contact.distance_given for t in events.values()
    ):
        place = next(
            t.bevel_contact.distance_mm for t in events.values() if t.bevel_contact.distance_mm is not None
        )
        yield f"The bevel's edge is not stated; it was found at {place:.1f} mm from the axis."
    if any(t.bevel_contact.distance_mm is None for t in events.values()):
        yield (
            "The bevel's place is neither stated nor seen: depths are the machined heights, which may be "
            "too deep by up to 13 %."
        )
    contrary = [pile_up for pile_up in pile_ups.values() if pile_up.disagreement > 3]
    if contrary:
        seen, computed = contrary[0].seen, contrary[0].computed
        assert seen is not None
        assert computed is not None
        yield (
            f"The gel's rise at the bevel is {seen[0]:.3f} of the depth in the height map and {computed[0]:.3f} "
            "as computed: they contradict each other, and the uncertainty of the depths was widened."
        )
