"""Integrate slopes of many frames at once, and fit zero planes, in torch: as `poisson.py` and `zero_plane.py`."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from scipy import fft
from torch import Tensor
from torch.nn import functional

from tactilevision.heightmap import zero_plane as one
from tactilevision.heightmap.poisson import edge_divergence, inverse_eigenvalues
from tactilevision.heightmap.zero_plane import ZeroPlane, decay_of, plane_terms
from tactilevision.photometric.batched_drift import Batched, chosen
from tactilevision.photometric.drift import inverse
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Pair
from tactilevision.robust import MAD_TO_STD, ascending, take

ROUNDS = 12  # rounds of `components`: twice what random masks of these sizes take


class BatchedPoisson:
    """Solve Poisson's equation for slopes of one size (H, W) and scale, as `poisson.integrate`.

    By products with matrices: C of the cosine transform of a line, and D of its divergence, as the frame path's.
    """

    def __init__(self, shape: tuple[int, int], mm_per_px: Pair, device: str) -> None:
        def on(values: Any) -> Tensor:
            return torch.as_tensor(np.array(values, np.float32), device=device)

        waves = [fft.dct(np.eye(n), norm="ortho", axis=0) for n in shape]
        steps = mm_per_px[::-1], mm_per_px
        turned = [
            edge_divergence(np.eye(n), np.zeros((n, n)), step) @ wave.T
            for n, step, wave in zip(shape, steps, waves, strict=True)
        ]
        (self.down, self.across), (self.fall_down, self.fall_across) = map(on, waves), map(on, turned)
        self.inverse = on(inverse_eigenvalues(shape, mm_per_px, "f"))

    def integrate(self, slopes: Tensor) -> Tensor:
        """Return depth (B, H, W) mm, mean 0, of slopes (B, 2, H, W) that are all known."""
        modes = self.down @ (slopes[:, 0] @ self.fall_across) + (self.fall_down.T @ slopes[:, 1]) @ self.across.T
        return self.down.T @ (modes * self.inverse) @ self.across


def components(mask: Tensor) -> Tensor:
    """Return labels (B, h * w) of the connected parts of a mask (B, h, w), 0 outside.

    Neighbours share an edge. Every place takes the greatest label around it, also for
    the place that its label names, then the label of the place so named.
    """
    first = mask.new_zeros((len(mask), 1), dtype=torch.int32)
    label = torch.arange(1, mask[0].numel() + 1, device=mask.device, dtype=torch.int32).view(mask.shape[1:])
    label = label * mask
    for _ in range(ROUNDS):
        wide = functional.pad(label, (1, 1, 1, 1))
        across = torch.maximum(wide[:, 1:-1, :-2], wide[:, 1:-1, 2:])
        down = torch.maximum(wide[:, :-2, 1:-1], wide[:, 2:, 1:-1])
        near = (torch.maximum(torch.maximum(across, down), label) * mask).flatten(1)
        named = torch.cat([first, near], 1).scatter_reduce(1, label.flatten(1).long(), near, "amax")
        label = named.gather(1, near.long()).view(mask.shape)
    return label.flatten(1).long()


class Planes(NamedTuple):
    """Zero planes of B frames: the fields of `zero_plane.ZeroPlane`, offset and tilt (mm) together (B, 3).

    `odd` (B,): frames with too little untouched gel.
    """

    plane_mm: Batched
    std_mm: Batched
    share: Batched
    takes: Batched
    odd: Batched

    def of(self, k: int) -> ZeroPlane:
        """Return the plane of the frame k, of arrays."""
        (offset, x, y), (std, std_x, std_y) = self.plane_mm[k].tolist(), self.std_mm[k].tolist()
        return ZeroPlane(offset, (x, y), std, float(self.share[k]), self.takes[k], (std_x, std_y))


class BatchedPlane:
    """Fit the zero planes of depths (B, h, w) with untouched blocks (B, rows, columns), as `find_zero_plane`."""

    def __init__(
        self, shape: tuple[int, int], trusted: Bools, mm_per_px: Pair, *, thickness_mm: float | None, device: str
    ) -> None:
        def on(values: Any) -> Tensor:
            return torch.as_tensor(np.array(values), device=device)

        self.shape, blocks = shape, trusted.shape
        self.down, self.across = (on(_shares(n, few)) for n, few in zip(shape, blocks, strict=True))
        self.trusted, self.plane, self.stiff = on(trusted), on(plane_terms(shape, blocks)), on(one.STIFFENING)
        self.decay, self.decay_std = decay_of(shape, blocks, mm_per_px=mm_per_px, thickness_mm=thickness_mm)
        border = torch.ones(blocks, dtype=torch.bool, device=device)
        border[1:-1, 1:-1] = False
        self.border = border.flatten().float()
        self.x, self.y = (torch.linspace(-1, 1, n, device=device) for n in shape[::-1])

    def find(self, depth: Tensor, untouched: Tensor) -> Planes:
        """Return the zero planes of depths."""
        blocks = ((self.down @ depth) @ self.across.T).double().flatten(1)
        gel = self._outer_gel(untouched | ~self.trusted, blocks)
        flat = (gel & self.trusted).flatten(1)
        count = flat.sum(1)
        odd = (count < one.MIN_BLOCKS) | (3 * count < 2 * flat.shape[1])
        rises = one.has_dent(blocks, gel.flatten(1), flat, self.plane)
        terms = one.with_rise(self.plane, gel, self.decay)
        terms[:, 3:] *= rises[:, None, None]
        solution, std, takes = self._reweighted(terms, blocks, flat, rises)
        return Planes(solution[:, :3], std[:, :3], count / flat.shape[1], takes[:, :3].float(), odd)

    def level(self, depth: Tensor, planes: Planes) -> Tensor:
        """Return depths minus their planes."""
        offset, x, y = planes.plane_mm.float()[:, :, None, None].unbind(1)
        flat: Tensor = depth - (self.x * x + offset) - self.y[:, None] * y
        return flat

    def _outer_gel(self, untouched: Tensor, depth: Tensor) -> Tensor:
        """Return the untouched blocks (B, rows, columns) around all contacts, as `zero_plane._outer_gel`."""
        labels = components(untouched)
        none = depth.new_zeros((len(depth), depth.shape[1] + 1))
        size = none.scatter_add(1, labels, torch.ones_like(depth))
        at_border = none.scatter_add(1, labels, self.border.double().expand_as(depth)) > 0
        pieces = size * at_border
        pieces[:, 0] = 0.0
        largest, large = pieces.argmax(1, keepdim=True), pieces >= one.CORRELATED
        means = none.scatter_add(1, labels, depth) / size.clamp(min=1.0)
        highest = means.masked_fill(~large, torch.inf).argmin(1, keepdim=True)
        lower = means.gather(1, largest) - means.gather(1, highest) > one.MAX_DROP * (
            depth.amax(1) - depth.amin(1)
        ).unsqueeze(1)
        of = torch.where(lower & (large.sum(1, keepdim=True) > 1), highest, largest)
        return ((labels == of) & (labels > 0)).view(untouched.shape)

    def _reweighted(
        self, terms: Tensor, depth: Tensor, flat: Tensor, rises: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return coefficients (B, 5), their deviations, and weights of the depths, as `_reweighted_fit`."""
        count = flat.sum(1, keepdim=True)
        correlated, prior = count.clamp(max=one.CORRELATED), 1.0 * one.FIRST_WEIGHT * count[:, 0]
        rows = torch.cat([terms, depth[:, None]], 1)
        weighted, live = terms * flat[:, None], rises | ~rises
        unused = torch.diag_embed((~rises[:, None]).double() * (torch.arange(5, device=depth.device) > 2))
        kept: list[Tensor] = []
        solution = depth.new_zeros((len(depth), 5))
        for _ in range(one.MAX_ITERATIONS):
            sums = weighted @ rows.transpose(1, 2)
            normal = sums[..., :-1] * self.stiff + unused
            normal[:, -1, -1] += prior * rises
            inverted = inverse(normal)[0]
            found = (inverted @ sums[..., -1:])[..., 0]
            square = ((found[:, None] @ terms)[:, 0] - depth).square()
            square = square.masked_fill(~flat, torch.inf)
            scale = MAD_TO_STD * take(ascending(square), count // 2).sqrt() + TINY
            state = [found, scale, inverted]
            moved = (found - solution)[:, :3].abs().amax(1) >= one.CONVERGENCE_TOL * scale[:, 0]
            kept = [chosen(live, *pair) for pair in zip(state, kept, strict=True)] if kept else state
            solution, live = kept[0], live & moved
            spread = self.decay_std * found[:, -2].abs() + scale[:, 0] * one.MIN_RISE
            prior = correlated[:, 0] * (scale[:, 0] / spread).square()
            bounded = terms / (1.0 + square / (3.0 * scale).square()).square()[:, None]
            weighted = chosen(live, bounded, weighted)
        solution, scale, inverted = kept
        std = scale * (correlated * inverted.diagonal(dim1=1, dim2=2)).sqrt()
        return solution, std, inverted @ weighted


def _shares(count: int, blocks: int) -> Any:
    """Return the shares (blocks, count) of places on a line in the means of `zero_plane._means`."""
    places = np.eye(count, dtype=np.float32)
    if count > blocks * one.SAMPLED:
        places = places[np.arange(blocks * one.SAMPLED) * count // (blocks * one.SAMPLED)]
    return cv2.resize(places, (count, blocks), interpolation=cv2.INTER_AREA)
