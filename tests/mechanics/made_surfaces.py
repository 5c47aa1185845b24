"""Surfaces round a flat punch as a height map would show them, with faults of the map that are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter

from tactilevision.mechanics.profile import ProfileSource, PunchCase, linear_profile, seen_profile
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.records.measured import Floats

DEPTHS_MM = (0.15, 0.3, 0.4, 0.5, 0.6)
PX_MM, SHAPE = 0.12, (170, 224)
RADIUS_MM, THICKNESS_MM = 2.5, 3.0


def noise(rng: np.random.Generator, std_mm: float, length_mm: float, px_mm: float = PX_MM) -> Floats:
    """A field of `std_mm` whose correlation is exp(-d^2/(4 length^2))."""
    field = gaussian_filter(rng.normal(size=SHAPE), length_mm / px_mm, mode="wrap")
    return np.asarray(field * std_mm / field.std())


def surface(
    poisson_ratio: float,
    depth_mm: float,
    centre_mm: tuple[float, float],
    *,
    radius_mm: float = RADIUS_MM,
    friction: float = 0.0,
    source: ProfileSource = linear_profile,
) -> Floats:
    """Depth of the gel's surface on the grid of the picture, mm."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    x = (columns - (SHAPE[1] - 1) / 2) * PX_MM - centre_mm[0]
    y = (rows - (SHAPE[0] - 1) / 2) * PX_MM - centre_mm[1]
    grid = np.linspace(0, 20, 4001)
    case = PunchCase(poisson_ratio, radius_mm / THICKNESS_MM, depth_mm / THICKNESS_MM, friction)
    profile = -depth_mm * seen_profile(grid / radius_mm, case, source=source)
    return np.asarray(np.interp(np.hypot(x, y), grid, profile))


def views(
    poisson_ratio: float,
    rng: np.random.Generator,
    *,
    depths_mm: Sequence[float] = DEPTHS_MM,
    noise_mm: float = 0.005,
    source: ProfileSource = linear_profile,
    friction: float = 0.0,
) -> list[SurfaceView]:
    """Presses with a gain of 3 %, tilted and shifted zero planes, centres known to .05 mm, depths to .005."""
    gain = 1 + 0.03 * rng.normal()
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    found = []
    for number, depth in enumerate(depths_mm):
        x, y = rng.normal(0, 0.3, 2)
        offset, along, down = rng.normal(0, [0.01, 0.002, 0.002])
        plane = offset + PX_MM * (along * columns + down * rows)
        depth_map = gain * surface(poisson_ratio, depth, (x, y), source=source, friction=friction) + plane
        if noise_mm:
            depth_map = depth_map + noise(rng, noise_mm, 1.0)
        centre = (x + rng.normal(0, 0.05), y + rng.normal(0, 0.05)) if noise_mm else (x, y)
        known = depth + rng.normal(0, 0.005)
        view = SurfaceView(depth_map, np.ones(SHAPE, bool), (PX_MM, PX_MM), RADIUS_MM, centre, name=str(number))
        found.append(replace(view, certified_depth_mm=known, certified_depth_std_mm=0.005))
    return found
