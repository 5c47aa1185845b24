"""Surfaces of the gel under a body, independent of the reconstruction.

A surface gives the depth (mm, into the gel, towards the camera) and the sideways shift of the ink on a Grid of
places. z into the gel, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records.measured import Floats, Pair

Singles = npt.NDArray[np.float32]


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
        """Return x, y (H, W) from a centre."""
        x, y = np.meshgrid(self.x_mm - centre_mm[0], self.y_mm - centre_mm[1])
        return x.astype(np.float32), y.astype(np.float32)

    def distance(self, centre_mm: Pair) -> Singles:
        """Return the distance (H, W) from a centre, cached."""
        return _distance(self, centre_mm)

    def part(self, area: Area) -> tuple[slice, slice]:
        """Return the rows and columns in an area; empty where it is out of the grid."""
        columns = np.searchsorted(
            self.x_mm, [area.centre_mm[0] - area.half_mm[0], area.centre_mm[0] + area.half_mm[0]]
        )
        rows = np.searchsorted(
            self.y_mm, [area.centre_mm[1] - area.half_mm[1], area.centre_mm[1] + area.half_mm[1]]
        )
        return slice(int(rows[0]), int(rows[1])), slice(int(columns[0]), int(columns[1]))

    def finer(self, part: tuple[slice, slice], times: int) -> Grid:
        """Return the grid that divides each pixel of a part `times` along either axis."""
        offsets = (np.arange(times) + 0.5) / times - 0.5
        x = (self.x_mm[part[1], None] + offsets * self.spacing_mm[0]).ravel()
        y = (self.y_mm[part[0], None] + offsets * self.spacing_mm[1]).ravel()
        return Grid(x, y)


class Surface:
    """A gel surface: the untouched gel, of which others differ in depth, steep areas and the shift of the ink."""

    @property
    def steep(self) -> tuple[Area, ...]:
        """Areas where slopes change within a pixel."""
        return ()

    def depth_mm(self, grid: Grid) -> Singles:
        """Return the depth (H, W) mm on the grid."""
        return np.zeros((grid.y_mm.size, grid.x_mm.size), np.float32)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Return the sideways shift (H, W) mm of the ink at each place in x and in y."""
        zero = np.zeros((grid.y_mm.size, grid.x_mm.size), np.float32)
        return zero, zero.copy()


@dataclass(frozen=True)
class Flat(Surface):
    """The untouched gel."""


@dataclass(frozen=True)
class Prescribed(Surface):
    """A given height map: `depth_map_mm` on `map_grid`, linear in between, nearest beyond. No sideways shift."""

    depth_map_mm: Floats
    map_grid: Grid
    steep: tuple[Area, ...] = ()

    def depth_mm(self, grid: Grid) -> Singles:
        """Return the depth (H, W) mm on the grid."""
        from scipy.ndimage import map_coordinates

        step_x, step_y = self.map_grid.spacing_mm
        rows = (grid.y_mm - self.map_grid.y_mm[0]) / step_y
        columns = (grid.x_mm - self.map_grid.x_mm[0]) / step_x
        places = np.meshgrid(rows, columns, indexing="ij")
        return np.asarray(map_coordinates(self.depth_map_mm, places, order=1, mode="nearest"), dtype=np.float32)


def smooth_step(x: Floats) -> Floats:
    """Return 3 x² - 2 x³ of x clipped to 0 to 1, of any shape."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3 - 2 * x))


@lru_cache(maxsize=16)
def _distance(grid: Grid, centre_mm: Pair) -> Singles:
    x, y = grid.places(centre_mm)
    return np.asarray(np.hypot(x, y), dtype=np.float32)


def lookup(r: Singles, places: Floats, values: Floats, *, rounding_mm: float = 0.0) -> Singles:
    """Return `values` (n,) interpolated at distances `r` (H, W) mm: constant below the first, 0 after the last."""
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
