"""Faces of certified presses as their maps show them at the event: how deep, and what their wall hides of it.

Each is read once, between the frames before and after its event, with walls as nobody taught them: these faces
tell what the wall's law lacks (wall_lessons.py), and how deep faces are read with it (face_depth.py). Lengths in
mm, times on the camera's clock.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.door.cells import cell_text
from tactilevision.door.documents import read_text
from tactilevision.door.numbers import read_cells
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.integration.punch_edge import PunchEdge
from tactilevision.integration.taught_walls import WallFace
from tactilevision.reconstruct import Reconstructor
from tactilevision.recording import Recording, read_frame
from tactilevision.records import CertifiedPoint, Indenter, Pair, Press
from tactilevision.records.taught_walls import TaughtWalls

POINTS = "points.csv"
NEAR = 0.5  # of the radius, within which a wall's middle is the face's: the next face lies beyond


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
        """Depth in mm that the face is read at with walls as certified faces taught them; None: as nobody did."""
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
        """Depth in mm that the face is read at, at its event, with walls as taught; None: as nobody did."""
        return self._between(*(one.as_taught(walls) for one in self.maps))

    @property
    def wall_face(self) -> WallFace | None:
        """What the face says of walls, at its event; None where a map shows none."""
        if not all(one.hidden_mm for one in self.maps):
            return None
        before, after = self.maps
        hidden_mm = self._between(before.hidden_mm, after.hidden_mm)
        depth_mm = self._between(before.depth_mm, after.depth_mm)
        return WallFace(self.indenter.name, self.as_taught(None), hidden_mm, depth_mm, self.certified_mm)

    def _between(self, before: float, after: float) -> float:
        return before + self.share * (after - before)


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
            found.append(Certified(cell_text(str(row.get("press"))), time_s, depth_mm))
    return tuple(found)


def certified_of(points: Iterable[CertifiedPoint]) -> tuple[Certified, ...]:
    """The accepted ones of a certificate's points."""
    return tuple(Certified(one.press, one.time_s, one.depth_mm) for one in points if one.accepted)


def read_faces(
    recording: Recording, reader: Reconstructor, *, certified: Sequence[Certified]
) -> list[CertifiedFace]:
    """The faces of a recording's `certified` presses that both frames about their event show.

    Cast shadows are left or undone as the reader does now; what it knows of walls is set aside, and stays.
    Presses of another recording, told by label and time, are passed over.
    """
    known, reader.taught = reader.taught, None
    try:
        return list(_faces(recording, reader, certified))
    finally:
        reader.taught = known


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
    """The face in the map of a frame; None where it shows none that is pressed in."""
    try:
        face = find_footprint(reader.height_map(read_frame(recording, place)), indenter)
    except TactilevisionError:
        return None
    if face is None or not face.depth_mm > 0:
        return None
    wall = wall_at(reader, face.centre_mm, face.radius_mm) if indenter.shape == "flat_cylinder" else None
    taught = (wall.missing_mm, wall.depth_mm) if wall and wall.teachable else (0.0, 0.0)
    return MappedFace(face.depth_mm, *taught)


def wall_at(reader: Reconstructor, centre_mm: Pair, radius_mm: float) -> PunchEdge | None:
    """The wall of the map made last about a face's centre, from the picture's middle."""
    sensor = reader.sensor
    x = centre_mm[0] + (sensor.width_px - 1) / 2 * sensor.mm_per_px[0]
    y = centre_mm[1] + (sensor.height_px - 1) / 2 * sensor.mm_per_px[1]
    edges = reader.evidence.edges if reader.evidence else ()
    near = (one for one in edges if np.hypot(one.centre_mm[0] - x, one.centre_mm[1] - y) < NEAR * radius_mm)
    return next(near, None)
