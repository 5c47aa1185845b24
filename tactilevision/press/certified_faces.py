"""Calibrate depth scale, face depth and wall law on the faces of certified presses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.errors import TactilevisionError
from tactilevision.heightmap.reconstructor import Reading, Reconstructor
from tactilevision.heightmap.walls import PunchEdge, WallFace, teach
from tactilevision.recording.layout import Columns
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.tables import read_table
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import Footprint, HeightMap
from tactilevision.records.measured import Floats, Pair
from tactilevision.records.rig import Indenter, Press
from tactilevision.robust import mad_std

# Faces of certified presses in their maps at the event: their depth, and the part that their wall hides.
#
# Each is read once, between the frames before and after its event, with uncorrected walls: these faces determine
# the correction of the wall's law, and the depth of faces with it. Lengths in mm, times on the camera's clock.

POINTS = "points.csv"
_CERTIFIED = Columns(maybe_words=("press", "accepted"), maybe_numbers=("time_s", "depth_mm"))
NEAR = 0.5  # of the radius: largest distance of a wall's centre from the face's


@dataclass(frozen=True, slots=True)
class Certified:
    """One accepted press: when its bevel touched, and the depth that this certifies."""

    press: str
    time_s: float
    depth_mm: float


@dataclass(frozen=True, slots=True)
class MappedFace:
    """A face's `read_mm` in one map; `hidden_mm`, `depth_mm` of its teachable wall there (PunchEdge), else 0."""

    read_mm: float
    hidden_mm: float
    depth_mm: float

    def as_taught(self, walls: TaughtWalls | None) -> float:
        """Return the face's depth in mm with walls fitted to certified faces; None: with uncorrected walls."""
        return self.read_mm + (walls.change_mm(self.hidden_mm, self.depth_mm)[0] if walls else 0.0)


@dataclass(frozen=True, slots=True)
class CertifiedFace:
    """The face of a `press` in the maps before and after its event, which lies `share` of the way between them."""

    press: Press
    indenter: Indenter
    certified_mm: float
    maps: tuple[MappedFace, MappedFace]
    share: float

    def as_taught(self, walls: TaughtWalls | None) -> float:
        """Return the face's depth in mm at its event, with fitted walls; None: with uncorrected walls."""
        return self._between(*(one.as_taught(walls) for one in self.maps))

    @property
    def wall_face(self) -> WallFace | None:
        """Return the face's wall data at its event; None where a map shows none."""
        if not all(one.hidden_mm for one in self.maps):
            return None
        before, after = self.maps
        hidden_mm = self._between(before.hidden_mm, after.hidden_mm)
        depth_mm = self._between(before.depth_mm, after.depth_mm)
        return WallFace(self.indenter.name, self.as_taught(None), hidden_mm, depth_mm, self.certified_mm)

    def _between(self, before: float, after: float) -> float:
        return before + self.share * (after - before)


def read_certified(calibration: Path) -> tuple[Certified, ...]:
    """Return the accepted presses of the points.csv next to a calibration.json; none where there is no such table.

    Raises InputError where it is no table.
    """
    path = calibration.parent / POINTS
    if not path.is_file():
        return ()
    table = read_table(path, _CERTIFIED)
    words = [table.words.get(name, ()) for name in _CERTIFIED.maybe_words]  # without one of them none is certified
    rows = zip(*words, table.optional("time_s"), table.optional("depth_mm"), strict=False)
    return tuple(
        Certified(press, float(time_s), float(depth_mm))
        for press, accepted, time_s, depth_mm in rows
        if accepted.lower() in ("1", "true") and np.isfinite(time_s) and depth_mm > 0
    )


def read_faces(
    recording: Recording, reader: Reconstructor, *, certified: Sequence[Certified]
) -> list[CertifiedFace]:
    """Return the faces of a recording's `certified` presses that both frames about their event show.

    The reader's wall correction is ignored. Presses of another recording, identified by label and time, are
    skipped.
    """
    return list(_faces(recording, reader.varied(taught=None), certified))


