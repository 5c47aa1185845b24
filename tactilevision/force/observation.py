"""Average a frame's displacement over the cells, and bound the force beyond the known area."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_fill_holes, distance_transform_edt

from tactilevision.errors import InputError
from tactilevision.force.inverse import TINY, Solution, at_border
from tactilevision.force.nodes import Array, NodeGrid, cell_means, mean_std
from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Bools, Floats
from tactilevision.robust import MAD_TO_STD

# A height map has the depth at the present place of the surface, the compliance at material places X. If the shear
# u(X) is known, the depth is read at X + u(X). A map whose `positions` are "undeformed" is at X already.

MIN_FAR = 50  # cells: fewer do not determine the scatter of gel at rest
SAME_SCALE = 1e-3  # relative difference of mm per pixel between two maps of one sensor


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


@dataclass(frozen=True, slots=True)
class PixelNoise:
    """Noise of a height map: `std_mm` of a pixel (None: from the map), correlated over `correlation_px` (infinite:
    over a whole contact); `away_mm` from the contact the gel is at rest."""

    std_mm: float | None
    correlation_px: float
    away_mm: float


def observe(
    grid: NodeGrid, height: HeightMap, *, shear: ShearMap | None, noise: PixelNoise, inside: Bools
) -> Observation:
    """Average depth and shear (H, W), in mm, over the cells.

    Raises InputError for maps of another grid or without a number.
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
    std, whole = _depth_std(grid, height, noise, depth, known)
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
    grid: NodeGrid, height: HeightMap, noise: PixelNoise, depth: Floats, known: Bools
) -> tuple[float, Floats]:
    """Return the standard deviation from cell to cell, and (rows, columns) of the depth itself.

    An error that a whole contact shares does not differ from cell to cell.
    """
    stated: Array | None = height.std_mm
    if stated is None and noise.std_mm is not None:
        stated = np.broadcast_to(np.float64(noise.std_mm), height.depth_mm.shape)
    if stated is None:
        std = max(noise_of_cells(depth, known), unevenness(grid, depth, known=known, away_mm=noise.away_mm))
        return std, np.full(grid.shape, std)
    at_cells = np.asarray(stated[_centres(grid)], dtype=np.float64)
    typical = float(np.median(at_cells[known])) if known.any() else 0.0
    at_cells = np.where(np.isfinite(at_cells), at_cells, typical)
    share = mean_std(grid, 1.0, correlation_px=noise.correlation_px)
    if share < 1:
        return share * typical, share * at_cells
    return noise_of_cells(depth, known), at_cells * understated(
        grid, depth, std_mm=at_cells, known=known, away_mm=noise.away_mm
    )


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
    """Return cell means.

    A cell without shear takes that of the nearest cell that has it, and the map is flagged.
    """
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


def is_cut(grid: NodeGrid, found: Solution, seen: Observation) -> bool:
    """Return whether pressure reaches the border: the sum over its cells is significant.

    Its deviation includes errors that the whole contact shares, and those of each cell.
    """
    edge = at_border(found.cells, binary_fill_holes(seen.known))
    if not edge.any():
        return False
    weights = np.zeros((1, found.traction.size))
    weights[0, -len(found.cells) :] = edge
    shared = float(found.shift(weights, seen.depth_std_mm.ravel()[found.cells])[0])
    own = float(found.propagate(weights, np.repeat(seen.std_mm, len(found.cells)))[0, 0])
    return float(found.traction[-1][edge].sum()) > CONTACT.cell_sigma * float(np.hypot(shared, np.sqrt(own)))


def force_beyond(grid: NodeGrid, found: Solution, seen: Observation, *, scale: Floats, cut: bool) -> Floats:
    """Return the squared force (3,), N², that may lie where nothing is known.

    Beyond a border that cuts the contact: its cells' traction continued for half the contact's width. In a hole of
    the map: the mean traction around it, over the hole's area at most.
    """
    whole = np.asarray(binary_fill_holes(seen.known))
    outer = at_border(found.cells, whole)
    inner = at_border(found.cells, seen.known) & ~outer
    half_width = np.sqrt(len(found.cells) / np.pi)
    traction, square = found.traction * scale, np.zeros(len(found.traction))
    if cut:
        square += (grid.cell_mm2 * traction[:, outer].sum(axis=1) * half_width) ** 2
    if inner.any():
        missing = min(np.count_nonzero(whole & ~seen.known), half_width * np.count_nonzero(inner))
        square += (grid.cell_mm2 * traction[:, inner].mean(axis=1) * missing) ** 2
    return np.concatenate([np.zeros(3 - len(square)), square])
