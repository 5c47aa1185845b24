"""Square cells of constant traction, and a frame's displacement averaged over them.

A cell is `spacing_mm` wide; its displacement is the mean over the cell. Cells are wholly inside the view and
centred on it. Means weigh each pixel by its overlap with the cell:

    u_cell = sum_px overlap * valid * u_px / sum_px overlap * valid,      separable: rows @ picture @ columns.T
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from tactilevision.errors import InputError
from tactilevision.records.constants import MILLI, ROUNDING, TINY
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Bools, Floats, Pair
from tactilevision.robust import MAD_TO_STD

Array = npt.NDArray[np.floating[Any]]
Singles = npt.NDArray[np.float32]
Cells = npt.NDArray[np.intp]  # flat indices
KNOWN_SHARE = 0.5  # least known share of a known cell


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
    down, along = _overlaps(grid)
    single = np.asarray(picture, dtype=np.float32)
    if valid is None or valid.all():
        return np.asarray(down @ single @ along, dtype=np.float64), np.ones(grid.shape, dtype=bool)
    share = np.asarray(down @ valid.astype(np.float32) @ along, dtype=np.float64)
    total = np.asarray(down @ np.where(valid, single, np.float32(0)) @ along, dtype=np.float64)
    known = share >= KNOWN_SHARE
    return np.divide(total, share, out=np.zeros(grid.shape), where=known), known


def mean_std(grid: NodeGrid, std_mm: float, *, correlation_px: float) -> float:
    """Return the standard deviation of a cell's mean where each pixel has `std_mm`, correlated over
    `correlation_px` pixels.
    """
    pixels = grid.cell_mm2 / (grid.mm_per_px[0] * grid.mm_per_px[1])
    return float(std_mm) / float(np.sqrt(max(1.0, pixels / max(1.0, correlation_px) ** 2)))


@lru_cache(maxsize=8)
def _overlaps(grid: NodeGrid) -> tuple[Singles, Singles]:
    """Return (rows, H) and (W, columns): the share of each pixel in each cell, summing to 1 over a cell."""
    down = _overlap(grid.view_px[0], grid.mm_per_px[1], grid.shape[0], grid.spacing_mm)
    along = _overlap(grid.view_px[1], grid.mm_per_px[0], grid.shape[1], grid.spacing_mm)
    return down.astype(np.float32), np.ascontiguousarray(along.T, dtype=np.float32)


def _overlap(pixels: int, pixel_mm: float, cells: int, cell_mm: float) -> Floats:
    start = (pixels * pixel_mm - cells * cell_mm) / 2 + np.arange(cells)[:, None] * cell_mm
    pixel = np.arange(pixels)[None, :] * pixel_mm
    covered = np.minimum(start + cell_mm, pixel + pixel_mm) - np.maximum(start, pixel)
    return np.asarray(np.clip(covered, 0, None) / cell_mm)


# A frame's displacement.
#
# A height map has the depth at the present place of the surface, the compliance at material places X. If the shear
# u(X) is known, the depth is read at X + u(X). A map whose `positions` are "undeformed" is at X already.

MIN_FAR = 50  # cells: fewer do not determine the scatter of gel at rest
SAME_SCALE = MILLI  # relative difference of mm per pixel between two maps of one sensor


@dataclass(frozen=True, slots=True)
class Observation:
    """`displacement_mm` (3 or 1, rows, columns): x, y, z or z alone; `std_mm` of each, from cell to cell; `known`
    cells; `flags`. `depth_std_mm` (rows, columns) of the depth includes errors that a whole contact shares;
    `shear_std_mm` is that of the shear in the contact, correlated over `shear_alike_mm`."""

    displacement_mm: Floats
    std_mm: Floats
    known: Bools
    flags: tuple[str, ...]
    depth_std_mm: Floats
    shear_std_mm: float = 0.0
    shear_alike_mm: float = 0.0


def observe(
    grid: NodeGrid,
    height: HeightMap,
    shear: ShearMap | None,
    *,
    inside: Bools,
    correlation_px: float,
    away_mm: float,
) -> Observation:
    """Average depth and shear (H, W), in mm, over the cells.

    Pixels share their error over `correlation_px` (infinite: over a whole contact); `away_mm` from the contact the
    gel is at rest. Raises InputError for maps of another grid or without a number.
    """
    _check(grid, height, shear)
    finite = np.isfinite(height.depth_mm) & height.valid
    depth_px = np.asarray(height.depth_mm, dtype=np.float32)
    if not finite.all():
        depth_px = np.where(finite, depth_px, np.float32(0))
    flags: list[str] = []
    if shear is not None and _share_known(shear, depth_px) < 0.5:
        flags += [*shear.flags, "shear not used: known over less than half of the view, or of its deep part"]
        shear = None
    if shear is not None and height.positions == "deformed":
        depth_px, finite = material_depth(depth_px, finite, shear=shear)
    depth, known = cell_means(grid, depth_px, valid=finite)
    known &= inside
    std, whole = _depth_std(grid, height, depth, known, correlation_px=correlation_px, away_mm=away_mm)
    if shear is None:
        return Observation(depth[None], np.array([std]), known, tuple(flags), whole)
    fields = [_bridged(grid, u, shear.valid, flags) for u in (shear.u_x_mm, shear.u_y_mm)]
    own = _shear_std(grid, shear, depth, known)
    side = mean_std(grid, own, correlation_px=shear.correlation_px)
    every = tuple(dict.fromkeys([*shear.flags, *flags]))
    alike = shear.correlation_px * float(np.mean(shear.mm_per_px))
    return Observation(np.stack([*fields, depth]), np.array([side, side, std]), known, every, whole, own, alike)


def material_depth(depth: Array, known: Bools, *, shear: ShearMap) -> tuple[Array, Bools]:
    """Return the depth (H, W), in mm, of the material that was at each pixel of the untouched frame.

    Also the mask of known ones.
    """
    rows, columns = depth.shape
    u_x, u_y = (np.asarray(u, dtype=np.float32) for u in (shear.u_x_mm, shear.u_y_mm))
    if not shear.valid.all():
        u_x, u_y = (np.where(shear.valid, u, np.float32(0)) for u in (u_x, u_y))
    map_x = u_x * np.float32(1 / shear.mm_per_px[0]) + np.arange(columns, dtype=np.float32)[None, :]
    map_y = u_y * np.float32(1 / shear.mm_per_px[1]) + np.arange(rows, dtype=np.float32)[:, None]
    moved = cv2.remap(
        np.asarray(depth, dtype=np.float32), map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    if known.all():
        return moved, known
    there = cv2.remap(known.astype(np.uint8), map_x, map_y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    return moved, there.astype(bool)


def noise_of_cells(depth: Floats, known: Bools) -> float:
    """Return the standard deviation of the cells' depths (rows, columns), in their mm, from second differences
    along rows.

    Robust to the few in contact.
    """
    step = depth[:, :-2] - 2 * depth[:, 1:-1] + depth[:, 2:]
    usable = step[known[:, :-2] & known[:, 1:-1] & known[:, 2:]]
    return float(MAD_TO_STD * np.median(np.abs(usable)) / np.sqrt(6)) if usable.size else 0.0


def unevenness(grid: NodeGrid, depth: Floats, *, known: Bools, away_mm: float) -> float:
    """Return the robust size (mm) of the depths (rows, columns) that lie `away_mm` and more from a contact.

    A contact is what is half as deep as the deepest cell. Far from it the gel hardly moves, so this is the map's
    slow error; the motion errs on the safe side. With fewer than MIN_FAR such cells the farthest quarter is taken.
    """
    distance = _from_deep(grid, depth, known)
    if distance is None:
        return 0.0
    far = depth[known][distance > away_mm]
    if far.size < MIN_FAR:
        far = depth[known][distance >= np.quantile(distance, 0.75)]
    return float(MAD_TO_STD * np.median(np.abs(far)))


def understated(grid: NodeGrid, depth: Floats, *, std_mm: Floats, known: Bools, away_mm: float) -> float:
    """Return the factor, at least 1, by which untouched gel is farther from flat than `std_mm` (rows, columns).

    Measured at the cells `away_mm` and more from what is half as deep as the deepest; 1 with fewer than MIN_FAR.
    """
    distance = _from_deep(grid, depth, known)
    if distance is None or np.count_nonzero(distance > away_mm) < MIN_FAR:
        return 1.0
    pull = np.abs(depth[known]) / np.maximum(std_mm[known], TINY)
    return max(1.0, float(MAD_TO_STD * np.median(pull[distance > away_mm])))


def _from_deep(grid: NodeGrid, depth: Floats, known: Bools) -> Floats | None:
    """Return the distance of the known cells (N,) from the cells half as deep as the deepest, mm.

    None where none is deep.
    """
    deepest = float(np.max(depth, where=known, initial=0.0))
    if deepest <= 0:
        return None
    return np.asarray(distance_transform_edt(~(known & (depth > deepest / 2)))[known] * grid.spacing_mm)


def _depth_std(
    grid: NodeGrid, height: HeightMap, depth: Floats, known: Bools, *, correlation_px: float, away_mm: float
) -> tuple[float, Floats]:
    """Return the standard deviation from cell to cell, and (rows, columns) of the depth itself.

    An error that a whole contact shares does not differ from cell to cell.
    """
    if height.std_mm is None:
        std = max(noise_of_cells(depth, known), unevenness(grid, depth, known=known, away_mm=away_mm))
        return std, np.full(grid.shape, std)
    at_cells = np.asarray(height.std_mm[_centres(grid)], dtype=np.float64)
    typical = float(np.median(at_cells[known])) if known.any() else 0.0
    at_cells = np.where(np.isfinite(at_cells), at_cells, typical)
    share = mean_std(grid, 1.0, correlation_px=correlation_px)
    if share < 1:
        return share * typical, share * at_cells
    more = understated(grid, depth, std_mm=at_cells, known=known, away_mm=away_mm)
    return noise_of_cells(depth, known), more * at_cells


def _shear_std(grid: NodeGrid, shear: ShearMap, depth: Floats, known: Bools) -> float:
    """Return the rms of the stated standard deviation where the gel is at least half as deep as the deepest.

    Far away it is smaller, and of no use.
    """
    if np.ndim(shear.std_mm) == 0:
        return float(shear.std_mm)
    at_cells = np.asarray(shear.std_mm)[_centres(grid)]
    valid = shear.valid[_centres(grid)] & known & np.isfinite(at_cells)
    deep = valid & (depth > float(np.max(depth, where=known, initial=0.0)) / 2)
    chosen = at_cells[deep if deep.any() else valid]
    return float(np.sqrt(np.mean(chosen**2))) if chosen.size else 0.0


def _centres(grid: NodeGrid) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the indices (rows, 1), (1, columns) of the pixels at the cells' middles."""
    (height, width), (sx, sy) = grid.view_px, grid.mm_per_px
    row = np.round(grid.y_mm / sy + (height - 1) / 2).astype(np.intp)
    column = np.round(grid.x_mm / sx + (width - 1) / 2).astype(np.intp)
    return row[:, None], column[None, :]


