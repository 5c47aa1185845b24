"""Track one press through the frames: height maps, face, bevel, and flaws of compressed video."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.contact.bevel import SIDES, strip, strip_places
from tactilevision.contact.footprint import find_footprint, sample
from tactilevision.errors import InputError
from tactilevision.heightmap.scene_faults import blocks_grey
from tactilevision.recording.model import BadFrame
from tactilevision.records.maps import Footprint, Frame, HeightMap
from tactilevision.records.measured import Bools, Bytes, Estimate, Floats, Pair
from tactilevision.records.rig import Indenter, Press, Sensor
from tactilevision.robust import second_difference_std

# One press as the camera saw it: every frame's height map once, and of each what later steps ask for.
#
# Frames are streamed; of each only a coarse height map and picture (0.2 mm) stay while the
# press lasts, and strips, rings and the depth of the face after it. The full height map is kept of the deepest
# frame alone. Lengths in mm, places on the pad; times on the camera's clock.

GRID_MM = 0.1  # mm, grid of the maps that are kept
_WALL_MM = 0.15  # mm, a significant depth whose walls a picture still shows
DEEP = 0.6  # of the deepest reading, beyond which a face's tilt is read
_MAX_RADIUS_CHANGE = 0.1  # of the radius, within which the shallow circle is the deep one
CoarseMap = npt.NDArray[np.float32]
HalfPicture = npt.NDArray[np.float16]


class Reconstructs(Protocol):
    """Anything that turns a raw frame of one sensor into a height map."""

    @property
    def sensor(self) -> Sensor: ...

    def height_map(self, frame: Frame) -> HeightMap: ...

    def depth_map(self, frame: Frame) -> tuple[HeightMap, Bytes, Callable[[], HeightMap]]:
        """Return a map without deviation and flags, the rectified picture, and what adds those two."""


@dataclass(frozen=True, slots=True, eq=False)
class PressTrack:
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


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where a press is read in its coarse maps: centre, pixels per mm (x, y), radius of the face, strip, rings."""

    centre_px: Pair
    scale: Pair
    radius_mm: float
    side: str
    s_mm: Floats
    r_mm: Floats
    face: Bools
    basis: Floats
    inverse: Floats

    def _face(self, depth: CoarseMap) -> Floats:
        """Return the plane through the face: depth at the centre, d/dx, d/dy."""
        here = depth[self.face].astype(np.float64)
        known = np.isfinite(here)
        if known.all() and known.size >= 6:
            return np.asarray(self.inverse @ here, dtype=np.float64)
        if known.sum() < 6:
            return np.full(3, np.nan)
        return np.asarray(np.linalg.lstsq(self.basis[known], here[known], rcond=None)[0], dtype=np.float64)

    def read(self, depth: CoarseMap, picture: HalfPicture) -> tuple[Floats, Floats, Floats, Floats]:
        """Return face (3,), strip of depth (S,), of colours (S, 3), rings (4, R)."""
        reach = float(self.s_mm[-1])

        def along(field_: npt.NDArray[Any]) -> Floats:
            return strip(field_, self.centre_px, px_per_mm=self.scale, side=self.side, reach_mm=reach + 1e-9)

        return (
            self._face(depth),
            along(depth),
            along(picture.astype(np.float32)),
            _rings(depth, self.centre_px, self.scale, self.r_mm, self.side),
        )


@dataclass(slots=True)
class _TrackRecorder:
    """Grows while the frames of a press go by; maps are kept only until it is known where to read them."""

    names: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    maps: list[tuple[CoarseMap, HalfPicture]] = field(default_factory=list)
    readings: list[tuple[Floats, Floats, Floats, Floats]] = field(default_factory=list)
    missing: list[BadFrame] = field(default_factory=list)
    top: float = -np.inf
    deepest: int = -1
    deepest_mm: Pair = (0.0, 0.0)
    face: Callable[[], HeightMap] | None = None
    wall_off: float = np.inf
    wall_map: HeightMap | None = None


