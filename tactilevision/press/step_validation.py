"""Validate depth on flat steps of known height: the faces of certified presses.

The bevel of a flat punch certifies how deep its face was; no ball and no slope has part in that. Read by a method
that balls alone have made, the face's depth is thus a test of depth behind steep walls, in the recording itself.
"""

from __future__ import annotations

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.errors import TactilevisionError
from tactilevision.heightmap.ball_validation import Known
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.press.certification import certify
from tactilevision.press.certified_faces import Certified
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.rig import Indenter

FLAT = "flat_cylinder"


def flat_steps(
    recording: Recording, reconstructor: Reconstructor
) -> tuple[list[Known], str, tuple[Certified, ...]]:
    """Return the steps of certified presses; why there are none, "" where there are some; the presses."""
    flat = {name for name, indenter in recording.indenters.items() if indenter.shape == FLAT}
    if not any(press.indenter in flat for press in recording.presses):
        return [], "no flat steps in this recording", ()
    try:
        certificate = certify(recording, reconstructor)
    except TactilevisionError as fault:
        return [], f"no flat steps: their presses cannot be certified ({fault})", ()
    steps = []
    good = [point for point in certificate.points if point.accepted and point.indenter in flat]
    for point in good:
        step = _step(recording, reconstructor, point)
        steps += [step] if step else []
    certified = tuple(Certified(point.press, point.time_s, point.depth_mm) for point in good)
    return steps, "" if steps else "no flat steps: none of the recording's presses was certified", certified


def _step(recording: Recording, reconstructor: Reconstructor, point: CertifiedPoint) -> Known | None:
    """Return one face at its certified event; None where the picture does not show it then."""
    found_mm = point.details.reconstructed_depth_mm
    relative = _relative_std(recording, reconstructor, recording.indenters[point.indenter], point.time_s)
    if not np.isfinite([found_mm, relative, point.depth_std_mm]).all():
        return None
    radius_px = recording.indenters[point.indenter].radius_mm / recording.sensor.mm_per_px[0]
    stated_mm = float(np.hypot(relative * found_mm, point.depth_std_mm))
    return Known(point.depth_mm, found_mm, stated_mm, radius_px)


def _relative_std(recording: Recording, reconstructor: Reconstructor, indenter: Indenter, time_s: float) -> float:
    """Return the relative deviation that the nearest frame's map states of the face; NaN without a face."""
    nearest = int(np.argmin(np.abs(recording.frame_times_s - time_s)))
    try:
        height = reconstructor.height_map(read_frame(recording, nearest))
    except TactilevisionError:
        return float("nan")
    face = find_footprint(height, indenter)
    if face is None or height.std_mm is None or not face.depth_mm > 0:
        return float("nan")
    return float(np.median(height.std_mm[face.mask & height.valid])) / face.depth_mm