def _faces(recording: Recording, reader: Reconstructor, certified: Sequence[Certified]) -> Iterator[CertifiedFace]:
    presses = {press.press: press for press in recording.presses}
    for one in certified:
        press = presses.get(one.press)
        indenter = None if press is None else recording.indenters.get(press.indenter)
        if press is None or indenter is None or not press.start_s <= one.time_s <= press.end_s:
            continue
        after = int(np.searchsorted(recording.frame_times_s, one.time_s))
        if not 0 < after < recording.frame_times_s.size:
            continue
        maps = [_mapped(recording, reader, indenter, place) for place in (after - 1, after)]
        if maps[0] is None or maps[1] is None:
            continue
        begin, end = recording.frame_times_s[after - 1 : after + 1]
        share = float((one.time_s - begin) / (end - begin))
        yield CertifiedFace(press, indenter, one.depth_mm, (maps[0], maps[1]), share)


def _mapped(recording: Recording, reader: Reconstructor, indenter: Indenter, place: int) -> MappedFace | None:
    """Return the face in the map of a frame; None where it shows none that is pressed in."""
    try:
        reading = reader.read(read_frame(recording, place))
        face = find_footprint(reading.height, indenter)
    except TactilevisionError:
        return None
    if face is None or not face.depth_mm > 0:
        return None
    wall = wall_at(reading, face.centre_mm, face.radius_mm) if indenter.shape == "flat_cylinder" else None
    taught = (wall.missing_mm, wall.depth_mm) if wall and wall.teachable else (0.0, 0.0)
    return MappedFace(face.depth_mm, *taught)


def wall_at(reading: Reading, centre_mm: Pair, radius_mm: float) -> PunchEdge | None:
    """Return the wall about a face's centre, from the picture's middle."""
    (rows, columns), scale = reading.height.depth_mm.shape, reading.height.mm_per_px
    x, y = centre_mm[0] + (columns - 1) / 2 * scale[0], centre_mm[1] + (rows - 1) / 2 * scale[1]
    edges = reading.edges
    near = (one for one in edges if np.hypot(one.centre_mm[0] - x, one.centre_mm[1] - y) < NEAR * radius_mm)
    return next(near, None)


# The camera's depth scale for faces, from the certified events of all presses.
#
# A method made from balls reads all slopes in proportion to 1/R of their stated radius, and a single radius shows
# no error in it. The bevel is independent of balls: gentle faces, which are otherwise read correctly, show the
# error.

GENTLE_MM = 0.4  # mm, up to which walls do not change the depth of a face
MIN_COUNT = 3  # gentle faces of a median, or certified ones of a scale; tests.certificate.test_depth_scale
MAX_OFF = 0.06  # of 1: on five lights medians over gentle faces lie within .02, single ones within .08
DETECTION_SIGMA = 3.0  # stds of the median; tests.certificate.test_depth_scale


@dataclass(frozen=True, slots=True)
class DepthScale:
    """True over seen depth, a polynomial (lowest power first), constant beyond `limits_mm`; scatter."""

    coefficients: tuple[float, ...]
    limits_mm: Pair
    scatter: float

    def scale(self, seen_mm: Floats | float) -> Floats:
        """Return true over seen depth at seen depths (mm) of any shape."""
        held = np.clip(np.asarray(seen_mm, dtype=np.float64), *self.limits_mm)
        return np.asarray(np.polynomial.polynomial.polyval(held, self.coefficients), dtype=np.float64)


