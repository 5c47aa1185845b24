"""The gel's surface under a body: what the camera looks at, with nothing of the reconstruction in it.

A surface is a function of a Grid of places on the pad; it gives the depth (mm, into the gel, towards the
camera) and how far the gel's ink has been carried sideways. z into the gel, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools, Floats, Indenter, Pair
from tactilevision.synthetic.profile import PunchProfile

Singles = npt.NDArray[np.float32]
_SIDES: dict[str, Pair] = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "top": (0.0, -1.0), "bottom": (0.0, 1.0)}


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle on the pad."""

    centre_mm: Pair
    half_mm: Pair


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Places on the pad in mm: columns `x_mm` (W,), rows `y_mm` (H,), both evenly spaced."""

    x_mm: Floats
    y_mm: Floats

    @property
    def spacing_mm(self) -> Pair:
        return float(self.x_mm[1] - self.x_mm[0]), float(self.y_mm[1] - self.y_mm[0])

    def places(self, centre_mm: Pair = (0.0, 0.0)) -> tuple[Singles, Singles]:
        """x, y (H, W) from a centre."""
        x, y = np.meshgrid(self.x_mm - centre_mm[0], self.y_mm - centre_mm[1])
        return x.astype(np.float32), y.astype(np.float32)

    def distance(self, centre_mm: Pair) -> Singles:
        """Distance (H, W) from a centre, computed once for each centre."""
        return _distance(self, centre_mm)

    def part(self, area: Area) -> tuple[slice, slice]:
        """Rows and columns that lie in an area; empty where it is out of the grid."""
        columns = np.searchsorted(
            self.x_mm, [area.centre_mm[0] - area.half_mm[0], area.centre_mm[0] + area.half_mm[0]]
        )
        rows = np.searchsorted(
            self.y_mm, [area.centre_mm[1] - area.half_mm[1], area.centre_mm[1] + area.half_mm[1]]
        )
        return slice(int(rows[0]), int(rows[1])), slice(int(columns[0]), int(columns[1]))

    def finer(self, part: tuple[slice, slice], times: int) -> Grid:
        """The grid that divides each pixel of a part `times` along either axis."""
        offsets = (np.arange(times) + 0.5) / times - 0.5
        x = (self.x_mm[part[1], None] + offsets * self.spacing_mm[0]).ravel()
        y = (self.y_mm[part[0], None] + offsets * self.spacing_mm[1]).ravel()
        return Grid(x, y)


class Surface(Protocol):
    """A gel surface: where it changes steeply, its depth, and the sideways shift of its ink."""

    @property
    def steep(self) -> tuple[Area, ...]:
        """Where slopes change within a pixel."""
        ...

    def depth_mm(self, grid: Grid) -> Singles:
        """Depth (H, W)."""
        ...

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """How far the ink seen at each place has been carried in x and y, (H, W) each."""
        ...


@dataclass(frozen=True, slots=True)
class Flat:
    """The untouched gel."""

    steep: tuple[Area, ...] = ()

    def depth_mm(self, grid: Grid) -> Singles:
        return np.zeros((grid.y_mm.size, grid.x_mm.size), np.float32)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        return self.depth_mm(grid), self.depth_mm(grid)


@dataclass(frozen=True, slots=True)
class Prescribed:
    """Any height map: `depth_map_mm` on `map_grid`, linear in between, nearest beyond. No sideways shift."""

    depth_map_mm: Floats
    map_grid: Grid
    steep: tuple[Area, ...] = ()

    def depth_mm(self, grid: Grid) -> Singles:
        from scipy.ndimage import map_coordinates

        step_x, step_y = self.map_grid.spacing_mm
        rows = (grid.y_mm - self.map_grid.y_mm[0]) / step_y
        columns = (grid.x_mm - self.map_grid.x_mm[0]) / step_x
        places = np.meshgrid(rows, columns, indexing="ij")
        return np.asarray(map_coordinates(self.depth_map_mm, places, order=1, mode="nearest"), dtype=np.float32)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        still = np.zeros((grid.y_mm.size, grid.x_mm.size), np.float32)
        return still, still.copy()


@dataclass(frozen=True, slots=True)
class Bevel:
    """The body of an indenter beside its face: a plane that starts at a straight edge.

    The edge lies `distance_mm` from the axis towards `side`, `height_mm` behind the face; from there the plane
    falls away by `angle_deg`. It reaches `half_width_mm` to both sides along the edge.
    """

    side: str
    distance_mm: float
    height_mm: float
    angle_deg: float
    half_width_mm: float

    def along(self, x: Floats | Singles, y: Floats | Singles) -> tuple[Floats, Floats]:
        """Distances from the axis towards the bevel, and along its edge."""
        ex, ey = _SIDES[self.side]
        return np.asarray(ex * x + ey * y), np.asarray(-ey * x + ex * y)

    def area(self, centre_mm: Pair, reach_mm: Pair, beside_mm: float) -> Area:
        """The rectangle from before the edge to behind it (`reach_mm`) and `beside_mm` past both of its ends."""
        ex, ey = _SIDES[self.side]
        middle = self.distance_mm + 0.5 * (reach_mm[1] - reach_mm[0])
        half_s, half_t = 0.5 * sum(reach_mm), self.half_width_mm + beside_mm
        half = (half_s, half_t) if ex else (half_t, half_s)
        return Area((centre_mm[0] + ex * middle, centre_mm[1] + ey * middle), half)

    def depth_mm(self, s: Floats, face_mm: float) -> Floats:
        """Depth of the bevel's plane where the face stands at `face_mm`; only meant for s >= distance_mm."""
        slope = np.tan(np.deg2rad(self.angle_deg))
        return np.asarray(face_mm - self.height_mm - (s - self.distance_mm) * slope)

    def gap_mm(self, profile: PunchProfile, face_mm: float, tilt: Pair = (0.0, 0.0)) -> float:
        """Smallest distance between the bevel and the gel that rises towards it; below 0 they overlap."""
        s = self.distance_mm + np.linspace(0.0, 1.0, 21)
        s, t = np.meshgrid(s, np.linspace(-self.half_width_mm, self.half_width_mm, 41))
        ex, ey = _SIDES[self.side]
        leaning = tilt[0] * (ex * s - ey * t) + tilt[1] * (ey * s + ex * t)
        return float(np.min(profile.depth_at(np.hypot(s, t), face_mm) - self.depth_mm(s, face_mm) - leaning))

    def touch_depth_mm(self, profile: PunchProfile, tilt: Pair = (0.0, 0.0)) -> float:
        """Depth of the face at which the gel first meets the bevel: w + rise = H."""
        from scipy.optimize import brentq

        def gap(w: float) -> float:
            return self.gap_mm(profile, w, tilt)

        return float(brentq(gap, 0.0, 2.0 * self.height_mm + 0.5, xtol=1e-9))


