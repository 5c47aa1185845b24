"""The certified point of one press: its depth from the bevel, its force at the contact event, and their stds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactilevision.certificate.depth.edge_profile import edge_profile
from tactilevision.certificate.depth.pile_up import PileUp, depth_std, unknown_pile_up
from tactilevision.certificate.depth.slope_gain import shared_depth_std
from tactilevision.certificate.force.event_force import EventForce
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.rejection import Finding, PressEvidence
from tactilevision.certificate.touch.contact_event import ContactEvent
from tactilevision.certificate.touch.contact_times import ContactTimes, RecordingMeasurements
from tactilevision.certificate.touch.force_crossing import ForceCrossing
from tactilevision.records import CertificationDetails, CertifiedPoint, Indenter, Press


def certified_point(
    measurements: RecordingMeasurements,
    press: Press,
    times: ContactTimes | None,
    pile_up: PileUp | None,
    evidence: PressEvidence | None,
    *,
    tilt_scatter_rad: float,
) -> CertifiedPoint:
    """The point of one press before its verdict; `tilt_scatter_rad` of faces from press to press."""
    indenter, pile_up = measurements.recording.indenters[press.indenter], pile_up or unknown_pile_up()
    tilt_std = tilt_scatter_rad * ((evidence.distance_mm if evidence else None) or 0.0) / (1 + pile_up.ratio)
    details = CertificationDetails(
        pile_up_ratio=pile_up.ratio, pile_up_ratio_std=pile_up.std, tilt_std_mm=tilt_std
    )
    point = _point_of_depth(press, indenter, pile_up, _face_details(details, evidence))
    point = replace(point, rest_s=measurements.rest_s[press.press])
    if times is None or times.touch is None or times.event is None or times.crossed is None:
        return point
    force_std = _force_std(measurements.windows[press.press], times, times.event, times.crossed)
    method = getattr(measurements.reconstructor, "method", None)
    point = replace(_with_event(point, times, times.touch, times.event, method), fz_std_N=force_std)
    scale_std = point.details.travel_scale_std
    if not np.isfinite(scale_std):
        return point
    std = depth_std(point.depth_mm, pile_up, height_std_mm=indenter.height_std_mm, scale_std=scale_std)
    return replace(point, depth_std_mm=std)


def _point_of_depth(
    press: Press, indenter: Indenter, pile_up: PileUp, details: CertificationDetails
) -> CertifiedPoint:
    """The point with the depth that its bevel certifies, its force not known yet."""
    height = indenter.height_mm if indenter.height_mm is not None else float("nan")
    depth, height_std_mm = height / (1 + pile_up.ratio), indenter.height_std_mm
    return CertifiedPoint(
        press=press.press,
        indenter=press.indenter,
        depth_mm=depth,
        fz_N=float("nan"),
        depth_std_mm=depth_std(depth, pile_up, height_std_mm=height_std_mm, tilt_std_mm=details.tilt_std_mm),
        depth_uncorrected_mm=height,
        speed_mm_s=press.speed_mm_s,
        x_mm=press.x_mm,
        y_mm=press.y_mm,
        details=details,
    )


def _with_event(
    point: CertifiedPoint, times: ContactTimes, touch: ContactEvent, event: EventForce, method: object
) -> CertifiedPoint:
    """The point with force and time of its contact event, how they were read, and the gel beside the face."""
    track, distance_mm = times.bevel_contact.press_signal.track, times.bevel_contact.distance_mm
    return replace(
        point,
        fx_N=float(event.force_N[0]),
        fy_N=float(event.force_N[1]),
        fz_N=float(event.force_N[2]),
        time_s=touch.time_s,
        details=_event_details(point.details, times, touch, event, method),
        edge_profile=edge_profile(track, touch, bevel_distance_mm=distance_mm, method=method),
    )


def judge_point(point: CertifiedPoint, findings: tuple[Finding, ...]) -> CertifiedPoint:
    """The point with its verdict; its details keep all findings."""
    if not findings and not np.isfinite(point.fz_N):
        findings = (Finding("bevel_not_touched", "no force could be read at the touch"),)
    if not findings:
        return point
    text = "; ".join(f"{finding.reason}: {finding.text}" for finding in findings)
    details = replace(point.details, findings=text)
    return replace(point, accepted=False, reason=findings[0].reason, details=details)


def _force_std(
    window: ForceWindow | None, times: ContactTimes, event: EventForce, crossed: ForceCrossing
) -> float:
    """Std (N) of the normal force at the event: its readings, the force's zero, and when it was."""
    tare = float(window.tare.std_N[2]) if window is not None and window.tare.known else 0.0
    from_time = times.stop_std_N if event.dwell else event.rate_N_s * crossed.std_s
    return float(np.sqrt(event.std_N[2] ** 2 + tare**2 + from_time**2))


def _event_details(
    details: CertificationDetails, times: ContactTimes, touch: ContactEvent, event: EventForce, method: object
) -> CertificationDetails:
    """The details with those of the contact event, and of the travel scale that it was put on."""
    details = replace(
        details,
        contact_std_s=touch.std_s,
        contact_shared_std_mm=_shared_std(times, touch, event),
        contact_channel=touch.channel,
        contact_sigmas=touch.onset.gain**0.5,
        force_readings=event.readings,
        force_dwell=event.dwell,
        reconstructed_depth_mm=touch.depth_seen_mm,
        reconstructed_std_mm=touch.depth_seen_mm
        * shared_depth_std(times.bevel_contact.press_signal.track, method),
    )
    scale = times.travel_scale
    if scale is None:
        return details
    return replace(
        details,
        travel_scale_std=scale.relative_std(times.bevel_contact.law.c_N_per_mm),
        contact_delay_mm=scale.delay_mm,
        contact_delay_std_mm=scale.delay_std_mm,
    )


def _shared_std(times: ContactTimes, touch: ContactEvent, event: EventForce) -> float:
    """Std (mm) that all depths share: the travel scale's zero, or the growing dent's shape; 0 at a stop."""
    if times.travel_scale is not None:
        return times.travel_scale.zero_std_mm
    return 0.0 if event.dwell else touch.onset.shared_std


def _face_details(details: CertificationDetails, evidence: PressEvidence | None) -> CertificationDetails:
    """The details with place, radius and tilt of the face, where one is seen."""
    if evidence is None or evidence.track.footprint is None:
        return details
    face = evidence.track.footprint
    (x_mm, y_mm), (tilt_x, tilt_y) = face.centre_mm, face.tilt
    return replace(
        details,
        centre_x_mm=x_mm,
        centre_y_mm=y_mm,
        face_radius_mm=face.radius_mm,
        tilt_x=tilt_x,
        tilt_y=tilt_y,
    )
