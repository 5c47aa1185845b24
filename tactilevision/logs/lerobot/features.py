"""The features that are written beside a camera: their schema for LeRobot, and their values for one frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.profile.seen import Seen
from tactilevision.profile.sensor import CalibratedSensor
from tactilevision.records import Bytes, Floats

STEP_MM = 2.0**-10  # mm: depths are rounded to this, far below their deviation, so that tables pack well
WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nmm", "my_Nmm", "mz_Nmm")


@dataclass(frozen=True, slots=True)
class Reading:
    """What one frame tells: depth (h, w) in mm, NaN where it is not known; wrench (6,) in N and N mm."""

    depth_mm: Floats
    contact: bool
    peak_mm: float
    area_mm2: float
    wrench: Floats
    flags: str


def base_of(camera: str) -> str:
    """What the keys of the new features begin with: observation.images.left -> observation.left.

    LeRobot takes a key with "image" in it for a picture; so such a word becomes "tactile".
    """
    name = camera.removeprefix("observation.").removeprefix("images.")
    return "observation." + name.replace("images", "tactile").replace("image", "tactile")


def schema(base: str, sensor: CalibratedSensor, *, shrink: int) -> dict[str, dict[str, Any]]:
    """Keys of the new features, and what info.json says of each; a wrench only where E and nu are known."""
    size = sensor.profile.sensor.height_px // shrink, sensor.profile.sensor.width_px // shrink
    scale = [one * shrink for one in sensor.mm_per_px]
    told = {"profile": sensor.profile.name, "mm_per_px": scale, "positive": "into the gel"}
    found: dict[str, dict[str, Any]] = {
        f"{base}.depth_mm": _feature("float32", list(size), ["height", "width"]) | {"info": told},
        f"{base}.contact": _feature("bool", [1], None),
        f"{base}.peak_mm": _feature("float32", [1], None),
        f"{base}.area_mm2": _feature("float32", [1], None),
        f"{base}.flags": _feature("string", [1], None),
    }
    if sensor.field is not None:
        found[f"{base}.wrench"] = _feature("float32", [6], list(WRENCH))
    return found


def read_frame(sensor: CalibratedSensor, rgb: Bytes, *, shrink: int) -> Reading:
    """What a frame (H, W, 3) uint8 tells, in mm and N; one that is not read is all NaN, and its flags say why."""
    try:
        seen = sensor.read(rgb)
    except InputError as fault:
        size = sensor.profile.sensor.height_px // shrink, sensor.profile.sensor.width_px // shrink
        nothing = np.full(6, np.nan)
        return Reading(np.full(size, np.nan), False, np.nan, np.nan, nothing, f"not read: {fault.what}")
    assert isinstance(seen, Seen)
    height, wrench = seen.height, seen.wrench
    depth = np.where(height.valid, height.depth_mm, np.nan)
    pressed = seen.contact & height.valid
    return Reading(
        depth_mm=shrunk(np.round(depth / STEP_MM) * STEP_MM, shrink),
        contact=bool(seen.contact.any()),
        peak_mm=float(height.depth_mm[pressed].max()) if pressed.any() else 0.0,
        area_mm2=float(seen.contact.sum() * np.prod(height.mm_per_px)),
        wrench=np.full(6, np.nan) if wrench is None else np.array([*wrench.force_N, *wrench.moment_Nmm]),
        flags="; ".join(seen.flags),
    )


def shrunk(depth_mm: Floats, factor: int) -> Floats:
    """Means of blocks of `factor` x `factor` pixels of a map (H, W) in mm; NaN where half of one is not known."""
    if factor == 1:
        return depth_mm
    rows, columns = depth_mm.shape[0] // factor, depth_mm.shape[1] // factor
    blocks = depth_mm[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    known = np.isfinite(blocks).sum(axis=(1, 3))
    total = np.where(np.isfinite(blocks), blocks, 0.0).sum(axis=(1, 3))
    means = np.where(2 * known > factor**2, total / np.maximum(known, 1), np.nan)
    return np.asarray(np.round(means / STEP_MM) * STEP_MM)


def columns_of(readings: list[Reading], keys: Mapping[str, Any], base: str) -> dict[str, list[Any]]:
    """The values of the features `keys` for a part of the table, one of each frame."""
    every: dict[str, list[Any]] = {
        "depth_mm": [one.depth_mm.astype(np.float32) for one in readings],
        "contact": [one.contact for one in readings],
        "peak_mm": [one.peak_mm for one in readings],
        "area_mm2": [one.area_mm2 for one in readings],
        "flags": [one.flags for one in readings],
        "wrench": [one.wrench.astype(np.float32) for one in readings],
    }
    return {key: every[key.removeprefix(f"{base}.")] for key in keys}


def _feature(kind: str, shape: list[int], names: list[str] | None) -> dict[str, Any]:
    return {"dtype": kind, "shape": shape, "names": names}