def find_depth_scale(pairs: Sequence[Pair]) -> DepthScale | None:
    """Fit the scale to (seen, true) depths at the events: constant, linear or square by the depths' spread."""
    usable = np.array([p for p in pairs if p[0] > 0 and p[1] > 0]).reshape(-1, 2)
    if not len(usable):
        return None
    seen, scale = usable[:, 0], usable[:, 1] / usable[:, 0]
    spread = len(np.unique(np.round(usable[:, 1] / (0.1 * usable[:, 1].max()))))
    degree = int(np.clip(min(spread, len(usable) // 2) - 1, 0, 2))
    coefficients = np.polynomial.polynomial.polyfit(seen, scale, degree)
    residual = scale - np.polynomial.polynomial.polyval(seen, coefficients)
    return DepthScale(
        tuple(float(c) for c in coefficients), (float(seen.min()), float(seen.max())), float(residual.std())
    )


def scale_warning(pairs: Sequence[Pair], radii_mm: Sequence[float]) -> str:
    """Return what to check where gentle faces (seen, certified) contradict the picture's scale; else "".

    `radii_mm` of the balls that made it; none for a ready method.
    """
    ratios = np.array([seen / true for seen, true in pairs if 0 < true <= GENTLE_MM and seen > 0])
    if len(ratios) < MIN_COUNT:
        return ""
    off = float(np.median(ratios))
    scatter = mad_std(ratios, centre=off) / np.sqrt(len(ratios))
    if abs(off - 1.0) < max(MAX_OFF, DETECTION_SIGMA * scatter):
        return ""
    why, radii = "balls of this sensor would mend it.", sorted(set(radii_mm))
    if radii:
        implied = ", ".join(f"{off * radius:.2f}" for radius in radii)
        why = f"is the ball radius stated as {', '.join(f'{radius:g}' for radius in radii)} mm really {implied}, "
        why += "has the light changed since the balls, or do lamps cast shadows outside the faces?"
    return (
        f"Depth as the picture reads it is {100 * (off - 1):+.0f} % off what the bevel certifies "
        f"of {len(ratios)} gentle faces: {why}"
    )


# Correction of face depth: the part hidden by a face's walls, restored from certified presses.
#
# A deep face is read through walls too steep to be read. Its depth is too small, equally at equal depth. The
# certified presses determine the error: read at their events by the same reconstructor they give a depth scale
# (`find_depth_scale`). It moves the faces of all frames of these presses as rigid discs. The gel outside them, and
# the deviation that the map states, are not changed. Lengths in mm, times on the camera's clock.


@dataclass(frozen=True, slots=True)
class FaceDepthCorrection:
    """`depth_scale` of the faces in `spans` (first and last time of a press, its indenter); None: nothing.

    `doubt` is a sentence where they contradict the picture's scale.
    """

    depth_scale: DepthScale | None = None
    spans: tuple[tuple[float, float, Indenter], ...] = ()
    doubt: str = ""

    def __call__(self, height: HeightMap) -> HeightMap:
        """Return the map with its face at the certified depth; unchanged where no face of these presses shows."""
        inside = (indenter for first, last, indenter in self.spans if first <= height.time_s <= last)
        indenter = next(inside, None)
        face = None if indenter is None else find_footprint(height, indenter)
        return height if self.depth_scale is None else with_face(height, face, depth_scale=self.depth_scale)


def with_face(height: HeightMap, face: Footprint | None, *, depth_scale: DepthScale) -> HeightMap:
    """Return the map (H, W) with a flat `face` at the depth (mm) by the scale; None: unchanged."""
    if face is None or not face.depth_mm > 0:
        return height
    lacking = (float(depth_scale.scale(face.depth_mm)) - 1.0) * face.depth_mm
    return replace(height, depth_mm=np.where(face.mask, height.depth_mm + lacking, height.depth_mm))


NO_CORRECTION = FaceDepthCorrection()  # nothing is certified: every map is the picture's own


def face_depth_correction(
    recording: Recording, faces: Sequence[CertifiedFace], *, walls: TaughtWalls | None
) -> FaceDepthCorrection:
    """Return the correction by a recording's own certified `faces`; NO_CORRECTION for fewer than MIN_COUNT.

    Maps are made with `walls` fitted to certified faces; None: with uncorrected walls.
    """
    pairs = [(one.as_taught(walls), one.certified_mm) for one in faces]
    depth_scale = find_depth_scale(pairs) if len(pairs) >= MIN_COUNT else None
    if depth_scale is None:
        return NO_CORRECTION
    spans = tuple((one.press.start_s, one.press.end_s, one.indenter) for one in faces)
    return FaceDepthCorrection(
        depth_scale, spans, scale_warning(pairs, [ball.ball_radius_mm for ball in recording.balls])
    )


# Fit of the wall's law to certified faces: maps at their events, compared with the bevel's depth.
#
# A face's map gives its read depth and the part that its wall hides (certified_faces.py). With the certified depth
# they determine the two parameters of the wall's law (heightmap/walls.py). These belong to the light, and correct
# all later frames of the sensor.


def teach_walls(reader: Reconstructor, faces: Sequence[CertifiedFace]) -> Reconstructor:
    """Return the reader with walls fitted to certified `faces`.

    Unchanged where too few faces show a wall, and where the error is larger than walls explain.
    """
    lesson = teach([one.wall_face for one in faces if one.wall_face is not None])
    return reader if lesson is None else reader.varied(taught=lesson)


def with_scatter(scale: DepthScale | None, walls: TaughtWalls) -> DepthScale | None:
    """Return the scale of the faces to which `walls` were fitted: their scatter holds for other faces, too."""
    return None if scale is None else replace(scale, scatter=max(scale.scatter, walls.scatter))
