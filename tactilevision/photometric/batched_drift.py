"""Estimate the drift of the light in many frames at once, in torch, by the formulas of `drift.py`.

Every step works on a batch (B, ...); a frame whose iteration has converged keeps its values. No step depends on
the numbers or copies any to a device, so that it needs no synchronisation and may be recorded.
"""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tactilevision.photometric import drift as one
from tactilevision.photometric.drift import Drift, DriftTracker

FAR = 1e8  # blocks squared: farther than any block
SWAPPED_MARGIN = 1.2  # of `MAX_SWAPPED_SHARE`: the frame's own check decides


Batched = Any  # a tensor (B, ...), or its array on the processor


class Drifts(NamedTuple):
    """Drift of B frames: the fields of `drift.Drift`, stacked.

    `mixed` (B,): the light is corrected by `undo`; `drifted` (B,): `covariance` counts. `odd` (B,): frames to be
    read one by one, which may not be of this sensor.
    """

    gains: Batched
    untouched: Batched
    normalised_residual: Batched
    undo: Batched
    covariance: Batched
    misfit: Batched
    left: Batched
    means: Batched
    mixed: Batched
    drifted: Batched
    odd: Batched

    def of(self, k: int) -> Drift:
        """Return the drift of the frame k, of arrays."""
        found = Drift(*(part[k] for part in self[:8]))
        return replace(
            found,
            normalised_residual=found.normalised_residual.copy(),  # kept with the map
            undo=found.undo if self.mixed[k] else None,
            covariance=found.covariance if self.drifted[k] else None,
            misfit=float(found.misfit),
        )


class BatchedDrift(DriftTracker):
    """Measure the drift of frames against the reference of a `tracker`, on a torch `device`."""

    records = True

    def __init__(self, tracker: DriftTracker, device: str) -> None:
        self.__dict__ |= on_device(tracker.__dict__, device)

    def measure_all(self, tiles: Tensor) -> Drifts:
        """Return the drift of frames in means (B, 3, h, w) of the tracker's pixels."""
        blocks = self._blocks(tiles)
        if self.dark is not None:
            blocks[:, self.dark] = self.level[self.dark]
        change = blocks - self.level
        odd = self._odd(blocks, change)
        gains = functional.pad(self._medians(change / self.bright)[..., None], (0, 2))
        change = change / self.noise
        weighted, live = change * self.shown, torch.ones_like(gains[:, 0, 0], dtype=torch.bool)
        kept: list[Tensor] = []
        for _ in range(one.MAX_ITERATIONS):
            state = list(self._reweighted(change, weighted, gains))
            moved = (state[0] - gains).abs().amax((1, 2)) >= one.CONVERGENCE_TOL
            kept = [chosen(live, *pair) for pair in zip(state, kept or state, strict=True)]
            live, gains = live & moved, kept[0]
        _, weights, touched, limit = kept
        drifted = gains[:, :, 0].abs().amax(1) > one.MIN_DRIFT
        if self.power == 2:
            change = chosen(drifted, change * (1.0 + self.bend * change), change)
        drift, covariance = self._separated(change, weights, gains[:, :, 0], touched)
        drift = chosen(drifted, drift, functional.pad(gains, (0, one.TERMS - 3)))
        level_gains, undo, mixed = self._inverse(drift)
        left = self._left(change, drift)
        squares, shape = left.square().sum(1), (-1, self.size[1], self.size[0])
        untouched = (self.usable & (squares < limit)).reshape(shape)
        gains, mixed = chosen(drifted, level_gains, gains), mixed & drifted
        undo = chosen(mixed, undo, torch.eye(3, 4, dtype=undo.dtype, device=undo.device))
        misfit, residual = self._medians(squares).sqrt(), squares.sqrt().reshape(shape)
        return Drifts(gains, untouched, residual, undo, covariance, misfit, left, tiles, mixed, drifted, odd)

    def _odd(self, blocks: Tensor, change: Tensor) -> Batched:
        """Return which frames (B,) `DriftTracker.measure` may reject."""
        blocks, change, level = map(self._among_usable, (blocks, change, self.level))
        size, swapped = ((off.abs().flatten(1).median(1).values) for off in (change, blocks.flip(1) - level))
        dark = (blocks.mean(2) < 0.1 * self.grey).any(1)
        bright = (blocks.amax((1, 2)) > 252) & (self.mean_grey < 232)
        other = (size > self.clear_grey) & (swapped < SWAPPED_MARGIN * one.MAX_SWAPPED_SHARE * size)
        return dark | bright | other | (size > 0.5 * self.mean_grey)


# Steps on batches: masks (B, h, w), and small matrices.


def on_device(values: Any, device: str) -> Any:
    """Return nested dictionaries and tuples with every array as a tensor on a device."""
    if isinstance(values, np.ndarray):
        return torch.as_tensor(values.copy(), device=device)
    if isinstance(values, dict):
        return {name: on_device(value, device) for name, value in values.items()}
    if isinstance(values, tuple) and hasattr(values, "_fields"):
        return type(values)(*(on_device(value, device) for value in values))
    return values


def chosen(which: Tensor, values: Tensor, others: Tensor) -> Tensor:
    """Return `values` of the frames `which` (B,), `others` of the rest, (B, ...) each."""
    return torch.where(which.reshape(-1, *[1] * (values.dim() - 1)), values, others)


def grown(mask: Tensor, size: int, before: int) -> Tensor:
    """Return a mask (B, h, w) dilated by a square of `size`, `before` of it left of and above the anchor."""
    padded = functional.pad(mask, (before, size - 1 - before) * 2)
    for axis, count in ((1, mask.shape[1]), (2, mask.shape[2])):
        parts = [padded.narrow(axis, start, count) for start in range(size)]
        padded = reduce(torch.logical_or, parts)
    return padded


def shrunk(mask: Tensor, size: int, before: int, *, outside: bool) -> Tensor:
    """Return a mask (B, h, w) eroded by a square as in `grown`; `outside` is what lies beyond the border."""
    after = size - 1 - before
    beyond = functional.pad(~mask, (before, after) * 2, value=not outside)
    return ~grown(beyond, size, before)[:, before : before + mask.shape[1], before : before + mask.shape[2]]


@one.solid.register
def _(touched: Tensor) -> Tensor:
    return grown(shrunk(touched, 2, 1, outside=False), 2, 0)


@one.near_contact.register
def _(touched: Tensor) -> Tensor:
    return grown(shrunk(touched, 2, 1, outside=True), 8, 3)


@one.distance_px.register
def _(inside: Tensor) -> Tensor:
    rows, columns = (torch.arange(n, device=inside.device, dtype=torch.float32) for n in inside.shape[1:])
    square = (FAR * inside)[..., None] + (columns[:, None] - columns).square()
    return (square.amin(2)[:, :, None] + (rows[:, None] - rows).square()[..., None]).amin(1).sqrt()


@one.inverse.register
def _(matrix: Tensor, *, log: bool = False) -> tuple[Tensor, Tensor]:
    """Return inverses and log determinants by Gauss-Jordan elimination, n steps on the whole batch."""
    matrix, total = matrix.clone(), torch.zeros_like(matrix[..., 0, 0])
    for k in range(matrix.shape[-1]):
        pivot = matrix[..., k, k].clone()
        total = total + pivot.abs().log()
        row, column = matrix[..., k, :] / pivot[..., None], matrix[..., k].clone()
        matrix = matrix - column[..., None] * row[..., None, :]
        matrix[..., k, :], matrix[..., k] = row, -column / pivot[..., None]
        matrix[..., k, k] = 1.0 / pivot
    return matrix, total
