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
from tactilevision.certificate.touch.contact_times import Chain, ContactTimes
from tactilevision.certificate.touch.force_crossing import ForceCrossing
from tactilevision.records import CertificationDetails, CertifiedPoint, EdgeProfile, Press


def certified_point(
    chain: Chain,
    press: Press,
    timed: ContactTimes | None,
    pile_up: PileUp | None,
    look: PressEvidence | None,
    *,
    tilt_scatter_rad: float,
) -> CertifiedPoint:
    """The point of one press before its verdict; `tilt_scatter_rad` of faces from press to press."""
    indenter = chain.recording.indenters[press.indenter]
    height = indenter.height_mm if indenter.height_mm is not None else float("nan")
    pile_up = pile_up or unknown_pile_up()
    depth = height / (1 + pile_up.ratio)
    distance = look.distance_mm if look is not None else None
    tilt_std = tilt_scatter_rad * (distance or 0.0) / (1 + pile_up.ratio)
    details = CertificationDetails(
        pile_up_ratio=pile_up.ratio, pile_up_ratio_std=pile_up.std, tilt_std_mm=tilt_std
    )
    force, force_std, time_s = np.full(3, np.nan), float("nan"), float("nan")
    profile: EdgeProfile | None = None
    if timed is not None and timed.touch is not None and timed.event is not None and timed.crossed is not None:
        force, time_s = timed.event.force_N, timed.touch.time_s
        force_std = _force_std(chain.windows[press.press], timed, timed.event, timed.crossed)
        method = getattr(chain.reconstructor, "method", None)
        details = _event_details(details, timed, timed.touch, timed.event, method)
        track = timed.touched.case.track
        profile = edge_profile(track, timed.touch, bevel_distance_mm=timed.touched.distance_mm, method=method)
    on_scale = details.travel_scale_std if np.isfinite(details.travel_scale_std) else None
    return CertifiedPoint(
        press=press.press,
        indenter=press.indenter,
        depth_mm=depth,
        fz_N=float(force[2]),
        depth_std_mm=depth_std(
            depth, pile_up, height_std_mm=indenter.height_std_mm, ruler_std=on_scale, lean_std_mm=tilt_std
        ),
        fz_std_N=force_std,
        fx_N=float(force[0]),
        fy_N=float(force[1]),
        time_s=time_s,
        depth_uncorrected_mm=height,
        rest_s=chain.rest_s[press.press],
        speed_mm_s=press.speed_mm_s,
        x_mm=press.x_mm,
        y_mm=press.y_mm,
        details=_face_details(details, look),
        edge_profile=profile,
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
    window: ForceWindow | None, timed: ContactTimes, event: EventForce, crossed: ForceCrossing
) -> float:
    """Std (N) of the normal force at the event: its readings, the force's zero, and when it was."""
    tare = float(window.tare.std_N[2]) if window is not None and window.tare.known else 0.0
    from_time = timed.stop_std_N if event.dwell else event.rate_N_s * crossed.std_s
    return float(np.sqrt(event.std_N[2] ** 2 + tare**2 + from_time**2))


def _event_details(
    details: CertificationDetails, timed: ContactTimes, touch: ContactEvent, event: EventForce, method: object
) -> CertificationDetails:
    """The details with those of the contact event, and of the travel scale that it was put on."""
    details = replace(
        details,
        contact_std_s=touch.std_s,
        contact_shared_std_mm=_shared_std(timed, touch, event),
        contact_channel=touch.channel,
        contact_sigmas=touch.onset.gain**0.5,
        force_readings=event.readings,
        force_dwell=event.dwell,
        reconstructed_depth_mm=touch.depth_seen_mm,
        reconstructed_std_mm=touch.depth_seen_mm * shared_depth_std(timed.touched.case.track, method),
    )
    scale = timed.ruler
    if scale is None:
        return details
    return replace(
        details,
        travel_scale_std=scale.relative_std(timed.touched.law.c_N_per_mm),
        contact_delay_mm=scale.late_mm,
        contact_delay_std_mm=scale.late_std_mm,
    )


def _shared_std(timed: ContactTimes, touch: ContactEvent, event: EventForce) -> float:
    """Std (mm) that all depths share: the travel scale's zero, or the growing dent's shape; 0 at a stop."""
    if timed.ruler is not None:
        return timed.ruler.zero_std_mm
    return 0.0 if event.dwell else touch.onset.shared_std


def _face_details(details: CertificationDetails, look: PressEvidence | None) -> CertificationDetails:
    """The details with place, radius and tilt of the face, where one is seen."""
    if look is None or look.track.footprint is None:
        return details
    face = look.track.footprint
    (x_mm, y_mm), (tilt_x, tilt_y) = face.centre_mm, face.tilt
    return replace(
        details,
        centre_x_mm=x_mm,
        centre_y_mm=y_mm,
        face_radius_mm=face.radius_mm,
        tilt_x=tilt_x,
        tilt_y=tilt_y,
    )
