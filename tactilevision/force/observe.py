"""A frame's displacement and its noise, averaged over the cells of a grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from tactilevision.errors import InputError
from tactilevision.force.nodes import Array, NodeGrid, cell_means
from tactilevision.force.noise import (
    CellNoise,
    StatedStd,
    assumed_noise,
    from_contact,
    measured_noise,
    noise_of_cells,
    rough_noise,
    stated_noise,
)
from tactilevision.gel.surface import SurfaceCells
from tactilevision.records.constants import MILLI, TINY
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Bools, Floats

# A frame's displacement.
#
# A height map has the depth at the present place of the surface, the compliance at material places X. If the shear
# u(X) is known, the depth is read at X + u(X). A map whose `positions` are "undeformed" is at X already.

SAME_SCALE = MILLI  # relative difference of mm per pixel between two maps of one sensor


@dataclass(frozen=True)
class Observation:
    """`displacement_mm` (3 or 1, rows, columns): x, y, z or z alone; `std_mm` of each, by the difference of
    neighbours; `known` cells; `flags`; the `noise` of each component, that of depth without its correlation;
    `stated`, the deviation of depth that the map states, or None; `far` (rows, columns) from a contact."""

    displacement_mm: Floats
    std_mm: Floats
    known: Bools
    flags: tuple[str, ...]
    noise: tuple[CellNoise, ...]
    stated: StatedStd | None
    far: Bools

    @cached_property
    def depth_std_mm(self) -> Floats:
        """Return the standard deviation (rows, columns) of the depth."""
        return self.noise[-1].total


def observe(
    grid: NodeGrid,
    height: HeightMap,
    shear: ShearMap | None,
    *,
    inside: Bools,
    away_mm: float,
    surface: SurfaceCells | None = None,
) -> Observation:
    """Average depth and shear (H, W), in mm, over the cells, and measure the size of the noise of depth.

    `surface` turns the displacement to the local axes of a curved gel. `away_mm` from a contact the gel is at
    rest. The noise of shear is that which its map states. Raises InputError for maps of another grid or without a
    number.
    """
    _check(grid, height, shear)
    finite = np.isfinite(height.depth_mm) & height.valid
    depth_px = np.asarray(height.depth_mm, dtype=np.float32)
    flags: list[str] = []
    if shear is not None and _share_known(shear, depth_px, finite) < 0.5:
        flags += [*shear.flags, "shear not used: known over less than half of the view, or of its deep part"]
        shear = None
    if shear is not None and not finite.all():
        depth_px = np.where(finite, depth_px, np.float32(0))
    if shear is not None and height.positions == "deformed":
        depth_px, finite = material_depth(depth_px, finite, shear=shear)
    depth, known = cell_means(grid, depth_px, valid=finite)
    known &= inside
    fields = [] if shear is None else [_bridged(grid, u, shear.valid, flags) for u in (shear.u_x_mm, shear.u_y_mm)]
    if surface is not None:
        *fields, depth = _along(surface, fields, depth, moved=height.positions == "deformed")
    stated = _stated_std(grid, height, known)
    std = noise_of_cells(depth, known)
    pull = depth / (max(std, TINY) if stated is None else stated.total)
    far = known & (from_contact(grid, pull, known) > away_mm)
    noise = rough_noise(grid, depth, stated, far) or assumed_noise(grid, depth, stated, known)
    if shear is None:
        return Observation(depth[None], np.array([std]), known, tuple(flags), (noise,), stated, far)
    length_mm = shear.correlation_px * float(np.mean(shear.mm_per_px))
    side = stated_noise(_shear_std(grid, shear, depth, known), length_mm, grid)
    every, own = tuple(dict.fromkeys([*shear.flags, *flags])), float(side.slow[0, 0])
    fields.append(depth)
    return Observation(np.stack(fields), np.array([own, own, std]), known, every, (side, side, noise), stated, far)


def _along(surface: SurfaceCells, shear: list[Floats], depth: Floats, *, moved: bool) -> list[Floats]:
    """Return displacement along the local axes from `depth`, what the surface has moved along the camera's ray r.

    With shear v (2, rows, columns) depth is read where the material has gone, so u = (v, rise) + depth r with the
    rise z0(x + v) - z0(x) and r there. Without it only the normal part is measured, u.n = depth (r.n).
    """
    if not shear:
        return [depth * surface.local(np.broadcast_to(surface.rays(), (3, *depth.shape)))[2]]
    if not moved:
        return list(surface.local(np.stack([*shear, depth])))
    along = np.stack([*shear, surface.rise_mm(np.stack(shear))])
    return list(surface.local(along + depth * surface.rays(along)))


def with_residual(seen: Observation, left_mm: Floats, far: Bools) -> Observation:
    """Return it with the noise of what a solution leaves of the depth (rows, columns), mm, at `far` cells."""
    noise = measured_noise(seen.noise[-1].grid, left_mm, seen.stated, far)
    return seen if noise is None else replace(seen, noise=(*seen.noise[:-1], noise))


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


def _stated_std(grid: NodeGrid, height: HeightMap, known: Bools) -> StatedStd | None:
    """Return the map's own deviation at the cells' middles; None if it states none."""
    if height.std_mm is None:
        return None
    free = height.untouched_std_mm
    return StatedStd(_at_cells(grid, height.std_mm, known), None if free is None else _at_cells(grid, free, known))


def _at_cells(grid: NodeGrid, std_mm: Array, known: Bools) -> Floats:
    """Return deviations (H, W) at the cells' middles (rows, columns), mm, the median where there is none."""
    at_cells = np.asarray(std_mm[_centres(grid)], dtype=np.float64)
    finite = np.isfinite(at_cells)
    if not finite.all():
        at_cells[~finite] = np.median(at_cells[known]) if known.any() else 0.0
    return np.maximum(at_cells, TINY)


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


@lru_cache(maxsize=8)
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


def _share_known(shear: ShearMap, depth: Array, finite: Bools) -> float:
    """Return the known share of the view or of its deep part, whichever is less; of `finite` depths."""
    share = np.count_nonzero(shear.valid) / shear.valid.size
    if share in (0.0, 1.0):
        return share
    top = float(np.max(depth, where=finite, initial=0.0))
    here = float(shear.valid[finite & (depth > top / 2)].mean()) if top > 0 else 1.0
    return min(here, share)


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