def track(
    frames: Iterable[Frame | BadFrame],
    reconstructor: Reconstructs,
    *,
    press: Press,
    indenter: Indenter,
    near: Footprint | None = None,
) -> PressTrack | None:
    """Reconstruct the frames of one press; None where there are fewer than two sound ones.

    `near`, where the face was found in a few frames beforehand, keeps the memory of a long press small.
    """
    tape, place = _TrackRecorder(), None
    for frame in frames:
        if isinstance(frame, BadFrame):
            tape.missing.append(frame)
            continue
        try:
            height = _take(tape, frame, reconstructor)
        except InputError as fault:
            tape.missing.append(BadFrame(frame.name, frame.time_s, fault.what))
            continue
        if near is not None:
            place = place or _place(height, near.centre_mm, near.radius_mm, indenter)
            tape.readings.append(place.read(*tape.maps.pop()))
    if tape.face is None or len(tape.times) < 2:
        return None
    return _measure(tape, tape.face(), press=press, indenter=indenter, near=near)


def _take(tape: _TrackRecorder, frame: Frame, reconstructor: Reconstructs) -> HeightMap:
    height, rgb, complete = reconstructor.depth_map(frame)
    coarse = _shrink(np.where(height.valid, height.depth_mm, np.nan), height.mm_per_px)
    tape.names.append(frame.name)
    tape.times.append(frame.time_s)
    picture = _shrink(rgb, height.mm_per_px)
    tape.maps.append((coarse, picture.astype(np.float16)))
    smooth = cv2.blur(np.nan_to_num(coarse), (9, 9))
    top = float(smooth.max())
    if top > tape.top:
        row, column = np.unravel_index(int(smooth.argmax()), smooth.shape)
        middle = ((smooth.shape[1] - 1) / 2, (smooth.shape[0] - 1) / 2)
        scale = _scale(height)
        tape.deepest_mm = (float(column) - middle[0]) / scale[0], (float(row) - middle[1]) / scale[1]
        tape.top, tape.deepest, tape.face = top, len(tape.times) - 1, complete
    if top > 0.5 * _WALL_MM and abs(top - _WALL_MM) < tape.wall_off:
        tape.wall_off, tape.wall_map = abs(top - _WALL_MM), height
    return height


def _coarse_size(height: HeightMap) -> tuple[int, int]:
    rows, columns = height.depth_mm.shape
    return (
        max(round(columns * height.mm_per_px[0] / GRID_MM), 8),
        max(round(rows * height.mm_per_px[1] / GRID_MM), 8),
    )


def _scale(height: HeightMap) -> Pair:
    """Return coarse pixels per mm."""
    (columns, rows), shape = _coarse_size(height), height.depth_mm.shape
    return columns / (shape[1] * height.mm_per_px[0]), rows / (shape[0] * height.mm_per_px[1])


def _shrink(field_: npt.NDArray[Any], mm_per_px: Pair) -> CoarseMap:
    rows, columns = field_.shape[:2]
    size = (max(round(columns * mm_per_px[0] / GRID_MM), 8), max(round(rows * mm_per_px[1] / GRID_MM), 8))
    small = cv2.resize(field_.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)


def _place(height: HeightMap, centre_mm: Pair, radius_mm: float, indenter: Indenter) -> _Place:
    (columns, rows), scale = _coarse_size(height), _scale(height)
    radius = radius_mm if np.isfinite(radius_mm) else 1.0
    reach = 0.55 * float(np.hypot(columns / scale[0], rows / scale[1]))
    centre_px = (centre_mm[0] * scale[0] + (columns - 1) / 2, centre_mm[1] * scale[1] + (rows - 1) / 2)
    rings = np.arange(radius, reach, GRID_MM)
    face, basis = _face_basis((rows, columns), centre_px, scale, 0.7 * radius)
    return _Place(
        centre_px,
        scale,
        radius,
        indenter.bevel or "right",
        strip_places(reach),
        rings,
        face,
        basis,
        np.asarray(np.linalg.pinv(basis), dtype=np.float64),
    )


def _footprint(tape: _TrackRecorder, face_map: HeightMap, indenter: Indenter) -> Footprint | None:
    """Return the deepest face, its circle from shallow frames: steep walls enlarge the deep one."""
    deep = find_footprint(face_map, indenter)
    if deep is None or tape.wall_map is None or tape.wall_map.depth_mm is face_map.depth_mm:
        return deep
    shallow = find_footprint(tape.wall_map, indenter)
    if shallow is None or abs(shallow.radius_mm - deep.radius_mm) > _MAX_RADIUS_CHANGE * deep.radius_mm:
        return deep
    return replace(
        deep,
        mask=shallow.mask,
        centre_mm=shallow.centre_mm,
        centre_std_mm=shallow.centre_std_mm,
        radius_mm=shallow.radius_mm,
        radius_std_mm=shallow.radius_std_mm,
        residual_mm=shallow.residual_mm,
    )