def _bridged(grid: NodeGrid, field: Array, valid: Bools, flags: list[str]) -> Floats:
    """Return cell means; a cell without shear takes that of the nearest that has it, and the map is flagged."""
    means, known = cell_means(grid, field, valid=valid)
    if known.all():
        return means
    flags.append("shear bridged where markers are lost")
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(means[tuple(nearest)])


def _share_known(shear: ShearMap, depth: Array) -> float:
    """Return the known share of the view or of its deep part, whichever is less."""
    if shear.valid.all():
        return 1.0
    top = float(depth.max())
    here = float(shear.valid[depth > top / 2].mean()) if top > 0 else 1.0
    return min(here, float(shear.valid.mean()))


def _check(grid: NodeGrid, height: HeightMap, shear: ShearMap | None) -> None:
    if any(abs(a / b - 1) > SAME_SCALE for a, b in zip(height.mm_per_px, grid.mm_per_px, strict=True)):
        raise InputError(
            "the height map has another scale than the force field was made for",
            where=height.name,
            value=(height.mm_per_px, grid.mm_per_px),
            remedy="Make a ForceField for this sensor.",
        )
    if height.depth_mm.shape != grid.view_px:
        raise InputError(
            "the height map has another size than the force field was made for",
            where=height.name,
            value=(height.depth_mm.shape, grid.view_px),
        )
    if shear is not None and shear.u_x_mm.shape != grid.view_px:
        raise InputError("shear and height map differ in size", where=height.name, value=shear.u_x_mm.shape)
