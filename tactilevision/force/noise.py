"""Noise of the cells' displacement: its size and correlation, measured on the untouched part of a map.

The error of a cell's mean has three parts, independent of each other,

    cov(i, j) = white_i^2 [i = j] + slow_i slow_j B(i - j) + shared_i shared_j,      B(0) = 1,

with B the autocorrelation exp(-r^2/L^2) averaged over two cells. The correlation length l of a field is the root
of the integral of its autocorrelation over the plane,

    l^2 = Int rho dA = pi L^2,

so that its mean over an area A, wide against l, has the variance s^2 l^2/A. White noise of pixels has l = 1 px.

Of depth, white and slow part and l are fitted to the autocovariance of untouched cells, each depth divided by the
deviation that the map states for untouched gel there. The zero of a map is known, so no mean is removed. What the
map states beyond that is shared by the contact: errors of the depth's scale (2 % of the depth, usually), of the
zero plane and of the light do not show where the gel is untouched, and are alike under one contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy import fft
from scipy.special import erf

from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Floats
from tactilevision.robust import MAD_TO_STD, median, quantile

MIN_FAR = 50  # cells: fewer do not determine the noise of gel at rest
SURE = 4.5  # deviations of a cell that is no noise, by the map's rises, which no contact makes so often
CLIP = 4.0  # deviations to which untouched depths are clipped: a weak contact is no noise
REACH = 8  # cells: longest distance of the autocovariance
LENGTHS = tuple(np.geomspace(1.0, 24.0, 14))  # cells: correlation lengths that are tried


@dataclass(frozen=True, slots=True)
class CellNoise:
    """Deviations (rows, columns), mm, of the white, slow and shared part; `length_mm` is the slow part's l."""

    grid: NodeGrid
    white: Floats
    slow: Floats
    shared: Floats
    length_mm: float

    @property
    def total(self) -> Floats:
        """Return the standard deviation (rows, columns) of each cell, mm."""
        return np.sqrt(self.white**2 + self.slow**2 + self.shared**2)

    @property
    def rings(self) -> int:
        """Return how many cells about a contact's make its sum free of what noise has selected: 2 where the noise
        of neighbours is more alike than not.
        """
        slow, whole = float((self.slow**2).sum()), float((self.white**2 + self.slow**2).sum())
        return 2 if slow * likeness(self.length_mm / self.grid.spacing_mm, 2)[1] > whole / 2 else 1

    def propagate(self, gain: Floats, cells: Cells) -> Floats:
        """Return the covariance (K, K) of `gain` (K, C) @ displacement of `cells`, in the gain's unit times mm."""
        own, slow = gain * self.white.flat[cells], gain * self.slow.flat[cells]
        whole = gain @ self.shared.flat[cells]
        found = own @ own.T + np.outer(whole, whole)
        if slow.any():
            row, column = np.divmod(cells, self.grid.shape[1])
            row, column = row - row.min(), column - column.min()
            box = np.zeros((len(gain), row.max() + 1, column.max() + 1))
            box[:, row, column] = slow
            alike = likeness(self.length_mm / self.grid.spacing_mm, max(box.shape[1:]))
            down, across = (alike[np.abs(np.subtract.outer(k, k))] for k in map(np.arange, box.shape[1:]))
            found += box.reshape(len(gain), -1) @ (down @ box @ across).reshape(len(gain), -1).T
        return np.asarray(found)


@dataclass(frozen=True, slots=True)
class StatedStd:
    """Deviations (rows, columns), mm, that a map states: in `total`, and of `untouched` gel at the same place.

    `untouched` None: not stated; then that of gel far from the contact stands for it.
    """

    total: Floats
    untouched: Floats | None = None

    @property
    def own(self) -> Floats:
        """Return the deviation of which untouched gel shows the size, up to a factor."""
        return self.total if self.untouched is None else self.untouched

    def shared(self, far: Bools) -> Floats:
        """Return the deviation that a contact shares, by the total's excess over untouched gel."""
        here = np.mean(self.total[far] ** 2) if self.untouched is None else self.untouched**2
        return np.sqrt(np.maximum(self.total**2 - here, 0.0))


def stated_noise(std_mm: float, length_mm: float, grid: NodeGrid) -> CellNoise:
    """Return the noise of cells where each pixel has `std_mm` and the correlation length `length_mm`.

    An error of infinite length is shared by all cells.
    """
    none = np.zeros(grid.shape)
    if not np.isfinite(length_mm):
        return CellNoise(grid, none, none, none + std_mm, 1.0)
    cell_mm = std_mm * float(_averaged(length_mm / grid.spacing_mm, 1)[0])
    return CellNoise(grid, none, none + cell_mm, none, length_mm)


def measured_noise(grid: NodeGrid, depth: Floats, stated: StatedStd | None, far: Bools) -> CellNoise | None:
    """Measure the noise of cells' depths (rows, columns), mm, on those `far` from a contact.

    `stated` None: alike everywhere. None with fewer than MIN_FAR such cells.
    """
    if np.count_nonzero(far) < MIN_FAR:
        return None
    scale, shared = _scales(grid, stated, far)
    pull = depth / scale
    limit = CLIP * _size(pull[far])
    white, slow, length = _fitted(np.clip(pull, -limit, limit), far)
    return CellNoise(grid, white * scale, slow * scale, shared, length * grid.spacing_mm)


def rough_noise(grid: NodeGrid, depth: Floats, stated: StatedStd | None, far: Bools) -> CellNoise | None:
    """Return noise (rows, columns) mm of the right size, of which no more is known; else as `measured_noise`."""
    if np.count_nonzero(far) < MIN_FAR:
        return None
    scale, shared = _scales(grid, stated, far)
    return CellNoise(grid, _size(depth[far] / scale[far]) * scale, np.zeros(grid.shape), shared, 1.0)


