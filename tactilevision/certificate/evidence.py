"""What the report shows of a press: the frame at the event, its height map, the bevel's window, the force
about it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactilevision.certificate.certificate import Evidence
from tactilevision.certificate.rejection import Finding, PressEvidence
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2
from tactilevision.certificate.touch.press_track import Reconstructs
from tactilevision.contact.bevel import EDGE_MM, HALF_WIDTH_MM, SIDES, height_signal
from tactilevision.errors import TactilevisionError
from tactilevision.recording import Recording, read_frame
from tactilevision.records import HeightMap, Pair


def evidence_of(
    recording: Recording,
    reconstructor: Reconstructs,
    *,
    press_evidence: PressEvidence,
    findings: tuple[Finding, ...],
) -> Evidence:
    """Evidence of one press; its event's frame is read and reconstructed once more.

    Where the force does not tell the time of the event, the deepest frame stands in for it, and a touch that
    does not stand out of the noise is none.
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
        height_map=_height_map(recording, reconstructor, index),
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


def _height_map(recording: Recording, reconstructor: Reconstructs, index: int | None) -> HeightMap | None:
    if index is None:
        return None
    try:
        height = reconstructor.height_map(read_frame(recording, index))
    except TactilevisionError:
        return None
    std = None if height.std_mm is None else height.std_mm.astype(np.float32)
    return replace(height, depth_mm=height.depth_mm.astype(np.float32), std_mm=std)


def _window(press_evidence: PressEvidence) -> tuple[Pair, Pair] | None:
    """Corners (x, y) of the window at the bevel's edge, on the pad."""
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
