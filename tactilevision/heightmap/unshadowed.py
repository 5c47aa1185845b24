"""Correct a height map for cast shadows.

    depth <- map(picture / (reflected dimming)),    both of with_faces(depth); damped, until it moves no more

The forecast of shadows (`photometric/illumination/cast_shadow.py`) needs the depth that it mends. Gel in
shadow is read too deep beside the wall, so a forecast from it is too short: round flat faces it starts from the
surface that theory has there (`pressed_gel.py`). The light that its wall sends to the gel beside it goes, too
(`interreflection.py`). Where shadows reach so far that the wall's own law finds too little gentle gel beside
it, a sharp round rim alone (heightmap/circular_edges.py) says where the face ends. Half steps from one map to
the next settle where whole ones swing. Some maps jump: as the forecast moves, slopes beside the wall pass the
limit of what is read, and the wall's law has other gel to go by. So steps shrink as 1/n, and where maps still
jump, their mean is the map (Mann's iteration). What was given back is known to a share of itself, which the
deviation holds, along with how far the last map lies off that mean. All else is the last map's. Then faces take
part of the depth that their shadows' reach tells (`faces_by_shadow.py`). What certified faces taught of walls
comes last of all: within the rounds it would move the forecast, and some maps would jump.

Assumes near lamps found from balls. What it does to faces and the gel beside is measured on pictures of a
path tracer in docs/evidence/rendered.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.circular_edges import CircularEdge, find_circular_edges
from tactilevision.heightmap.faces_by_shadow import with_shadow_depths
from tactilevision.heightmap.pressed_gel import with_faces
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.photometric.illumination.cast_shadow import (
    LightField,
    dimming,
    reached_by_all,
    slopes_of,
    visibility,
)
from tactilevision.photometric.illumination.interreflection import reflected, without
from tactilevision.records.maps import CONTRARY, SlopeMap, add
from tactilevision.records.measured import Bools, Bytes

Mapped = tuple[npt.NDArray[np.floating[Any]], Bools, npt.NDArray[np.floating[Any]] | None, tuple[str, ...]]

MIN_DEPTH_MM = 0.08  # mm: gentler contacts cast no shadow that matters
STEP = 0.5  # of the way from one depth to the next: whole steps swing beyond .3 mm
HALF_STEPS = 5  # such steps, before they shrink: maps that settle do so in these, of 48 faces of a path tracer
MAX_ROUNDS = 10  # maps of one frame: what still moves is in the deviation
SETTLED_MM = 0.006  # mm, the most that 99 % of pixels of a map lie off the last one's, where rounds end
GIVEN_BACK_STD = 0.35  # of what the map changed by: rms on three sensors of the path tracer
RIM_SLOPE = 0.3  # slope of a rim that shadows are looked for beside: walls of faces from .1 mm on are steeper
BRIGHTEST = 250  # grey levels that a pixel is given at most, lest it count as saturated


def undo_shadows(
    mapped: Callable[[Bytes], Mapped],
    rgb: Bytes,
    field: LightField,
    *,
    again: Callable[[Bytes], Mapped],
    taught: Callable[[Bytes], Mapped] | None,
    edges: Callable[[], Sequence[PunchEdge]],
    thickness_mm: float,
    reference: npt.NDArray[np.floating[Any]] | None = None,
) -> tuple[Mapped, npt.NDArray[np.floating[Any]] | None]:
    """Depth (H, W) mm, validity, deviation and flags of a rectified picture (H, W, 3), shadows undone.

    `mapped` gives them for a picture as it is, `again` for one whose shadows are being undone, `taught` for that
    picture with walls as certified faces taught them, None where none did. `edges` are those of the picture that
    was mapped last, in a gel of `thickness_mm`. Beside the untouched `reference` (H, W, 3) in grey levels shadows
    tell faces' depths, too. And the part (H, W) mm of the deviation that the shadows bring, None for contacts too
    gentle to cast any.
    """
    surface, valid, std, flags = mapped(rgb)
    if surface.max() < MIN_DEPTH_MM:
        return (surface, valid, std, flags), None
    plain, depth, lit = surface.copy(), surface.copy(), None
    for number in range(MAX_ROUNDS):
        rims = edges() or _rims(depth, field)
        shape = with_faces(depth, rims, lit=lit, mm_per_px=field.mm_per_px, thickness_mm=thickness_mm)
        seen = visibility(field.lamps, shape, field.mm_per_px)
        lit = reached_by_all(seen)
        own = without(rgb, reflected(field, shape))
        undone = _brightened(own, dimming(field, shape, seen))
        surface, valid, std, flags = again(undone)
        last, off = surface, surface - depth
        depth += _step(number) * off
        if np.percentile(np.abs(off), 99) < SETTLED_MM:
            break
    else:
        surface = depth
    given_back = np.hypot(GIVEN_BACK_STD * (surface - plain), off)
    found: Mapped = surface, valid, _with(std, given_back), flags
    if reference is not None:
        found = with_shadow_depths(found, rgb, reference, field, edges(), thickness_mm=thickness_mm)
    if taught is not None:
        surface, valid, std, flags = _as_taught(taught, undone, kept=found[0], last=last)
        told = _with(std, given_back)
        if told is not None and found[2] is not None and CONTRARY in found[3]:
            told = np.maximum(told, found[2])
        found = surface, valid, told, add(flags, found[3])
    return found, given_back


def _with(
    std: npt.NDArray[np.floating[Any]] | None, given_back: npt.NDArray[np.floating[Any]]
) -> npt.NDArray[np.floating[Any]] | None:
    return None if std is None else np.hypot(std, given_back).astype(std.dtype)


def _as_taught(
    taught: Callable[[Bytes], Mapped],
    rgb: Bytes,
    *,
    kept: npt.NDArray[np.floating[Any]],
    last: npt.NDArray[np.floating[Any]],
) -> Mapped:
    """The `kept` map (H, W) mm with what certified faces change of the `last` one, that of the picture `rgb`."""
    kept, last = kept.copy(), last.copy()  # maps are made in arrays that the next one is made in
    surface, valid, std, flags = taught(rgb)
    return kept + (surface - last), valid, std, flags


def _step(number: int) -> float:
    """Share of the way that round `number` goes: STEP, then STEP/(1 + STEP n) of the n-th after, as of a mean."""
    return STEP / (1.0 + STEP * max(number - HALF_STEPS + 1, 0))


def _rims(depth: npt.NDArray[np.floating[Any]], field: LightField) -> Sequence[CircularEdge]:
    """Sharp round rims of a depth map (H, W) mm."""
    return find_circular_edges(SlopeMap(*slopes_of(depth, field.mm_per_px)), field.mm_per_px, limit=RIM_SLOPE)


def _brightened(rgb: Bytes, factor: npt.NDArray[np.float32]) -> Bytes:
    return np.maximum(rgb, np.minimum(np.rint(rgb / factor), BRIGHTEST).astype(np.uint8))