def assumed_noise(grid: NodeGrid, depth: Floats, stated: StatedStd | None, known: Bools) -> CellNoise:
    """Return the noise (rows, columns) of a map without enough untouched gel: a contact shares the stated
    deviation (mm), or else the size of the depths that are farthest from it.
    """
    none = np.zeros(grid.shape)
    if stated is not None:
        shared = stated.total
    else:
        distance = from_contact(grid, depth / max(noise_of_cells(depth, known), TINY), known)
        edge = quantile(distance[known], 0.75) if known.any() else 0.0
        shared = none + _size(depth[known & (distance >= edge)])
    return CellNoise(grid, none + noise_of_cells(depth, known), none, shared, 1.0)


def noise_of_cells(depth: Floats, known: Bools) -> float:
    """Return the standard deviation of the cells' depths (rows, columns), in their mm, from second differences
    along rows.

    Robust to the few in contact.
    """
    step = depth[:, :-2] - 2 * depth[:, 1:-1] + depth[:, 2:]
    usable = step[known[:, :-2] & known[:, 1:-1] & known[:, 2:]]
    return _size(usable) / float(np.sqrt(6))


def likeness(length: float, count: int) -> Floats:
    """Return the correlation (count,) of cells 0, 1, ... apart along an axis, from `length` in cells."""
    averaged = _averaged(float(length), count)
    return np.asarray(averaged / averaged[0])


@lru_cache(maxsize=64)
def _averaged(length: float, count: int) -> Floats:
    """Return exp(-x^2/L^2) averaged over two cells, along one axis: its second integral's second difference."""
    wide = length / np.sqrt(np.pi)
    x = np.arange(-1.0, count + 1) / wide
    twice = wide**2 / 2 * (np.sqrt(np.pi) * x * erf(x) + np.exp(-(x**2)))
    return np.asarray(np.diff(twice, 2))


def _scales(grid: NodeGrid, stated: StatedStd | None, far: Bools) -> tuple[Floats, Floats]:
    """Return the deviation (rows, columns) of untouched gel up to a factor, and the shared one, mm."""
    return (np.ones(grid.shape), np.zeros(grid.shape)) if stated is None else (stated.own, stated.shared(far))


def _size(values: Floats) -> float:
    """Return the robust size of values about zero, as a standard deviation; 0 of none."""
    return float(MAD_TO_STD * median(np.abs(values).ravel())) if values.size else 0.0


def from_contact(grid: NodeGrid, pull: Floats, known: Bools) -> Floats:
    """Return the distance (rows, columns) of each cell from those half as deep as the deepest, mm.

    `pull` is the depth over its deviation, as stated or of neighbours. Noise rises as often as it falls, so a fall
    that no rise suggests is a contact. Gel that a wide contact has displaced rises too, hence noise is no larger
    than that deviation. Infinite where none is.
    """
    if not known.any():
        return np.zeros(grid.shape)
    rise = min(-quantile(pull[known], 0.16), 1.0)
    deep = known & (pull > max(float(pull[known].max()) / 2, SURE * rise))
    if not deep.any():
        return np.full(grid.shape, np.inf)
    beside = (~deep).astype(np.uint8)
    distance = cv2.distanceTransform(beside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(grid.spacing_mm * distance, dtype=np.float64)


def _fitted(pull: Floats, far: Bools) -> tuple[float, float, float]:
    """Return the deviation of white and of slow noise, and its length in cells, of `pull` at `far` (rows,
    columns).

    The slow part is fitted to the autocovariance by distance, weighted by the number of pairs.
    """
    product, (down, across), form = _products(np.where(far, pull, 0.0)), _offsets(), _forms()
    pairs, square = _pairs(far.tobytes(), far.shape)
    covariance = product[down, across] / np.maximum(pairs, 1.0)
    size = np.maximum(form @ (pairs * covariance) / square, 0.0)
    misfit = size * (size * square - 2 * form @ (pairs * covariance))
    best = int(np.argmin(misfit))
    whole = product[0, 0] / np.count_nonzero(far)
    slow = min(float(size[best]), whole)
    return float(np.sqrt(whole - slow)), float(np.sqrt(slow)), float(LENGTHS[best])


def _products(values: Floats) -> Floats:
    """Return the sum of products of `values` (rows, columns) at every offset up to REACH, in their unit²."""
    shape = [fft.next_fast_len(n + REACH, real=True) for n in values.shape]
    spectrum = fft.rfft2(values.astype(np.float32), shape)
    return np.asarray(fft.irfft2(spectrum.real**2 + spectrum.imag**2, shape))


@lru_cache(maxsize=4)
def _pairs(far: bytes, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return the number of pairs (n,) of `far` cells at each offset, and its sum (lengths,) by correlation
    squared.
    """
    pairs = np.maximum(_products(np.frombuffer(far, dtype=bool).reshape(shape))[_offsets()], 0.0)
    return pairs, _forms() ** 2 @ pairs


@lru_cache(maxsize=1)
def _offsets() -> tuple[Cells, Cells]:
    """Return rows and columns (n,) of the offsets up to REACH, of each pair of opposite ones one."""
    row, column = np.mgrid[0 : REACH + 1, -REACH : REACH + 1]
    used = (np.hypot(row, column) <= REACH) & ((row > 0) | (column > 0))
    return row[used], column[used]


@lru_cache(maxsize=1)
def _forms() -> Floats:
    """Return the correlation (lengths, n) at these offsets."""
    down, across = (np.abs(part) for part in _offsets())
    return np.stack([(one := likeness(length, REACH + 1))[down] * one[across] for length in LENGTHS])
