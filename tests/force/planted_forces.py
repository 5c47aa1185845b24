"""Contacts with known force, moved by a transform of the whole plane on points finer than any cell."""

from __future__ import annotations

from functools import cache

import numpy as np

from benchmarks.force_cases import Forward, View, seen
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

VIEW = View((90, 120), 0.171, 4)
SCALE = (VIEW.mm_per_px, VIEW.mm_per_px)
GEL, MATERIAL = Gel(3.0), Material(0.2, 0.48)


def hertz(radius_mm: float, centre_mm: tuple[float, float], force_N: tuple[float, float, float]) -> Floats:
    """Traction (3, H', W') of a sheared Hertz patch with the given force."""
    x, y = VIEW.mesh()
    shape = np.sqrt(np.clip(1 - ((x - centre_mm[0]) ** 2 + (y - centre_mm[1]) ** 2) / radius_mm**2, 0, None))
    shape /= shape.sum() * (VIEW.mm_per_px / VIEW.fine) ** 2
    return np.stack([f * shape for f in force_N])


def measured(traction: Floats, *, std_mm: float = 0.005, seed: int = 0) -> tuple[HeightMap, ShearMap]:
    """What the camera makes of a traction on the linear layer."""
    return seen(_forward()(traction), VIEW, std_mm=std_mm, rng=np.random.default_rng(seed))


def displacement(traction: Floats) -> Floats:
    """(3, H, W) mm, by a traction (3, H', W') on the linear layer, at positions of the untouched gel."""
    return _forward()(traction)


@cache
def _forward() -> Forward:
    return Forward(VIEW, GEL, MATERIAL)