def _measure(
    tape: _TrackRecorder, face_map: HeightMap, *, press: Press, indenter: Indenter, near: Footprint | None
) -> PressTrack:
    footprint = _footprint(tape, face_map, indenter)
    known = near or footprint
    centre, radius = (known.centre_mm, known.radius_mm) if known else (tape.deepest_mm, indenter.radius_mm)
    place = _place(face_map, centre, radius, indenter)
    readings = tape.readings or [place.read(*maps) for maps in tape.maps]
    order = np.argsort(tape.times, kind="stable")
    face, strips, colours, rings = (np.array([readings[k][part] for k in order]) for part in range(4))
    zero = _zero(face[:, 0])
    return PressTrack(
        press=press,
        indenter=indenter,
        names=tuple(tape.names[k] for k in order),
        time_s=np.array(tape.times)[order],
        depth_mm=face[:, 0] - zero,
        zero_mm=zero,
        tilts=face[:, 1:],
        s_mm=place.s_mm,
        strips=strips,
        colours=colours,
        r_mm=place.r_mm,
        rings=rings,
        deepest=int(np.flatnonzero(order == tape.deepest)[0]),
        face_map=face_map,
        footprint=footprint,
        missing=tuple(tape.missing),
    )


def face_tilt(track: PressTrack) -> Floats:
    """Return the tilt (2,) rad of the face while it is deep, the median over those frames."""
    return np.asarray(np.nanmedian(deep_tilts(track), axis=0), dtype=np.float64)


def deep_tilts(track: PressTrack) -> Floats:
    """Return the tilt (N, 2) rad of the face in each frame that shows it deep."""
    return track.tilts[track.depth_mm > DEEP * np.nanmax(track.depth_mm)]


def _face_basis(shape: tuple[int, int], centre_px: Pair, scale: Pair, radius_mm: float) -> tuple[Bools, Floats]:
    """Return the pixels (H, W) of the face, and 1, x, y (K, 3) there in mm from its centre."""
    x = ((np.arange(shape[1]) - centre_px[0]) / scale[0])[None, :]
    y = ((np.arange(shape[0]) - centre_px[1]) / scale[1])[:, None]
    face = np.hypot(x, y) < radius_mm
    x, y = np.broadcast_to(x, face.shape)[face], np.broadcast_to(y, face.shape)[face]
    return face, np.c_[np.ones_like(x), x, y]


def _rings(depth: CoarseMap, centre_px: Pair, scale: Pair, r: Floats, side: str) -> Floats:
    """Return mean depth (4, R) over quarters of rings: towards the bevel, away, across; NaN unseen."""
    along = np.arctan2(SIDES[side][1], SIDES[side][0])
    turn = np.deg2rad(np.arange(-44, 45, 8.0))
    angles = np.concatenate([along + k + turn for k in (0, np.pi, np.pi / 2, -np.pi / 2)])
    places = np.stack(
        [
            centre_px[0] + scale[0] * r[None, :] * np.cos(angles)[:, None],
            centre_px[1] + scale[1] * r[None, :] * np.sin(angles)[:, None],
        ],
        axis=-1,
    )
    return np.asarray(sample(depth, places).reshape(4, turn.size, r.size).mean(axis=1))


def _zero(level: Floats) -> float:
    """Return the face's level before contact: median of readings within the noise of the lowest tenth."""
    known = level[np.isfinite(level)]
    if known.size == 0:
        return 0.0
    low = float(np.quantile(known, 0.05))
    noise = second_difference_std(known) if known.size > 4 else 0.0
    free = known[known < low + max(5 * noise, 0.02 * float(np.ptp(known)))]
    return float(np.median(free)) if free.size >= 3 else 0.0


