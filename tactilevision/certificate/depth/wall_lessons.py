"""Certified faces teach the wall's law: maps at their events, held against the depth that the bevel has there.

A face's map says how deep it is read and how much of that its wall hides. With the certified depth beside it, the
two numbers of the wall's law come out (integration/taught_walls.py). They belong to the light, so that all later
frames of the sensor are read with them; cast shadows left or undone, each has its own. Lengths in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from tactilevision.certificate.depth.depth_scale import DepthScale
from tactilevision.certificate.depth.face_depth import Certified
from tactilevision.contact.footprint import find_footprint
from tactilevision.errors import TactilevisionError
from tactilevision.integration.punch_edge import PunchEdge
from tactilevision.integration.taught_walls import WallFace, teach
from tactilevision.photometric.method import CalibratedMethod, ReferencedMethod
from tactilevision.reconstruct import Reconstructor
from tactilevision.recording import Recording, read_frame
from tactilevision.records import Indenter, Pair
from tactilevision.records.taught_walls import TaughtWalls, WallLessons

NEAR = 0.5  # of the radius, within which a wall's middle is the face's: the next face lies beyond


def teach_walls(recording: Recording, reader: Reconstructor, *, certified: Sequence[Certified]) -> bool:
    """Let the recording's `certified` faces teach the reader's walls, cast shadows left or undone as it does now.

    The reader keeps to it from then on. False, and what it knew stays, where too few faces show a wall, and where
    what they say is more than walls can be off.
    """
    known, which = reader.walls, "left" if reader.shadows is None else "undone"
    reader.walls = replace(known, **{which: None})  # the faces tell what the law lacks without a lesson
    lesson = teach(_faces(recording, reader, certified))
    reader.walls = known if lesson is None else replace(known, **{which: lesson})
    return lesson is not None


def with_walls(method: ReferencedMethod, walls: WallLessons) -> ReferencedMethod:
    """The method with what its reader knows of `walls`; itself where that is what it knows already."""
    known = getattr(method, "walls", None) or WallLessons()
    return method if walls == known else replace(cast(CalibratedMethod, method), walls=walls)


def with_scatter(scale: DepthScale | None, walls: TaughtWalls) -> DepthScale | None:
    """The scale of faces that taught their `walls`, too: they scatter no less than faces elsewhere."""
    return None if scale is None else replace(scale, scatter=max(scale.scatter, walls.scatter))


def _faces(recording: Recording, reader: Reconstructor, certified: Sequence[Certified]) -> list[WallFace]:
    presses = {press.press: press for press in recording.presses}
    faces = []
    for one in certified:
        press = presses.get(one.press)
        indenter = None if press is None else recording.indenters.get(press.indenter)
        if press is None or indenter is None or not press.start_s <= one.time_s <= press.end_s:
            continue
        face = _face(recording, reader, one, indenter)
        faces += [face] if face else []
    return faces


def _face(
    recording: Recording, reader: Reconstructor, certified: Certified, indenter: Indenter
) -> WallFace | None:
    """Face and wall at the event, between the frames before and after it; None where both do not show them."""
    times = recording.frame_times_s
    after = int(np.searchsorted(times, certified.time_s))
    if indenter.shape != "flat_cylinder" or not 0 < after < times.size:
        return None
    seen = []
    for place in (after - 1, after):
        try:
            height = reader.height_map(read_frame(recording, place))
        except TactilevisionError:
            return None
        face = find_footprint(height, indenter)
        wall = None if face is None else wall_at(reader, face.centre_mm, face.radius_mm)
        if face is None or wall is None:
            return None
        seen.append((face.depth_mm, wall.missing_mm, wall.depth_mm))
    span = times[after - 1 : after + 1]
    read, hidden, depth = (float(np.interp(certified.time_s, span, two)) for two in zip(*seen, strict=True))
    return WallFace(indenter.name, read, hidden, depth, certified.depth_mm)


def wall_at(reader: Reconstructor, centre_mm: Pair, radius_mm: float) -> PunchEdge | None:
    """The wall of the map made last about a face's centre, from the picture's middle."""
    sensor = reader.sensor
    x = centre_mm[0] + (sensor.width_px - 1) / 2 * sensor.mm_per_px[0]
    y = centre_mm[1] + (sensor.height_px - 1) / 2 * sensor.mm_per_px[1]
    edges = reader.evidence.edges if reader.evidence else ()
    near = (one for one in edges if np.hypot(one.centre_mm[0] - x, one.centre_mm[1] - y) < NEAR * radius_mm)
    return next(near, None)
