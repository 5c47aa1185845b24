"""One measured surface round a flat punch, reduced to block means that keep all that a smooth profile can show.

A height map has far more pixels than independent readings: its noise is correlated over a millimetre. Its pixels
are averaged in square blocks, the face and the gel beside it apart; a guard band at the punch's edge, where blur
and steep slopes spoil the map, is left out. What a radial profile D(r) predicts for the block means is a matrix
times D on a radial grid, exact for every pixel's own radius, so that a fit never has to visit pixels again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records import Bools, Floats, Pair

if TYPE_CHECKING:
    from scipy.sparse import csr_array

GRID_STEPS = 60  # radial grid points to one punch radius
FULL_SHARE = 0.25  # a block counts where at least this share of its pixels is valid


@dataclass(frozen=True, slots=True)
class SurfaceView:
    """A height map of the gel under one press.

    `depth_mm` (H, W), positive into the gel; `valid` (H, W) is False where the depth is not known or not the gel's
    alone: outside the gel, in shadow, under the bevel. `centre_mm` (x, y) of the punch on the pad, whose (0, 0) is
    the centre of the frame. `certified_depth_mm` is a depth known by other means (the bevel), NaN where there is
    none.
    """

    depth_mm: npt.NDArray[np.floating[Any]]
    valid: Bools
    mm_per_px: Pair
    radius_mm: float
    centre_mm: Pair = (0.0, 0.0)
    centre_std_mm: float = 0.05
    certified_depth_mm: float = float("nan")
    certified_depth_std_mm: float = 0.01
    name: str = ""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Block means of one view. n blocks, m radial grid points.

    `depth_mm` (n,); `x_mm`, `y_mm` (n,) of their middles from the punch's axis; `face` (n,) True under the punch;
    `share` (n,) of a full block's pixels; `r_mm` (m,) the radial grid; `mean` (n, m): what a profile on the grid
    gives for each block; `mean_x`, `mean_y` (n, m): the same weighted with the direction cosines, so that a shift
    of the centre by (sx, sy) changes the block means by -(mean_x D' sx + mean_y D' sy).
    """

    view: SurfaceView
    depth_mm: Floats
    x_mm: Floats
    y_mm: Floats
    face: Bools
    share: Floats
    r_mm: Floats
    mean: csr_array
    mean_x: csr_array
    mean_y: csr_array


def reduce_view(view: SurfaceView, *, block_mm: float, guard_mm: float, reach_mm: float) -> Blocks:
    """Average a view in blocks of `block_mm`: the face within a - guard, the gel from a + guard to `reach_mm`.

    Raises InputError where the map and the mask differ in shape, or a scale or the radius is not above 0.
    """
    _check(view)
    rows, columns = np.nonzero(view.valid & np.isfinite(view.depth_mm))
    height, width = view.depth_mm.shape
    x = (columns - (width - 1) / 2) * view.mm_per_px[0] - view.centre_mm[0]
    y = (rows - (height - 1) / 2) * view.mm_per_px[1] - view.centre_mm[1]
    r = np.hypot(x, y)
    face = r < view.radius_mm - guard_mm
    kept = face | ((r > view.radius_mm + guard_mm) & (r < reach_mm))
    rows, columns, x, y, r, face = (part[kept] for part in (rows, columns, x, y, r, face))
    label, count = _labels(x, y, face, block_mm)
    full = block_mm**2 / (view.mm_per_px[0] * view.mm_per_px[1])
    good = count >= FULL_SHARE * min(full, count.max(initial=1))
    inside = good[label]
    label = (np.cumsum(good) - 1)[label[inside]]
    x, y, r, face = (part[inside] for part in (x, y, r, face))
    depth = view.depth_mm[rows[inside], columns[inside]].astype(float)
    return _blocks(view, label, count[good], (x, y, r, face), (depth, reach_mm, full))


def _blocks(
    view: SurfaceView,
    label: npt.NDArray[np.intp],
    count: npt.NDArray[np.intp],
    place: tuple[Floats, Floats, Floats, Bools],
    reading: tuple[Floats, float, float],
) -> Blocks:
    x, y, r, face = place
    depth, reach_mm, full = reading
    step = view.radius_mm / GRID_STEPS
    grid = step * np.arange(int(reach_mm / step) + 2, dtype=float)
    shape = (len(count), len(grid))
    safe = np.maximum(r, 1e-9)

    def mean(values: Floats) -> Floats:
        return np.bincount(label, values, len(count)) / count

    return Blocks(
        view,
        mean(depth),
        mean(x),
        mean(y),
        mean(face.astype(float)) > 0.5,
        count / full,
        grid,
        _radial(label, r / step, 1 / count[label], shape),
        _radial(label, r / step, x / safe / count[label], shape),
        _radial(label, r / step, y / safe / count[label], shape),
    )


def _labels(
    x: Floats, y: Floats, face: Bools, block_mm: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Number of each pixel's block, and how many pixels each block has; blocks are centred on the axis."""
    column, row = (np.rint(part / block_mm).astype(int) for part in (x, y))
    width = 2 * int(np.abs(column).max(initial=0)) + 1
    _, label, count = np.unique(2 * (row * width + column) + face, return_inverse=True, return_counts=True)
    return label, count


def _radial(label: npt.NDArray[np.intp], at: Floats, weight: Floats, shape: tuple[int, int]) -> csr_array:
    """Linear interpolation on the radial grid at position `at` (in steps), summed with weights into blocks."""
    from scipy.sparse import csr_array

    low = np.minimum(at.astype(int), shape[1] - 2)
    part = at - low
    values = np.concatenate([weight * (1 - part), weight * part])
    return csr_array((values, (np.tile(label, 2), np.concatenate([low, low + 1]))), shape=shape)


def _check(view: SurfaceView) -> None:
    where = view.name or "SurfaceView"
    if view.depth_mm.ndim != 2 or view.depth_mm.shape != view.valid.shape:
        raise InputError(
            "depth_mm and valid are (H, W) alike", where=where, value=(view.depth_mm.shape, view.valid.shape)
        )
    if not min(*view.mm_per_px, view.radius_mm) > 0:
        raise InputError(
            "the scale and the punch radius lie above 0", where=where, value=(view.mm_per_px, view.radius_mm)
        )
