"""Height maps of a flat punch with a bevel, drawn by formula: nothing of the package draws them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter

from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Floats, Pair
from tactilevision.records.rig import Indenter

# depth over w beside the punch (a = 2.5 mm, h = 3 mm, nu = .48), against the root of the way from its edge
_REACH = np.sqrt(np.array([0.0, 0.8, 1.5, 2.5, 3.5, 5.5, 7.5, 12.5]))
_BESIDE = PchipInterpolator(_REACH, [1.0, 0.0, -0.09, -0.10, -0.073, -0.028, -0.012, 0.0])
RISE = 0.10  # over the depth, at 5 mm from the axis
SIDES = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "bottom": (0.0, 1.0), "top": (0.0, -1.0)}


@dataclass(frozen=True)
class Scene:
    """A view of a punch in mm; `noise_mm` is alike over `correlation_mm`."""

    size_px: tuple[int, int] = (427, 320)
    mm_per_px: Pair = (0.0634, 0.0634)
    centre_mm: Pair = (0.4, -0.3)
    radius_mm: float = 2.5
    depth_mm: float = 0.3
    tilt: Pair = (0.0, 0.0)
    side: str = "right"
    height_mm: float | None = None
    bevel_distance_mm: float = 5.0
    plane: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gain: float = 1.03
    noise_mm: float = 0.005
    correlation_mm: float = 1.0
    blur_mm: float = 0.08

    def at(self, depth_mm: float) -> Scene:
        return replace(self, depth_mm=depth_mm)

    def indenter(self) -> Indenter:
        return Indenter(
            "A1",
            radius_mm=self.radius_mm,
            height_mm=self.height_mm,
            height_std_mm=0.002,
            bevel=self.side,  # type: ignore[arg-type]
            bevel_distance_mm=self.bevel_distance_mm,
        )


def grid(scene: Scene) -> tuple[Floats, Floats]:
    """x (1, W) and y (H, 1) from the punch's axis."""
    columns, rows = scene.size_px
    x = (np.arange(columns) - (columns - 1) / 2) * scene.mm_per_px[0] - scene.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * scene.mm_per_px[1] - scene.centre_mm[1]
    return np.asarray(x[None, :], dtype=np.float64), np.asarray(y[:, None], dtype=np.float64)


def surface(scene: Scene) -> Floats:
    """Depth (H, W) in mm before gain, plane and noise, blurred."""
    x, y = grid(scene)
    r = np.hypot(x, y)
    unit = np.where(r <= scene.radius_mm, 1.0, _BESIDE(np.sqrt(np.clip(r - scene.radius_mm, 0, 12.5))))
    face = np.maximum(scene.depth_mm + scene.tilt[0] * x + scene.tilt[1] * y, 0)
    depth = np.where(r <= scene.radius_mm, face, scene.depth_mm * unit)
    if scene.height_mm is not None:
        along = SIDES[scene.side][0] * x + SIDES[scene.side][1] * y
        beyond = along - scene.bevel_distance_mm
        bevel = scene.depth_mm - scene.height_mm - np.tan(np.radians(10)) * beyond
        push = np.where(beyond >= 0, bevel - depth, -1.0)
        depth = np.where(push > 0, bevel, depth)
    return np.asarray(gaussian_filter(depth, [scene.blur_mm / s for s in scene.mm_per_px[::-1]]))


def height_map(scene: Scene, rng: np.random.Generator) -> HeightMap:
    x, y = grid(scene)
    noise = gaussian_filter(
        rng.standard_normal(scene.size_px[::-1]), [scene.correlation_mm / 2 / s for s in scene.mm_per_px[::-1]]
    )
    depth = scene.gain * surface(scene) + scene.plane[0] + scene.plane[1] * x + scene.plane[2] * y
    depth = depth + scene.noise_mm * noise / noise.std()
    return HeightMap(depth, np.ones(depth.shape, dtype=bool), scene.mm_per_px)
