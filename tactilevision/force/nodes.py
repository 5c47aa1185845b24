"""Square cells of constant traction, and means of pictures over them.

A cell is `spacing_mm` wide; its displacement is the mean over the cell. Cells are wholly inside the view and
centred on it. Means weigh each pixel by its overlap with the cell:

    u_cell = sum_px overlap * valid * u_px / sum_px overlap * valid,      separable: rows @ picture @ columns.T
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bools, Floats, Pair

Array = npt.NDArray[np.floating[Any]]
Singles = npt.NDArray[np.float32]
Cells = npt.NDArray[np.intp]  # flat indices
KNOWN_SHARE = 0.5  # least known share of a known cell
BAND = 8  # rows of cells in one product, which is with few zeros


@dataclass(frozen=True, slots=True)
class NodeGrid:
    """`shape` (rows, columns) of cells `spacing_mm` wide over a view of `view_px` (H, W) at `mm_per_px` (x, y)."""

    shape: tuple[int, int]
    spacing_mm: float
    view_px: tuple[int, int]
    mm_per_px: Pair

    @property
    def x_mm(self) -> Floats:
        """Places of the columns on the pad."""
        return np.asarray((np.arange(self.shape[1]) - (self.shape[1] - 1) / 2) * self.spacing_mm, dtype=np.float64)

    @property
    def y_mm(self) -> Floats:
        """Places of the rows on the pad."""
        return np.asarray((np.arange(self.shape[0]) - (self.shape[0] - 1) / 2) * self.spacing_mm, dtype=np.float64)

    @property
    def cell_mm2(self) -> float:
        """Area of one cell."""
        return self.spacing_mm**2


def lay_grid(view_px: tuple[int, int], mm_per_px: Pair, *, spacing_mm: float) -> NodeGrid:
    """Lay as many whole cells as fit into the view.

    Raises InputError for a scale or spacing that makes no grid.
    """
    if not all(np.isfinite(s) and s > 0 for s in mm_per_px):
        raise InputError(
            "forces need the scale in mm per pixel, x and y, above 0",
            where="lay_grid",
            value=mm_per_px,
            remedy="Set sensor.mm_per_px in recording.toml.",
        )
    if not spacing_mm >= max(mm_per_px):
        raise InputError("the spacing of the forces is at least a pixel", where="lay_grid", value=spacing_mm)
    shape = (
        int(view_px[0] * mm_per_px[1] / spacing_mm + ROUNDING),
        int(view_px[1] * mm_per_px[0] / spacing_mm + ROUNDING),
    )
    if min(shape) < 4:
        raise InputError(
            "the view is less than 4 cells wide",
            where="lay_grid",
            value=shape,
            remedy="Check mm_per_px, or choose a finer spacing.",
        )
    return NodeGrid(shape, float(spacing_mm), view_px, mm_per_px)


def cell_means(grid: NodeGrid, picture: Array, *, valid: Bools | None) -> tuple[Floats, Bools]:
    """Return the mean of `picture` (H, W) over each cell, in its unit, and a mask of cells that are known well
    enough.

    Cells that are not known are 0.
    """
    single = np.asarray(picture, dtype=np.float32)
    if valid is None or valid.all():
        return _averages(grid, single), np.ones(grid.shape, dtype=bool)
    share = _shares(grid, np.packbits(valid).tobytes())
    total, known = _averages(grid, np.where(valid, single, np.float32(0))), share >= KNOWN_SHARE
    return np.divide(total, share, out=np.zeros(grid.shape), where=known), known


def _averages(grid: NodeGrid, single: Singles) -> Floats:
    """Return the averages (rows, columns) of a picture (H, W) over the cells, a band of rows at a time."""
    bands, along = _overlaps(grid)
    return np.asarray(np.concatenate([down @ single[rows] for rows, down in bands]) @ along, dtype=np.float64)


@lru_cache(maxsize=8)
def _shares(grid: NodeGrid, valid: bytes) -> Floats:
    """Return the share (rows, columns) of each cell that packed pixels say to be valid."""
    height, width = grid.view_px
    bits = np.unpackbits(np.frombuffer(valid, np.uint8), count=height * width)
    return _averages(grid, bits.reshape(height, width).astype(np.float32))


@lru_cache(maxsize=8)
def _overlaps(grid: NodeGrid) -> tuple[list[tuple[slice, Singles]], Singles]:
    """Return rows of pixels with (n, rows) for each band of cells, and (W, columns): the share of each pixel in
    each cell, summing to 1 over a cell.
    """
    down = _overlap(grid.view_px[0], grid.mm_per_px[1], grid.shape[0], grid.spacing_mm).astype(np.float32)
    along = _overlap(grid.view_px[1], grid.mm_per_px[0], grid.shape[1], grid.spacing_mm)
    bands = []
    for part in np.array_split(down, -(-len(down) // BAND)):
        used = np.flatnonzero(part.any(axis=0))
        rows = slice(int(used[0]), int(used[-1]) + 1)
        bands.append((rows, np.ascontiguousarray(part[:, rows])))
    return bands, np.ascontiguousarray(along.T, dtype=np.float32)


def _overlap(pixels: int, pixel_mm: float, cells: int, cell_mm: float) -> Floats:
    start = (pixels * pixel_mm - cells * cell_mm) / 2 + np.arange(cells)[:, None] * cell_mm
    pixel = np.arange(pixels)[None, :] * pixel_mm
    covered = np.minimum(start + cell_mm, pixel + pixel_mm) - np.maximum(start, pixel)
    return np.asarray(np.clip(covered, 0, None) / cell_mm)
