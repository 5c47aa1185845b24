"""Records of a certificate: points, curves, clocks, and the evidence for each press."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tactilevision.contact.bevel import EDGE_MM, HALF_WIDTH_MM, SIDES, height_signal
from tactilevision.errors import TactilevisionError
from tactilevision.press.bevel_contact import DETECTION_CHI2, ContactEvent
from tactilevision.press.certified_faces import DepthScale
from tactilevision.press.contact_times import ContactTimes, RecordingMeasurements
from tactilevision.press.event_force import EventForce, ForceCrossing
from tactilevision.press.force_readings import ForceWindow
from tactilevision.press.pile_up import PileUp, depth_std, edge_profile, shared_depth_std, unknown_pile_up
from tactilevision.press.rejection import Finding, PressEvidence
from tactilevision.press.track import PressTrack, Reconstructs
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.certified import CertificationDetails, CertifiedPoint
from tactilevision.records.maps import Footprint, HeightMap
from tactilevision.records.measured import Curve, Estimate, Floats, Pair
from tactilevision.records.rig import Indenter, Press

# What certifying a recording yields: points, curves, the clocks, and the evidence for each press.


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Data of one press for the report.

    `frame_index` (into the recording's frames) and `frame_name` are of the frame nearest to the event (the deepest
    where the force does not determine its time), `height_map` its reconstruction; `touch` is None where none is
    certain; `bevel_window_mm` is ((x0, y0), (x1, y1)) on the pad; `signal_mm` (N,) is the height map's bevel
    signal against `depth_mm` (N,), both as the camera read them, at `time_s` (N,) of the camera's clock;
    `force_time_s` (T,) is on the same clock, `force_N` (T, 3) tared.
    """

    press: str
    frame_index: int | None
    frame_name: str
    footprint: Footprint | None
    height_map: HeightMap | None
    bevel_window_mm: tuple[Pair, Pair] | None
    time_s: Floats
    depth_mm: Floats
    signal_mm: Floats | None
    touch: ContactEvent | None
    event_s: float
    force_time_s: Floats
    force_N: Floats
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Depth and force of every press of a recording, and what they rest on.

    `points` holds every press, in the recording's order, accepted or with its reason; `curves` the presses that
    could be followed; `clock_offset` is F/T minus camera; `pile_ups` the gel's rise at the bevel, by press;
    `bevel_distance_mm` where that is (given or found, None: neither); `scale_doubt` the one of `warnings` that the
    certified depths contradict the picture's scale, "" where they do not.
    """

    points: tuple[CertifiedPoint, ...]
    curves: tuple[Curve, ...]
    clock_offset: Estimate
    evidence: Mapping[str, Evidence]
    pile_ups: Mapping[str, PileUp] = field(default_factory=dict)
    bevel_distance_mm: float | None = None
    depth_scale: DepthScale | None = None
    warnings: tuple[str, ...] = field(default=())
    flags: tuple[str, ...] = ()
    scale_doubt: str = ""

    def without_scale_doubt(self) -> Certificate:
        """Return the certificate without the warning `scale_doubt`."""
        return replace(self, warnings=tuple(line for line in self.warnings if line != self.scale_doubt))


# The certified point of one press: its depth from the bevel, its force at the contact event, and their stds.


def certified_point(
    measurements: RecordingMeasurements,
    press: Press,
    times: ContactTimes | None,
    pile_up: PileUp | None,
    evidence: PressEvidence | None,
    *,
    tilt_scatter_rad: float,
) -> CertifiedPoint:
    """Return the point of one press before its verdict; `tilt_scatter_rad` of faces between presses."""
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
    """Return the point with the depth that its bevel certifies, its force not known yet."""
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
    """Return the point with force and time of its contact event, their source, and the gel outside the face."""
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
    """Return the point with its verdict; its details keep all findings."""
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
    """Return the std (N) of the normal force at the event: by its readings, the force's zero, and time."""
    tare = float(window.tare.std_N[2]) if window is not None and window.tare.known else 0.0
    from_time = times.stop_std_N if event.dwell else event.rate_N_s * crossed.std_s
    return float(np.sqrt(event.std_N[2] ** 2 + tare**2 + from_time**2))


