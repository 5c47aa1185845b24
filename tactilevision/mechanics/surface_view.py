"""Reduce a measured surface around a flat punch to block means with correlated noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Floats, Pair

if TYPE_CHECKING:
    from scipy.sparse import csr_array


# A height map has far more pixels than independent readings: its noise is correlated over a millimetre. Its pixels
# are averaged in square blocks, the face and the gel outside it separately; a guard band at the punch's edge, with
# blur and steep slopes, is excluded. The block means of a radial profile D(r) are a matrix times D on a radial
# grid, exact for every pixel's radius.

GRID_STEPS = 60  # radial grid points to one punch radius
FULL_SHARE = 0.25  # least share of valid pixels in a block


@dataclass(frozen=True, slots=True)
class SurfaceView:
    """A height map of the gel under one press.

    `depth_mm` (H, W), positive into the gel; `valid` (H, W) is False where the depth is unknown or not the gel's:
    outside the gel, in shadow, under the bevel. `centre_mm` (x, y) of the punch on the pad, whose (0, 0) is the
    centre of the frame. `certified_depth_mm` is a depth known by other means (the bevel), else NaN.
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
    """Average a view in blocks of `block_mm`: the face within a - guard, the gel from a + guard to
    `reach_mm`.

    Raises InputError if the map and the mask differ in shape, or a scale or the radius is not above 0.
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
    count, step = count[good], view.radius_mm / GRID_STEPS
    grid = step * np.arange(int(reach_mm / step) + 2, dtype=float)
    shape = (len(count), len(grid))
    safe = np.maximum(r, TINY)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(label, values, len(count)) / count)

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
    """Return each pixel's block number, and how many pixels each block has; blocks are centred on the axis."""
    column, row = (np.rint(part / block_mm).astype(int) for part in (x, y))
    width = 2 * int(np.abs(column).max(initial=0)) + 1
    _, label, count = np.unique(2 * (row * width + column) + face, return_inverse=True, return_counts=True)
    return label, count


def _radial(label: npt.NDArray[np.intp], at: Floats, weight: Floats, shape: tuple[int, int]) -> csr_array:
    """Interpolate linearly on the radial grid at position `at` (in steps), summed with weights into blocks."""
    from scipy.sparse import csr_array

    low = np.minimum(at.astype(int), shape[1] - 2)
    part = at - low
    values = np.concatenate([weight * (1 - part), weight * part])
    return csr_array((values, (np.tile(label, 2), np.concatenate([low, low + 1]))), shape=shape)


def _check(view: SurfaceView) -> None:
    where = view.name or "SurfaceView"
    if view.depth_mm.ndim != 2 or view.depth_mm.shape != view.valid.shape:
        raise InputError(
            "depth_mm and valid have one shape (H, W)", where=where, value=(view.depth_mm.shape, view.valid.shape)
        )
    if not min(*view.mm_per_px, view.radius_mm) > 0:
        raise InputError(
            "the scale and the punch radius lie above 0", where=where, value=(view.mm_per_px, view.radius_mm)
        )


# Noise of block means, correlated between blocks, estimated from the residuals of a fit.
#
#     cov(i, j) = s^2 (1 + sqrt(3) d/L) exp(-sqrt(3) d/L) + white^2/share_i [i = j],     d the blocks' distance.
#
# Matern's form of order 3/2: smooth enough for integrated slopes, and never singular. s, L and white follow from
# the residuals' mean product at each distance, corrected for the degrees of freedom.
#
# Source: Matern, Spatial Variation (1960); Cressie, Statistics for Spatial Data (1993), section 2.4.

START_STD_MM = 0.005  # of the first fit; only the weight of weak priors depends on it
LONGEST = 8  # largest lag, in blocks
FLOOR_SHARE = 0.02  # least white share of the variance, which keeps the matrix well conditioned
LINEAR_UNKNOWNS = 12  # columns of the linear part of the fit


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """`std_mm` and `length_mm` of the correlated part, `white_mm` of the white part of a full block."""

    std_mm: float
    length_mm: float
    white_mm: float

    def covariance(self, blocks: Blocks) -> Floats:
        """Return the covariance (n, n), mm^2."""
        smooth = self.std_mm**2 * matern(_distances(blocks) / self.length_mm)
        return np.asarray(smooth + np.diag(self.white_mm**2 / blocks.share))


WHITE = NoiseModel(0.0, 1.0, START_STD_MM)


def matern(distance: Floats) -> Floats:
    """Return the correlation, -1 to 1, at a distance of any shape in parts of the length: dimensionless."""
    reach = np.sqrt(3) * distance
    return np.asarray((1 + reach) * np.exp(-reach))


def estimate_noise(blocks: Sequence[Blocks], misfits: Sequence[Floats], *, block_mm: float) -> NoiseModel:
    """Estimate the noise of all presses together from their misfits (n,) each, in mm.

    Blocks are `block_mm` apart.
    """
    edges = (np.arange(LONGEST + 1) + 0.5) * block_mm
    total, pairs, variance, count = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1), 0.0, 0.0
    distance_sum = np.zeros(len(edges) - 1)
    for part, misfit in zip(blocks, misfits, strict=True):
        weighted = misfit * np.sqrt(len(misfit) / max(len(misfit) - LINEAR_UNKNOWNS, 1))
        distance = _distances(part)
        upper = np.triu_indices(len(misfit), 1)
        lag = np.digitize(distance[upper], edges) - 1
        near = (lag >= 0) & (lag < len(total)) & (part.face[upper[0]] == part.face[upper[1]])
        product = np.outer(weighted, weighted)[upper][near]
        total += np.bincount(lag[near], product, len(total))
        pairs += np.bincount(lag[near], minlength=len(total))
        distance_sum += np.bincount(lag[near], distance[upper][near], len(total))
        variance += float(weighted @ weighted)
        count += len(weighted)
    seen = pairs > 0
    return _match(variance / count, total[seen] / pairs[seen], distance_sum[seen] / pairs[seen], pairs[seen])


def _match(variance: float, products: Floats, lags: Floats, pairs: Floats) -> NoiseModel:
    """Fit s^2 rho(lag/L) to the mean products by least squares, over a range of L; the rest at lag 0 is white."""
    best = (np.inf, 0.0, 1.0)
    for length in np.geomspace(lags.min(initial=1.0) / 2, lags.max(initial=1.0), 40):
        shape = matern(lags / length)
        power = float(np.clip(np.sum(pairs * shape * products) / np.sum(pairs * shape**2), 0, variance))
        cost = float(np.sum(pairs * (products - power * shape) ** 2))
        best = min(best, (cost, power, float(length)))
    _, power, length = best
    power = min(power, (1 - FLOOR_SHARE) * variance)
    return NoiseModel(float(np.sqrt(power)), length, float(np.sqrt(variance - power)))


def _distances(blocks: Blocks) -> Floats:
    return np.asarray(np.hypot(*(np.subtract.outer(place, place) for place in (blocks.x_mm, blocks.y_mm))))