# The effect of strong compression on a touch: dents fainter than its steps are rounded away, and detected late.
#
# The steps between its blocks of 8 pixels indicate its strength, b in grey levels. All touches of a recording
# have a common delay, one sigma of _LATE_MM_PER_GREY (b - USUAL_GREY) in addition to the uncertainty of the dent's
# shape. JPEG of quality 80 and above stays below USUAL_GREY.

USUAL_GREY = 1.0  # grey levels between blocks up to which touches are not seen later; docs/how-to/lerobot.md
_LATE_MM_PER_GREY = 0.005  # mm, of touches in two samples packed as JPEG and MJPEG; docs/how-to/lerobot.md


def note_blocks(frames: Iterable[Frame | BadFrame], blocks: list[float]) -> Iterator[Frame | BadFrame]:
    """Yield the frames; `blocks` (grey levels) grows by the block steps of the first sound one."""
    looked = False
    for frame in frames:
        if not looked and not isinstance(frame, BadFrame):
            blocks.append(blocks_grey(frame.rgb))
            looked = True
        yield frame


def late_std_mm(blocks: Sequence[float]) -> float:
    """Return the std (mm) of the touches' common delay; 0 for `blocks` (grey levels) of usual pictures."""
    return _LATE_MM_PER_GREY * max(_typical(blocks) - USUAL_GREY, 0.0)


def compression_warnings(blocks: Sequence[float]) -> tuple[str, ...]:
    """Return a warning where strong compression delays the detection of touches."""
    late = late_std_mm(blocks)
    if not late:
        return ()
    return (
        f"Frames are strongly compressed: blocks of 8 pixels differ by {_typical(blocks):.1f} grey levels. Faint "
        f"dents are lost, so touches of the bevel may be seen {1e3 * late:.0f} um late more than usual, which "
        "widens the interval of c, and less of the presses may be used. Record single pictures (PNG, or JPEG of "
        "quality 90 and more) or a lossless video (FFV1).",
    )


def _typical(blocks: Sequence[float]) -> float:
    return float(np.median(blocks)) if blocks else 0.0


# Frames of a video that were not seen anew: a strong compression copies what hardly changed since the one before.
#
# A picture that grows by less than the coder's step between two frames is shown late, by as much as a frame or
# more, equally on the way in and out, which no clock fit detects. A frame that is coded by itself shows
# the sensor's noise: few of its pixels are the same as before. What the others have alike beyond that was copied.

_THIN = 3  # pixels from one that is compared to the next
_MOSTLY = 0.5  # share of the picture that is copied, where the clock is no longer trusted; test_repeated_frames
_MIN_PAIRS = 12  # pairs of frames: a coder's whole group of pictures


def note_repeats(frames: Iterable[Frame | BadFrame], repeats: list[float]) -> Iterator[Frame | BadFrame]:
    """Yield the frames; `repeats` grows by the share of pixels that each repeats."""
    before = None
    for frame in frames:
        if not isinstance(frame, BadFrame):
            now = frame.rgb[::_THIN, ::_THIN]
            if before is not None:
                repeats.append(float((now == before).all(axis=-1).mean()))
            before = now
        yield frame


def repeated_share(repeats: Sequence[float]) -> float:
    """Return the share of the picture that the median frame copies; 0 for too few frames."""
    if len(repeats) < _MIN_PAIRS:
        return 0.0
    anew, typical_share = float(np.quantile(repeats, 0.03)), float(np.median(repeats))
    return (typical_share - anew) / (1 - anew) if anew < 1 else 0.0


def allow_for_repeats(offset: Estimate, share: float, *, times_s: Floats) -> tuple[Estimate, tuple[str, ...]]:
    """Return the clocks' offset (s) with its std increased by a frame's interval, and a warning.

    Where most of each picture is a copy: `share` of it, frames at `times_s` (n,). Otherwise as it was.
    """
    if share < _MOSTLY or offset.value is None or times_s.size < 2:
        return offset, ()
    interval = float(np.median(np.diff(times_s)))
    std = float(np.hypot(offset.std or 0.0, interval))
    return Estimate.normal(offset.value, std, "s"), (
        f"The video is so strongly compressed that {100 * share:.0f} % of a frame is copied from the one before: "
        f"it may lag by a frame, and the clocks' uncertainty was widened by {1e3 * interval:.0f} ms.",
    )
