"""One press as the camera saw it: every frame's height map once, and of each what later steps ask for.

Frames are streamed; of each only a coarse height map and picture (0.2 mm) stay while the
press lasts, and strips, rings and the depth of the face after it. The full height map is kept of the deepest
frame alone. Lengths in mm, places on the pad; times on the camera's clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.contact.bevel import SIDES, strip, strip_places
from tactilevision.contact.edge import sample
from tactilevision.contact.footprint import find_footprint
from tactilevision.recording.model import BadFrame
from tactilevision.records import Floats, Footprint, Frame, HeightMap, Indenter, Pair, Press, Sensor
from tactilevision.sensors import rectify

GRID_MM = 0.1
Coarse = npt.NDArray[np.float32]


class Reconstructs(Protocol):
    """Anything that turns a raw frame of one sensor into a height map."""

    @property
    def sensor(self) -> Sensor: ...

    def height_map(self, frame: Frame) -> HeightMap: ...


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """What the frames of one press show, in the order of time.

    `time_s`, `names` (N,); `depth_mm` (N,) of the face above its own zero before contact, `zero_mm` that zero;
    `tilts` (N, 2) of the plane through the face; `strips` (N, S) and `colours` (N, S, 3) at the distances
    `s_mm` (S,) along the line to the bevel; `rings` (N, 4, R) mean depth at `r_mm` (R,) from the axis in the
    quarters towards the bevel, away from it, and across; `deepest` is that frame's place; `missing` are the
    torn frames.
    """

    press: Press
    indenter: Indenter
    names: tuple[str, ...]
    time_s: Floats
    depth_mm: Floats
    zero_mm: float
    tilts: Floats
    s_mm: Floats
    strips: Floats
    colours: Floats
    r_mm: Floats
    rings: Floats
    deepest: int
    face_map: HeightMap
    footprint: Footprint | None
    missing: tuple[BadFrame, ...] = ()

    @property
    def side(self) -> str:
        return self.indenter.bevel or "right"


@dataclass(slots=True)
class _Tape:
    """Grows while the frames of a press go by."""

    names: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    maps: list[Coarse] = field(default_factory=list)
    pictures: list[npt.NDArray[np.float16]] = field(default_factory=list)
    missing: list[BadFrame] = field(default_factory=list)
    top: float = -np.inf
    deepest: int = -1
    face_map: HeightMap | None = None


def watch(
    frames: Iterable[Frame | BadFrame], reconstructor: Reconstructs, *, press: Press, indenter: Indenter
) -> Watch | None:
    """Reconstruct the frames of one press; None where there are fewer than two sound ones."""
    tape = _Tape()
    for frame in frames:
        if isinstance(frame, BadFrame):
            tape.missing.append(frame)
        else:
            _take(tape, frame, reconstructor)
    if tape.face_map is None or len(tape.times) < 2:
        return None
    footprint = find_footprint(tape.face_map, indenter)
    return _measure(tape, tape.face_map, footprint, press=press, indenter=indenter)


def _take(tape: _Tape, frame: Frame, reconstructor: Reconstructs) -> None:
    height = reconstructor.height_map(frame)
    coarse = _shrink(np.where(height.valid, height.depth_mm, np.nan), height.mm_per_px)
    tape.names.append(frame.name)
    tape.times.append(frame.time_s)
    tape.maps.append(coarse)
    picture = rectify(reconstructor.sensor, frame.rgb)
    tape.pictures.append(_shrink(picture, height.mm_per_px).astype(np.float16))
    top = float(cv2.blur(np.nan_to_num(coarse), (9, 9)).max())
    if top > tape.top:
        tape.top, tape.deepest, tape.face_map = top, len(tape.maps) - 1, height


def _shrink(field_: npt.NDArray[Any], mm_per_px: Pair) -> Coarse:
    rows, columns = field_.shape[:2]
    size = (max(round(columns * mm_per_px[0] / GRID_MM), 8), max(round(rows * mm_per_px[1] / GRID_MM), 8))
    small = cv2.resize(field_.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)


def _measure(tape: _Tape, face_map: HeightMap, footprint: Footprint | None, *, press: Press,
             indenter: Indenter) -> Watch:  # fmt: skip
    rows, columns = tape.maps[0].shape
    view = face_map.depth_mm.shape[::-1]
    wide = (view[0] * face_map.mm_per_px[0], view[1] * face_map.mm_per_px[1])
    scale = (columns / wide[0], rows / wide[1])
    if footprint is not None:
        centre, radius = footprint.centre_mm, footprint.radius_mm
    else:
        centre, radius = _deepest_place(tape.maps[tape.deepest], scale), indenter.radius_mm
    radius = radius if np.isfinite(radius) else 1.0
    centre_px = (centre[0] * scale[0] + (columns - 1) / 2, centre[1] * scale[1] + (rows - 1) / 2)
    order = np.argsort(tape.times, kind="stable")
    faces = np.array([_face(tape.maps[k], centre_px, scale, 0.7 * radius) for k in order])
    side, reach = indenter.bevel or "right", 0.55 * float(np.hypot(*wide))
    s, r = strip_places(reach), np.arange(radius, reach, GRID_MM)
    zero = _zero(faces[:, 0])
    return Watch(
        press=press, indenter=indenter, names=tuple(tape.names[k] for k in order),
        time_s=np.array(tape.times)[order], depth_mm=faces[:, 0] - zero, zero_mm=zero, tilts=faces[:, 1:],
        s_mm=s, strips=np.array([strip(tape.maps[k], centre_px, scale, side=side, reach_mm=reach) for k in
        order]), colours=np.stack([
            [strip(tape.pictures[k][..., c], centre_px, scale, side=side, reach_mm=reach) for k in order]
            for c in range(3)], axis=-1),
        r_mm=r, rings=np.array([_rings(tape.maps[k], centre_px, scale, r, side) for k in order]),
        deepest=int(np.flatnonzero(order == tape.deepest)[0]), face_map=face_map, footprint=footprint,
        missing=tuple(tape.missing),
    )  # fmt: skip


def _deepest_place(depth: Coarse, scale: Pair) -> Pair:
    blurred = cv2.blur(np.nan_to_num(depth), (9, 9))
    row, column = np.unravel_index(int(blurred.argmax()), blurred.shape)
    rows, columns = blurred.shape
    return (float(column) - (columns - 1) / 2) / scale[0], (float(row) - (rows - 1) / 2) / scale[1]


def _face(depth: Coarse, centre_px: Pair, scale: Pair, radius_mm: float) -> Floats:
    """Plane through the face: depth at the centre, d/dx, d/dy."""
    rows, columns = depth.shape
    x = ((np.arange(columns) - centre_px[0]) / scale[0])[None, :]
    y = ((np.arange(rows) - centre_px[1]) / scale[1])[:, None]
    face = (np.hypot(x, y) < radius_mm) & np.isfinite(depth)
    if face.sum() < 6:
        return np.full(3, np.nan)
    x, y = np.broadcast_to(x, face.shape)[face], np.broadcast_to(y, face.shape)[face]
    plane, *_ = np.linalg.lstsq(np.c_[np.ones_like(x), x, y], depth[face].astype(np.float64), rcond=None)
    return np.asarray(plane, dtype=np.float64)


def _rings(depth: Coarse, centre_px: Pair, scale: Pair, r: Floats, side: str) -> Floats:
    """Mean depth (4, R) over quarters of rings: towards the bevel, away from it, and the two across; NaN
    unseen.
    """
    along = np.arctan2(SIDES[side][1], SIDES[side][0])
    turn = np.deg2rad(np.arange(-44, 45, 8.0))
    angles = np.concatenate([along + k + turn for k in (0, np.pi, np.pi / 2, -np.pi / 2)])
    places = np.stack([
        centre_px[0] + scale[0] * r[None, :] * np.cos(angles)[:, None],
        centre_px[1] + scale[1] * r[None, :] * np.sin(angles)[:, None],
    ], axis=-1)  # fmt: skip
    return np.asarray(sample(depth, places).reshape(4, turn.size, r.size).mean(axis=1))


def _zero(level: Floats) -> float:
    """Level of the face before contact: the median of the readings that lie within the noise of the lowest
    tenth.
    """
    known = level[np.isfinite(level)]
    if known.size == 0:
        return 0.0
    low = float(np.quantile(known, 0.05))
    noise = 1.4826 * float(np.median(np.abs(np.diff(known, 2)))) / np.sqrt(6) if known.size > 4 else 0.0
    free = known[known < low + max(5 * noise, 0.02 * float(np.ptp(known)))]
    return float(np.median(free)) if free.size >= 3 else 0.0
