"""Slope from a table of colour changes.

The table has CELLS^3 entries over the observed range of changes. Each holds the mean slope of the n ball samples
in its cell, shrunk towards a cubic polynomial of the change fitted to all samples:

    table = (n mean + PRIOR cubic) / (n + PRIOR)

It is read at the nearest entry of a table twice as fine, linear in between. One table serves the whole picture:
fast, but less accurate than the polynomial, as the direction of the light is taken to be the same everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.colour_change import Window
from tactilevision.photometric.protocols import Evaluator, Stored
from tactilevision.records.measured import Floats, Picture

CELLS = 48  # entries along each colour
FINE = 2 * CELLS - 1  # entries along each colour of the table that is read; at most 256, for byte indices
PRIOR = 4  # weight of the cubic in each cell, in samples


@dataclass(frozen=True)
class Lookup(Stored):
    """`table` (CELLS, CELLS, CELLS, 2) over changes from `lowest` (3,) to `highest` (3,)."""

    table: Picture
    lowest: Floats
    highest: Floats

    name = "lookup"

    def at(self, change: Floats, place: Floats) -> Floats:
        """Return slopes (N, 2) for changes (N, 3); `place` is ignored."""
        i, j, k = np.clip(np.rint((change - self.lowest) * self.per), 0, FINE - 1).astype(np.intp).T
        return np.asarray(self.fine[i, j, k], np.float64)

    @property
    def per(self) -> Floats:
        """Fine entries (3,) per unit of change."""
        return (FINE - 1) / (self.highest - self.lowest)

    @cached_property
    def fine(self) -> Picture:
        """The table (FINE, FINE, FINE, 2) that is read: linear between entries, 0 for no change."""
        fine = self.table.astype(np.float32)
        for axis in range(3):
            fine = np.repeat(fine, 2, axis=axis)
            fine = 0.5 * (np.delete(fine, 0, axis=axis) + np.delete(fine, -1, axis=axis))
        return np.ascontiguousarray(fine - fine[_entry_of_zero(self)])

    def averaged(self, noise: Floats) -> Lookup:
        """Return the table of mean slopes for colours with `noise` (3,)."""
        from scipy.ndimage import gaussian_filter

        table = gaussian_filter(self.table, (*(0.5 * noise * self.per), 0.0), mode="nearest")
        return Lookup(table, self.lowest, self.highest)

    def evaluator(self, shape: tuple[int, int]) -> LookupEvaluator:
        return LookupEvaluator(self, shape)


def fit_lookup(contact: Samples, untouched_samples: Samples, *, ridge: float) -> Lookup:
    """Fit a table to samples; `ridge` is the penalty of the cubic, relative to the power of its terms."""
    changes = np.concatenate([contact.change, untouched_samples.change])
    slopes = np.concatenate([contact.slopes, untouched_samples.slopes])
    lowest, highest = np.percentile(changes, 0.1, axis=0), np.percentile(changes, 99.9, axis=0)
    margin = 0.1 * (highest - lowest)
    lowest, highest = lowest - margin, highest + margin
    terms = _cubic(changes)
    scale = np.sqrt(np.mean(terms**2, axis=0))
    normal = (terms / scale).T @ (terms / scale) / len(terms) + ridge * 1e-2 * np.eye(terms.shape[1])
    weights = np.linalg.solve(normal, (terms / scale).T @ slopes / len(terms)) / scale[:, None]
    axes = np.linspace(lowest, highest, CELLS).T
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    steepest = 1.5 * np.abs(slopes).max()
    cells = np.clip((changes - lowest) / (highest - lowest) * (CELLS - 1) + 0.5, 0, CELLS - 1).astype(np.intp)
    flat = np.ravel_multi_index(tuple(cells.T), (CELLS,) * 3)
    count = np.bincount(flat, minlength=CELLS**3)[:, None]
    residual = slopes - terms @ weights
    extra = np.stack([np.bincount(flat, residual[:, s], CELLS**3) for s in (0, 1)], axis=1) / (count + PRIOR)
    table = np.clip(_cubic(grid) @ weights + extra, -steepest, steepest)
    return Lookup(table.reshape(CELLS, CELLS, CELLS, 2).astype(np.float32), lowest, highest)


class LookupEvaluator(Evaluator):
    """The table over a whole picture, both slopes of an entry as the parts of one complex number."""

    def __init__(self, lookup: Lookup, shape: tuple[int, int]) -> None:
        self.slopes = lookup.fine.view(np.complex64).ravel()
        self.per, self.shift = lookup.per, -lookup.lowest * lookup.per
        self.lookup = lookup

    def strip(self, change: Picture, window: Window, out: Picture) -> None:
        """Write slopes (2, h, w) of the changes (3, h, w) of a window, one of `strips`, to `out`."""
        slopes = self.slopes.take(self._entries(change), mode="clip")
        out[0], out[1] = slopes.real, slopes.imag

    def _entries(self, change: Picture) -> npt.NDArray[np.intp]:
        """Return the entries (h, w) for changes (3, h, w); float32 is exact up to FINE^3."""
        cells = np.empty(change.shape, np.uint8)
        for channel, cell, per, shift in zip(change, cells, self.per, self.shift, strict=True):
            # rounded and clipped to 0 to 255
            cv2.addWeighted(channel, float(per), channel, 0.0, float(shift), dst=cell, dtype=cv2.CV_8U)
        np.minimum(cells, FINE - 1, out=cells)
        red, green, blue = cells.astype(np.float32)
        red *= FINE
        red += green
        red *= FINE
        red += blue
        return np.asarray(red, np.intp)

    def noise(self, noise: Picture) -> Picture:
        """Return the standard deviation (H, W) of a slope on untouched gel from that of the changes (3, H, W)."""
        entry, table = _entry_of_zero(self.lookup), self.lookup.fine
        rates = []
        for axis in range(3):
            above, below = (tuple(n + step * (c == axis) for c, n in enumerate(entry)) for step in (2, -2))
            rates.append((table[above] - table[below]) * np.float32(self.per[axis] / 4))
        squares = np.square(np.stack(rates))
        return np.asarray(np.sqrt(np.einsum("cs,chw->hw", squares, noise**2) / 2.0), dtype=np.float32)


def _entry_of_zero(lookup: Lookup) -> tuple[int, int, int]:
    i, j, k = np.clip(np.rint(-lookup.lowest * lookup.per).astype(int), 2, FINE - 3)
    return int(i), int(j), int(k)


def _cubic(change: Floats) -> Floats:
    picks = [pick for order in (1, 2, 3) for pick in combinations_with_replacement(range(3), order)]
    return np.stack([np.prod(change[:, pick], axis=1) for pick in picks], axis=1)