@dataclass(frozen=True, slots=True)
class PunchPress:
    """Gel under a flat cylinder at `face_mm`, with its bevel where there is one.

    Under the face the depth is the face's plane; outside the profile beside the punch, scaled by the depth of
    the nearest point of the rim (exact without tilt). The sharp rim is rounded over `rounding_mm`, as an edge's
    radius and the ink's thickness do. Where the bevel overlaps the free surface the gel follows the bevel,
    and beside it recovers as beside a half-space's punch, (2/π) asin(1/(1 + q/ℓ)).
    """

    profile: PunchProfile
    face_mm: float
    centre_mm: Pair
    tilt: Pair = (0.0, 0.0)
    bevel: Bevel | None = None
    rounding_mm: float = 0.03

    @property
    def steep(self) -> tuple[Area, ...]:
        half = self.profile.punch_radius_mm + 1.0
        wall = Area(self.centre_mm, (half, half))
        return (wall,) if self.bevel is None else (wall, self.bevel.area(self.centre_mm, (0.5, 1.0), 0.5))

    def depth_mm(self, grid: Grid) -> Singles:
        depth = self._free(grid)
        if self.bevel is not None and self.face_mm > 0.5 * self.bevel.height_mm:
            part = grid.part(self.bevel.area(self.centre_mm, (2.5, 3.0), 2.5))
            near = Grid(grid.x_mm[part[1]], grid.y_mm[part[0]])
            if depth[part].size:
                depth[part] += _bevel_dent(
                    depth[part], self.bevel, near.places(self.centre_mm), self.face_mm, self.tilt
                )
        return depth

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        x, y = grid.places(self.centre_mm)
        r = np.maximum(grid.distance(self.centre_mm), np.float32(1e-6))
        places, _ = self.profile.seen(max(self.face_mm, 0.0))
        amount = lookup(r, places, max(self.face_mm, 0.0) * self.profile.shift) / r
        return (amount * x).astype(np.float32), (amount * y).astype(np.float32)

    def _free(self, grid: Grid) -> Singles:
        r = grid.distance(self.centre_mm)
        places, depths = self.profile.seen(1.0)
        places = self.profile.radius_mm + max(self.face_mm, 0.0) * self.profile.shift
        unit = lookup(r, places, depths, rounding_mm=self.rounding_mm)
        face = np.full_like(r, self.face_mm)
        if self.tilt != (0.0, 0.0):
            x, y = grid.places(self.centre_mm)
            inward = np.minimum(1.0, self.profile.punch_radius_mm / np.maximum(r, np.float32(1e-6)))
            face += (np.float32(self.tilt[0]) * x + np.float32(self.tilt[1]) * y) * inward
        return np.asarray(np.maximum(face, 0.0) * unit, dtype=np.float32)


