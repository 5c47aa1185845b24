"""Correction of face depth: what the map hides of a face in its walls, put back from certified presses.

A deep face is read through walls too steep to be read. Its depth comes out short, alike at the same depth. The
certified presses tell by how much: read at their events by the same reconstructor they give a depth scale
(depth_scale.py). The faces of all frames of these presses are moved by it as rigid discs. The gel beside them, and
the deviation that the map states, stay as they are. Lengths in mm, times on the camera's clock.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from tactilevision.certificate.depth.depth_scale import DepthScale, find_depth_scale, scale_warning
from tactilevision.contact.footprint import find_footprint
from tactilevision.door.documents import read_text
from tactilevision.door.numbers import read_cells
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.recording import Recording, read_frame
from tactilevision.records import Footprint, Frame, HeightMap, Indenter

POINTS = "points.csv"
MIN_COUNT = 3  # certified faces that make a depth scale; tests.certificate.test_face_depth


class _Maps(Protocol):
    def height_map(self, frame: Frame) -> HeightMap: ...


@dataclass(frozen=True, slots=True)
class Certified:
    """One accepted press: when its bevel touched, and the depth that this certifies."""

    press: str
    time_s: float
    depth_mm: float


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


def read_certified(calibration: Path) -> tuple[Certified, ...]:
    """The accepted presses of the points.csv beside a calibration.json; none where there is no such table.

    Raises InputError where it is no table.
    """
    path = calibration.parent / POINTS
    if not path.is_file():
        return ()
    found = []
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path), newline="")))
    except csv.Error as fault:
        raise InputError(f"is not CSV: {fault}", where=path) from fault
    for row in rows:
        try:
            time_s, depth_mm = read_cells([row["time_s"], row["depth_mm"]], where=path)
            good = row["accepted"].strip().lower() in ("1", "true")
        except (KeyError, TypeError, AttributeError, InputError):
            continue
        if good and np.isfinite(time_s) and 0 < depth_mm < np.inf:
            found.append(Certified(str(row.get("press")), time_s, depth_mm))
    return tuple(found)


def face_depth_correction(
    recording: Recording, maps: _Maps, *, certified: Sequence[Certified]
) -> FaceDepthCorrection:
    """Correction by a recording's own certified presses; NO_CORRECTION where fewer than MIN_COUNT show a face.

    Presses of another recording, told by label and time, are passed over.
    """
    presses = {press.press: press for press in recording.presses}
    pairs, spans = [], []
    for one in certified:
        press = presses.get(one.press)
        indenter = None if press is None else recording.indenters.get(press.indenter)
        if press is None or indenter is None or not press.start_s <= one.time_s <= press.end_s:
            continue
        seen = _seen_mm(recording, maps, indenter, one.time_s)
        if seen > 0:
            pairs.append((seen, one.depth_mm))
            spans.append((press.start_s, press.end_s, indenter))
    depth_scale = find_depth_scale(pairs) if len(pairs) >= MIN_COUNT else None
    if depth_scale is None:
        return NO_CORRECTION
    return FaceDepthCorrection(
        depth_scale, tuple(spans), scale_warning(pairs, [ball.ball_radius_mm for ball in recording.balls])
    )


def _seen_mm(recording: Recording, maps: _Maps, indenter: Indenter, time_s: float) -> float:
    """Depth of the face at a time, between the frames before and after it; NaN where it is not seen in both."""
    times = recording.frame_times_s
    after = int(np.searchsorted(times, time_s))
    if not 0 < after < times.size:
        return float("nan")
    depths = []
    for place in (after - 1, after):
        try:
            face = find_footprint(maps.height_map(read_frame(recording, place)), indenter)
        except TactilevisionError:
            face = None
        depths.append(float("nan") if face is None else face.depth_mm)
    return float(np.interp(time_s, times[after - 1 : after + 1], depths))


def _disc(height: HeightMap, face: Footprint) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    rows, columns = height.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * height.mm_per_px[0] - face.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * height.mm_per_px[1] - face.centre_mm[1]
    return np.asarray(np.hypot(x[None, :], y[:, None]) < face.radius_mm)