def _event_details(
    details: CertificationDetails, times: ContactTimes, touch: ContactEvent, event: EventForce, method: object
) -> CertificationDetails:
    """Return the details with those of the contact event, and of its travel scale."""
    details = replace(
        details,
        contact_std_s=touch.std_s,
        contact_shared_std_mm=_shared_std(times, touch, event),
        contact_channel=touch.channel,
        contact_sigmas=touch.onset.gain**0.5,
        force_readings=event.readings,
        force_dwell=event.dwell,
        reconstructed_depth_mm=touch.depth_seen_mm,
        reconstructed_std_mm=abs(touch.depth_seen_mm)
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
    """Return the common std (mm) of all depths: travel scale's zero, or dent's shape; 0 at a stop."""
    if times.travel_scale is not None:
        return times.travel_scale.zero_std_mm
    return 0.0 if event.dwell else touch.onset.shared_std


def _face_details(details: CertificationDetails, evidence: PressEvidence | None) -> CertificationDetails:
    """Return the details with place, radius and tilt of the face, where one is seen."""
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


# Whole presses as curves: the camera's depth and the force on the camera's clock, anchored at the certificate.
#
# The camera reads the depth of a steep-walled face in a scale of its own, which depends on the depth. All
# certified presses together give that scale (true over seen depth as a function of the seen one); each press is
# then scaled so that its own event reads what certifies it.

_SMOOTH = 5  # readings of the running mean


def press_curve(
    track: PressTrack,
    window: ForceWindow | None,
    *,
    point: CertifiedPoint,
    touch: ContactEvent | None,
    offset_s: float,
    depth_scale: DepthScale | None,
) -> Curve | None:
    """Return the curve of a press by frame; None without a force. `offset_s`: F/T minus camera clock."""
    if window is None:
        return None
    time = track.time_s + offset_s
    covered = (time >= window.time_s[0]) & (time <= window.time_s[-1])
    if covered.sum() < 2:
        return None
    depth = track.depth_mm * (depth_scale.scale(track.depth_mm) if depth_scale is not None else 1.0)
    if touch is not None and point.accepted and touch.depth_seen_mm > 0:
        seen = touch.depth_seen_mm
        read = seen * (float(depth_scale.scale(seen)) if depth_scale is not None else 1.0)
        depth = depth * (point.depth_mm / read)
    kernel = np.full(_SMOOTH, 1 / _SMOOTH)
    smooth = [
        np.convolve(np.pad(axis, _SMOOTH // 2, mode="edge"), kernel, mode="valid") for axis in window.force_N.T
    ]
    force = np.stack([np.interp(time[covered], window.time_s, axis) for axis in smooth], axis=1)
    phase = np.full(int(covered.sum()), "", dtype="<U6")
    if window.phases is not None:
        names = window.phases.names(window.time_s.size)
        phase = names[np.clip(np.searchsorted(window.time_s, time[covered]), 0, names.size - 1)]
    return Curve(point.press, track.time_s[covered], depth[covered], force, phase)


# What the report shows of a press: the frame at the event, its height map, the bevel's window, the force
# about it.


def evidence_of(
    recording: Recording,
    reconstructor: Reconstructs,
    *,
    press_evidence: PressEvidence,
    findings: tuple[Finding, ...],
) -> Evidence:
    """Return the evidence of one press; its event's frame is read and reconstructed again.

    Where the force does not determine the event's time, the deepest frame is used, and an insignificant touch is
    none.
    """
    track, window = press_evidence.track, press_evidence.force
    timed = np.isfinite(press_evidence.event_s) and not any(finding.reason == "saturated" for finding in findings)
    place = int(np.argmin(np.abs(track.time_s - press_evidence.event_s))) if timed else track.deepest
    touch = (
        press_evidence.touch
        if timed and press_evidence.touch is not None and press_evidence.touch.onset.gain > DETECTION_CHI2
        else None
    )
    name = track.names[place]
    index = recording.frame_names.index(name) if name in recording.frame_names else None
    signal = None
    if press_evidence.distance_mm is not None and track.footprint is not None:
        signal = height_signal(
            track.strips, track.s_mm, distance_mm=press_evidence.distance_mm, radius_mm=track.footprint.radius_mm
        )
    return Evidence(
        press=track.press.press,
        frame_index=index,
        frame_name=name,
        footprint=track.footprint,
        height_map=event_map(recording, reconstructor, index),
        bevel_window_mm=_window(press_evidence),
        time_s=track.time_s,
        depth_mm=track.depth_mm,
        signal_mm=signal,
        touch=touch,
        event_s=press_evidence.event_s,
        force_time_s=np.zeros(0) if window is None else window.time_s - press_evidence.offset_s,
        force_N=np.zeros((0, 3)) if window is None else window.force_N,
        findings=findings,
    )


def event_map(recording: Recording, reconstructor: Reconstructs, index: int | None) -> HeightMap | None:
    """Return the height map (H, W) mm of a frame, in single precision; None where it cannot be read."""
    if index is None:
        return None
    try:
        height = reconstructor.height_map(read_frame(recording, index))
    except TactilevisionError:
        return None
    std = None if height.std_mm is None else height.std_mm.astype(np.float32)
    return replace(height, depth_mm=height.depth_mm.astype(np.float32), std_mm=std)


def _window(press_evidence: PressEvidence) -> tuple[Pair, Pair] | None:
    """Return the corners (x, y) of the window at the bevel's edge, on the pad."""
    face = press_evidence.track.footprint
    if face is None or press_evidence.distance_mm is None:
        return None
    along = np.array(SIDES[press_evidence.track.side])
    across = np.array([-along[1], along[0]])
    middle = np.array(face.centre_mm) + press_evidence.distance_mm * along
    corners = np.array(
        [middle - EDGE_MM * along - HALF_WIDTH_MM * across, middle + EDGE_MM * along + HALF_WIDTH_MM * across]
    )
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    return (float(x0), float(y0)), (float(x1), float(y1))