@lru_cache(maxsize=16)
def _distance(grid: Grid, centre_mm: Pair) -> Singles:
    x, y = grid.places(centre_mm)
    return np.asarray(np.hypot(x, y), dtype=np.float32)


def lookup(r: Singles, places: Floats, values: Floats, *, rounding_mm: float = 0.0) -> Singles:
    """Values against the distance from the axis, held inside the first place and 0 beyond the last."""
    step = 0.005
    even = np.arange(0.0, places[-1] + 2 * step, step)
    table = np.interp(even, places, values, left=values[0], right=0.0)
    if rounding_mm > 0:
        sigma = rounding_mm / step
        table = cv2.GaussianBlur(table[None], (0, 0), sigma, borderType=cv2.BORDER_REPLICATE).ravel()
    at = np.minimum(r * np.float32(1 / step), np.float32(even.size - 2))
    low = at.astype(np.int32)
    table = table.astype(np.float32)
    below = table[low]
    return np.asarray(below + (table[low + 1] - below) * (at - low), dtype=np.float32)


def _bevel_dent(
    free: Singles, bevel: Bevel, places: tuple[Singles, Singles], face_mm: float, tilt: Pair
) -> Singles:
    """What the bevel adds to the depth of the free surface."""
    x, y = places
    s, t = bevel.along(x, y)
    plane = bevel.depth_mm(s, face_mm) + tilt[0] * x + tilt[1] * y
    under = (s >= bevel.distance_mm) & (np.abs(t) <= bevel.half_width_mm)
    overlap = np.where(under, plane - free, 0.0)
    dent = np.maximum(overlap, 0.0)
    if not (dent > 0).any():
        return np.zeros_like(free)
    return _spread(dent.astype(np.float32), dent > 0, float(abs(x[0, 1] - x[0, 0])))


def _spread(dent: Singles, touching: Bools, mm_per_px: float) -> Singles:
    """Carry a dent beyond the contact that makes it, decaying with the distance q from the contact."""
    q, nearest = cv2.distanceTransformWithLabels(
        (~touching).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    strength = np.zeros(int(nearest.max()) + 1, np.float32)
    strength[nearest[touching]] = dent[touching]
    length = 0.25
    reach = np.float32(mm_per_px / length) * q
    decay = (2 / np.pi) * np.arcsin(1 / (1 + reach)) * np.exp(-((reach / 8) ** 2))
    return np.asarray(np.where(touching, dent, strength[nearest] * decay), dtype=np.float32)


def bevel_of(indenter: Indenter, height_mm: float, distance_mm: float, angle_deg: float) -> Bevel | None:
    """The bevel of an indenter at its true height, or None where it has none."""
    if indenter.bevel is None:
        return None
    return Bevel(indenter.bevel, distance_mm, height_mm, angle_deg, indenter.radius_mm)
