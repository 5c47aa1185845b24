"""Combine the depth of a face from its walls with that from its cast shadows.

    w = sum_i w_i/s_i^2 / sum_i 1/s_i^2,    i: the map, the shadow (depth_by_shadow.py), s_i what each states

The face is moved as a whole, and the steepest of its wall carries the change; gel beside it stays. Where the two
differ by more than they state, the deviation of the face grows by as much, and the map is flagged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.depth_by_shadow import FACE, ShadowDepth, depth_by_shadow
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.photometric.illumination.cast_shadow import SMOOTH_PX, LightField
from tactilevision.photometric.illumination.interreflection import reflected
from tactilevision.records.maps import CONTRARY, add
from tactilevision.records.measured import Bools, Bytes, Pair

Depth = npt.NDArray[np.floating[Any]]
Mapped = tuple[Depth, Bools, Depth | None, tuple[str, ...]]

BRIGHTEST = 250  # grey levels: a brighter picture is overexposed
DARKEST = 4  # grey levels: a darker reference tells no light over it
CONTRARY_STD = 2.0  # stated deviations that wall and shadow may differ by


def with_shadow_depths(
    mapped: Mapped,
    rgb: Bytes,
    reference: npt.NDArray[np.floating[Any]],
    field: LightField,
    edges: Sequence[PunchEdge],
    *,
    thickness_mm: float,
) -> Mapped:
    """A map (H, W) mm of a picture `rgb` (H, W, 3) whose shadows are undone, its faces as their shadows have them.

    `reference` (H, W, 3) is the untouched picture in grey levels. Itself without refined lamps or a deviation.
    """
    surface, valid, std, flags = mapped
    lamps = field.lamps.refined
    if lamps is None or std is None or not edges:
        return mapped
    light = _light(rgb, reference, power=lamps.power)
    usable = valid & (rgb.max(axis=2) < BRIGHTEST) & (reference.min(axis=2) > DARKEST)
    extra = reflected(field, surface) ** np.float32(field.lamps.power) - 1.0
    for edge in (one for one in edges if one.fall_at_reach_mm > 0):
        seen = depth_by_shadow(
            edge,
            surface,
            light=light,
            usable=usable,
            reflected=extra,
            lamps=lamps,
            mm_per_px=field.mm_per_px,
            thickness_mm=thickness_mm,
        )
        if seen is not None:
            surface, std, contrary = _moved(surface, std, edge, seen, mm_per_px=field.mm_per_px)
            flags = add(flags, (CONTRARY,) if contrary else ())
    return surface, valid, std, flags


def _light(rgb: Bytes, reference: npt.NDArray[np.floating[Any]], *, power: float) -> Depth:
    now, before = (cv2.GaussianBlur(np.asarray(one, np.float32), (0, 0), SMOOTH_PX) for one in (rgb, reference))
    return np.asarray((now / np.maximum(before, 1.0)) ** np.float32(power))


def _moved(
    surface: Depth, std: Depth, edge: PunchEdge, seen: ShadowDepth, *, mm_per_px: Pair
) -> tuple[Depth, Depth, bool]:
    """Surface and deviation (H, W) mm with the face as both readings have it, and whether they are contrary."""
    y, x = (
        np.arange(n) * mm - at
        for n, mm, at in zip(surface.shape, mm_per_px[::-1], edge.centre_mm[::-1], strict=True)
    )
    r = np.hypot(x[None, :], y[:, None])
    face = r < FACE * edge.radius_mm
    read, own = float(surface[face].mean()), float(np.sqrt(np.mean(std[face] ** 2)))
    change = own**2 / (own**2 + seen.std_mm**2) * (seen.depth_mm - read)
    off = abs(seen.depth_mm - read) / float(np.hypot(own, seen.std_mm))
    both = own * seen.std_mm / float(np.hypot(own, seen.std_mm)) * max(1.0, off)
    part = np.interp(r - edge.radius_mm, edge.places_mm, edge.carried(change))
    told = std * (1.0 + part * (both / own - 1.0))
    return (surface + part * change).astype(surface.dtype), told.astype(std.dtype), off > CONTRARY_STD
