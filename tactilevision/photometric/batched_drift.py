"""Estimate the drift of the light in many frames at once, in torch: the equations of `drift.py`.

Every step works on a batch (B, ...); a frame whose iteration has converged keeps its values. On a device no step
depends on the numbers or copies any there, so that it needs no synchronisation and may record them. The processor
omits steps that no frame of the batch needs.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tactilevision.photometric import drift as one
from tactilevision.photometric.drift import Drift, DriftTracker
from tactilevision.records.constants import TINY
from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.robust import MAD_TO_STD

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
    mixed: Batched
    covariance: Batched
    drifted: Batched
    misfit: Batched
    left: Batched
    means: Batched
    odd: Batched

    def of(self, k: int) -> Drift:
        """Return the drift of the frame k, of arrays."""
        return Drift(
            self.gains[k],
            self.untouched[k],
            self.normalised_residual[k].copy(),  # kept with the map
            self.undo[k] if self.mixed[k] else None,
            self.covariance[k] if self.drifted[k] else None,
            float(self.misfit[k]),
            self.left[k],
            self.means[k],
        )


class BatchedDrift:
    """Measure the drift of frames against the reference of a `tracker`, on a torch `device`."""

    def __init__(self, tracker: DriftTracker, device: str) -> None:
        def on(values: Any) -> Tensor:
            return torch.as_tensor(np.array(values), device=device)

        self.tracker, self.shape, self.power = tracker, (tracker.size[1], tracker.size[0]), tracker.power
        self.down, self.across = on(tracker.down), on(tracker.across)
        self.level, self.noise, self.bright = on(tracker.level), on(tracker.noise), on(tracker.bright)
        self.shown, self.bend, self.terms = on(tracker.shown), on(tracker.bend), on(tracker.terms)
        self.basis, self.normal, self.light = on(tracker.basis), on(tracker.normal), on(tracker.light)
        self.slope_effects, self.grey = on(tracker.slope_effects), on(tracker.grey)
        self.usable, self.kinds = on(tracker.usable), on(one.DRIFT_KINDS)
        self.log_weights, self.others = on(np.log(one.PRIOR_WEIGHTS)), on(np.array(one.OTHERS))
        self.counted: Any = slice(None) if tracker.all_usable else on(np.flatnonzero(tracker.usable))
        self.squares = (self.terms[:, :, None] * self.terms[:, None]).flatten(0, 2).T.contiguous()
        self.recorded = device != "cpu"

    def measure(self, tiles: Tensor) -> Drifts:
        """Return the drift of frames in means (B, 3, h, w) of the tracker's pixels."""
        blocks = ((self.down @ tiles) @ self.across).double().flatten(2)
        if self.tracker.dark is not None:
            blocks[:, self.tracker.dark] = self.level[self.tracker.dark]
        change = blocks - self.level
        odd = self._odd(blocks, change)
        constant = self._medians(change / self.bright)
        change = change / self.noise
        gains, weights, touched, limit = self._reweighted(change, constant)
        drifted = gains[:, :, 0].abs().amax(1) > one.MIN_DRIFT
        all_terms = functional.pad(gains, (0, one.TERMS - 3))
        if self.power == 2:
            change = torch.where(drifted[:, None, None], change * (1.0 + self.bend * change), change)
        drift, which = all_terms.clone(), slice(None) if self.recorded else drifted
        covariance = drift.new_zeros((len(drift), 3 * one.TERMS, 3 * one.TERMS))
        if self.recorded or drifted.any():
            parts = (part[which] for part in (change, weights, gains[:, :, 0], touched))
            drift[which], covariance[which] = self._separated(*parts)
        drift = torch.where(drifted[:, None, None], drift, all_terms)
        level_gains, undo, mixed = self._inverse(drift)
        left = self._left(change, drift)
        squares = left.square().sum(1)
        return Drifts(
            torch.where(drifted[:, None, None], level_gains, gains),
            (self.usable & (squares < limit)).reshape(-1, *self.shape),
            squares.sqrt().reshape(-1, *self.shape),
            undo,
            mixed & drifted,
            covariance,
            drifted,
            self._medians(squares).sqrt(),
            left,
            tiles,
            odd,
        )

    def _odd(self, blocks: Tensor, change: Tensor) -> Tensor:
        """Return which frames (B,) `DriftTracker.measure` may reject."""
        tracker, size = self.tracker, change[..., self.counted].abs().flatten(1).median(1).values
        blocks = blocks[..., self.counted]
        swapped = (blocks.flip(1) - self.level[:, self.counted]).abs().flatten(1).median(1).values
        dark = (blocks.mean(2) < 0.1 * self.grey).any(1)
        bright = (blocks.amax((1, 2)) > 252) & (tracker.mean_grey < 232)
        other = (size > tracker.clear_grey) & (swapped < SWAPPED_MARGIN * one.MAX_SWAPPED_SHARE * size)
        return dark | bright | other | (size > 0.5 * tracker.mean_grey)

    def _reweighted(self, change: Tensor, constant: Tensor) -> list[Tensor]:
        """Return gains (B, 3, 3), weights (B, n), touched blocks (B, n) and their threshold (B, 1)."""
        gains = functional.pad(constant[..., None], (0, 2))
        weighted, live = change * self.shown, torch.ones_like(constant[:, 0], dtype=torch.bool)
        kept: list[Tensor] = []
        for _ in range(one.MAX_ITERATIONS):
            squares = self._left(change, gains).square().sum(1)
            scale = (self._medians(squares) / one.MEDIAN_LENGTH**2).clamp(min=1.0)[:, None]
            limit = CONTACT.colour_sigma**2 * scale
            weights = self.usable / (1.0 + squares / (9.0 * scale)).square()
            touched = self.usable & (squares > limit)
            solid = shrunk(touched.reshape(-1, *self.shape), 2, 1, outside=True)
            fitting = weights * ~grown(solid, 8, 3).flatten(1)
            fitting = torch.where(((fitting != 0).sum(1) < one.MIN_BLOCKS)[:, None], weights, fitting)
            after = self._fit(weighted, fitting, gains[:, :, 0])
            state = [after, fitting, touched, limit]
            kept = [chosen(live, *pair) for pair in zip(state, kept, strict=True)] if kept else state
            live, gains = live & ((after - gains).abs().amax((1, 2)) >= one.CONVERGENCE_TOL), kept[0]
            if not self.recorded and not live.any():
                break
        return kept

    def _fit(self, weighted: Tensor, weights: Tensor, constant: Tensor) -> Tensor:
        """Return gains (B, 3, 3) by weighted least squares with a prior on the plane."""
        normal = (weights @ self.normal).reshape(-1, 3, 3, 3)
        prior = one.CORRELATED / (one.PLANE_SHARE * constant.abs() + one.MIN_PLANE).square()
        normal = normal + torch.diag_embed(torch.stack([torch.full_like(prior, TINY), prior, prior], -1))
        right = (weighted * weights[:, None]) @ self.basis
        return (inverse(normal)[0] @ right[..., None])[..., 0]

    def _separated(
        self, change: Tensor, weights: Tensor, constant: Tensor, touched: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the drift (B, 3, 6) and its covariance (B, 18, 18), as `DriftTracker._separated`."""
        noise = self._noise(change, weights)[:, None, None]
        contact = grown(shrunk(touched.reshape(-1, *self.shape), 2, 1, outside=False), 2, 0).flatten(1)
        slopes = self._slopes(change, contact) / noise[..., None] if self.recorded or contact.any() else None
        gain = (1.0 + constant) ** self.power - 1.0
        normal, right = self._normal(change, weights / one.CORRELATED_NOISE, slopes)
        normal, right = normal / noise.square(), right / noise[:, 0].square()
        expected, precision, log_of_spread = self._expected(gain)
        target = right[:, None] + (precision @ expected[..., None])[..., 0]
        spread, log_determinant = inverse(precision + normal[:, None])
        solution = (spread @ target[..., None])[..., 0]
        log_evidence = (target * solution).sum(2) - log_determinant - log_of_spread
        probability = torch.softmax(self.log_weights + 0.5 * log_evidence, 1)[..., None]
        mean = (probability * solution).sum(1)
        off = solution - mean[:, None]
        spread = spread + off[..., None] * off[..., None, :]
        return mean.reshape(-1, 3, one.TERMS), (probability[..., None] * spread).sum(1)

    def _noise(self, change: Tensor, weights: Tensor) -> Tensor:
        """Return the noise (B,) of the blocks, as `drift.noise_of`."""
        change, weights = change.reshape(-1, 3, *self.shape), weights.reshape(-1, *self.shape)
        bend = (change[..., 2:] - 2.0 * change[..., 1:-1] + change[..., :-2]).abs()
        counted = (weights[:, None, :, 1:-1] > 0.5).expand_as(bend).flatten(1)
        found = MAD_TO_STD / 6**0.5 * masked_median(bend.flatten(1), counted)
        return found.clamp(min=one.MIN_NOISE).masked_fill(~counted.any(1), 1.0)

    def _slopes(self, change: Tensor, contact: Tensor) -> Tensor:
        """Return the changes (B, 3, k, n) by likely slopes around a `contact` (B, n), as `drift.likely_slopes`."""
        effects = self.slope_effects
        share = one.SLOPE_SHARE if effects.shape[1] == 2 else one.GUESSED_SHARE
        ratio = change.square().sum(1) / effects.square().sum((0, 1))
        rms = masked_median(ratio, contact).masked_fill(~contact.any(1), 0.0).sqrt()
        away = distance(~contact.reshape(-1, *self.shape)).flatten(1)
        fall = torch.exp(-away * (torch.pi / contact.sum(1).clamp(min=1)).sqrt()[:, None])
        return effects * (share * rms[:, None] * fall)[:, None, None]

    def _normal(self, change: Tensor, weights: Tensor, slopes: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return the normal equations (B, 18, 18) and right sides (B, 18), as `drift._normal`.

        The trust of a block is diag(w) - sum_k v_k v_k' / p_k; its products are summed term by term.
        """
        same = weights[:, None]
        blocks = (weights @ self.squares).reshape(-1, 3, one.TERMS, one.TERMS)
        lost: list[tuple[Tensor, Tensor]] = []
        wanted = same * change
        for unit in () if slopes is None else slopes.unbind(2):
            pull = same * unit
            for before, power in lost:
                pull = pull - before * ((before * unit).sum(1) / power)[:, None]
            power = weights + (unit * pull).sum(1)
            lost.append((pull, power.clamp(min=TINY)))
            wanted = wanted - pull * ((pull * change).sum(1) / lost[-1][1])[:, None]
        normal = blocks.new_zeros((len(blocks), 3, one.TERMS, 3, one.TERMS))
        for c in range(3):
            normal[:, c, :, c] = blocks[:, c]
        normal = normal.flatten(3).flatten(1, 2)
        for pull, power in lost:
            part = (self.terms * (pull / power.sqrt()[:, None])[:, :, None]).flatten(1, 2)
            normal = normal - part @ part.transpose(1, 2)
        return normal, (self.terms @ wanted[..., None]).flatten(1)

    def _expected(self, gain: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the priors' means (B, kinds, 18), precisions and log terms, as `drift._expected`."""
        common, spread = gain.abs()[:, None], (gain - gain.median(1, keepdim=True).values).abs().amax(1)
        spread = spread[:, None, None].expand(-1, 1, 3)
        stray, stray_std, gradient, mixture, mixture_std, uneven, separate = self.kinds.T[:, :, None]
        own = (separate * common.amax(2, keepdim=True) + one.MIN_STD).clamp(max=one.COMMON_STD) / self.power
        plane = (gradient * common + uneven * spread + one.MIN_STD) / self.power
        mixed = mixture_std * spread + one.MIN_STD
        parts = (own.expand_as(plane), plane, plane, stray_std * common + one.MIN_STD, mixed, mixed)
        std = torch.stack(parts, -1).flatten(2)
        others = (gain[:, self.others] - gain[..., None])[:, None] * mixture[..., None]
        dimmed = (-stray * gain[:, None])[..., None]
        expected = torch.cat([torch.zeros_like(others), torch.zeros_like(dimmed), dimmed, others], -1).flatten(2)
        precision, weight = torch.diag_embed(std**-2), std[..., 0] ** -2
        shared = weight / (3.0 + 1.0 / (one.COMMON_STD**2 * weight))
        precision[..., :: one.TERMS, :: one.TERMS] -= shared[..., None, None]
        log_of_spread = 2.0 * std.log().sum(2) + torch.log1p(3 * one.COMMON_STD**2 * weight)
        return expected, precision, log_of_spread + (expected / std).square().sum(2)

    def _inverse(self, drift: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return gains (B, 3, 3), corrections (B, 3, 4) and whether they mix light (B,)."""
        gain = 1.0 + self.power * drift[..., 0]
        mixed = drift[..., 3:].abs().amax((1, 2)) >= self.power * one.CONVERGENCE_TOL
        level = (gain ** (1.0 / self.power)).masked_fill(mixed[:, None], 1.0)
        gains = torch.cat([(level - 1.0)[..., None], drift[..., 1:3] * (level / gain)[..., None]], -1)
        mix = torch.diag_embed(gain - drift[..., 4] - drift[..., 5])
        mix = mix.scatter_add(2, self.others.expand(len(mix), -1, -1), drift[..., 4:])
        undo = inverse(self.light[:, None] * mix / self.light)[0]
        stray = -undo @ (drift[..., 3] * self.light)[..., None]
        same = torch.eye(3, 4, dtype=undo.dtype, device=undo.device)
        return gains, torch.where(mixed[:, None, None], torch.cat([undo, stray], -1), same), mixed

    def _left(self, change: Tensor, gains: Tensor) -> Tensor:
        terms = self.terms[:, : gains.shape[2]]
        return change - (gains.transpose(0, 1) @ terms).transpose(0, 1)

    def _medians(self, values: Tensor) -> Tensor:
        """Return the medians (...) of `values` (..., n) over the usable blocks."""
        ordered, count = ascending(values[..., self.counted]), int(self.tracker.usable.sum())
        return 0.5 * (ordered[..., (count - 1) // 2] + ordered[..., count // 2])


# Steps on batches: masks (B, h, w), and small matrices.


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


def distance(inside: Tensor) -> Tensor:
    """Return the distance (B, h, w) to the nearest place outside the mask (B, h, w), in places."""
    rows, columns = (torch.arange(n, device=inside.device, dtype=torch.float32) for n in inside.shape[1:])
    square = (FAR * inside)[..., None] + (columns[:, None] - columns).square()
    return (square.amin(2)[:, :, None] + (rows[:, None] - rows).square()[..., None]).amin(1).sqrt()


def ascending(values: Tensor) -> Tensor:
    """Return `values` (..., n) in order along the last axis; numpy sorts faster on the processor."""
    if values.device.type != "cpu":
        return values.sort(-1).values
    return torch.from_numpy(np.sort(values.numpy(), axis=-1))


def masked_median(values: Tensor, mask: Tensor) -> Tensor:
    """Return the median (B,) of `values` (B, n) where the `mask` (B, n) is set; infinite where it is not."""
    ordered, count = ascending(values.masked_fill(~mask, torch.inf)), mask.sum(-1, keepdim=True)
    low, high = ((count - 1) // 2).clamp(min=0), (count // 2).clamp(max=values.shape[1] - 1)
    return (0.5 * (ordered.gather(1, low) + ordered.gather(1, high)))[:, 0]


def inverse(matrix: Tensor) -> tuple[Tensor, Tensor]:
    """Return the inverses (..., n, n) of matrices that need no pivots, and the logs (...) of their determinants.

    By Gauss-Jordan elimination, n steps on the whole batch.
    """
    matrix, log = matrix.clone(), torch.zeros_like(matrix[..., 0, 0])
    for k in range(matrix.shape[-1]):
        pivot = matrix[..., k, k].clone()
        log = log + pivot.abs().log()
        row, column = matrix[..., k, :] / pivot[..., None], matrix[..., k].clone()
        matrix = matrix - column[..., None] * row[..., None, :]
        matrix[..., k, :], matrix[..., k] = row, -column / pivot[..., None]
        matrix[..., k, k] = 1.0 / pivot
    return matrix, log
