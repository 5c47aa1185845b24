"""Correction of face depth: what the map hides of a face in its walls, put back from certified presses.

A deep face is read through walls too steep to be read. Its depth comes out short, alike at the same depth. The
certified presses tell by how much: read at their events by the same reconstructor they give a depth scale
(depth_scale.py). The faces of all frames of these presses are moved by it as rigid discs. The gel beside them, and
the deviation that the map states, stay as they are. Lengths in mm, times on the camera's clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.certificate.depth.certified_faces import CertifiedFace
from tactilevision.certificate.depth.depth_scale import DepthScale, find_depth_scale, scale_warning
from tactilevision.contact.footprint import find_footprint
from tactilevision.recording import Recording
from tactilevision.records import Footprint, HeightMap, Indenter
from tactilevision.records.taught_walls import TaughtWalls

MIN_COUNT = 3  # certified faces that make a depth scale; tests.certificate.test_face_depth


@dataclass(frozen=True, slots=True)
class FaceDepthCorrection:
    """`depth_scale` of the faces in `spans` (first and last time of a press, its indenter); None: nothing.

    `doubt` is a sentence where they contradict the picture's scale.
    """

    depth_scale: DepthScale | None = None
    spans: tuple[tuple[float, float, Indenter], ...] = ()
    doubt: str = ""

    def __call__(self, height: HeightMap) -> HeightMap:
        """The map with its face where the certificate puts it; as it was where no face of these presses shows."""
        inside = (indenter for first, last, indenter in self.spans if first <= height.time_s <= last)
        indenter = next(inside, None)
        face = None if indenter is None else find_footprint(height, indenter)
        return height if self.depth_scale is None else with_face(height, face, depth_scale=self.depth_scale)


def with_face(height: HeightMap, face: Footprint | None, *, depth_scale: DepthScale) -> HeightMap:
    """The map (H, W) with a flat `face`, as it reads it, as deep in mm as the scale has it; None: as it was."""
    if face is None or not face.depth_mm > 0:
        return height
    lacking = (float(depth_scale.scale(face.depth_mm)) - 1.0) * face.depth_mm
    disc = _disc(height, face)
    return replace(height, depth_mm=np.where(disc, height.depth_mm + lacking, height.depth_mm))


NO_CORRECTION = FaceDepthCorrection()  # nothing is certified: every map is the picture's own


def face_depth_correction(
    recording: Recording, faces: Sequence[CertifiedFace], *, walls: TaughtWalls | None
) -> FaceDepthCorrection:
    """Correction by a recording's own certified `faces`; NO_CORRECTION where they are fewer than MIN_COUNT.

    Maps are made with `walls` as certified faces taught them; None: as nobody did.
    """
    pairs = [(one.as_taught(walls), one.certified_mm) for one in faces]
    depth_scale = find_depth_scale(pairs) if len(pairs) >= MIN_COUNT else None
    if depth_scale is None:
        return NO_CORRECTION
    spans = tuple((one.press.start_s, one.press.end_s, one.indenter) for one in faces)
    return FaceDepthCorrection(
        depth_scale, spans, scale_warning(pairs, [ball.ball_radius_mm for ball in recording.balls])
    )


def _disc(height: HeightMap, face: Footprint) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    rows, columns = height.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * height.mm_per_px[0] - face.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * height.mm_per_px[1] - face.centre_mm[1]
    return np.asarray(np.hypot(x[None, :], y[:, None]) < face.radius_mm)
