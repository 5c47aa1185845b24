"""Convert many pictures to slopes at once, in torch: as `photometric/method.py` and its evaluators."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tactilevision.photometric.batched_drift import Drifts, grown, shrunk
from tactilevision.photometric.colour_change import ChangeMaps
from tactilevision.photometric.drift import SOFTENING_GREY
from tactilevision.photometric.method import MAX_WINDOW_SHARE, SCATTER_SIGMA, STRIDE, TiledEvaluator
from tactilevision.photometric.methods.lookup import FINE, LookupEvaluator
from tactilevision.photometric.methods.polynomial import LOW, MAX_ORDER, PolynomialEvaluator
from tactilevision.photometric.protocols import Evaluator
from tactilevision.records.measured import Picture
from tactilevision.robust import median

PARTS = 32  # of a pixel, to which OpenCV rounds maps in fixed point

Law = Callable[[Tensor], Tensor]


def rectified(rgb: Tensor, maps: list[Tensor] | None) -> Tensor:
    """Return pictures (B, 3, H, W) in whole grey levels of raw ones (B, rows, columns, 3), by maps x, y (1, H, W).

    kornia's bilinear remap, with maps and result rounded as in `sensors.rectification.rectify`: the grey levels
    between pixels are multiples of 1 / PARTS^2, and halves are rounded up.
    """
    planes = rgb.permute(0, 3, 1, 2).float()
    if maps is None:
        return planes
    from kornia.geometry.transform import remap

    x, y = ((one * PARTS).round().div(PARTS).expand(len(planes), -1, -1) for one in maps)
    rounded: Tensor = (
        remap(planes, x, y, padding_mode="border", align_corners=True).add(0.5 + 0.5 / PARTS**2).floor()
    )
    return rounded


class Level:
    """Reads grey levels (B, 3, h, w) at one resolution as slopes (B, 2, h, w)."""

    def __init__(
        self, maps: ChangeMaps, evaluate: Evaluator, kept: Picture, bias: Picture, *, device: str
    ) -> None:
        def on(values: Any) -> Tensor:
            return torch.as_tensor(np.array(values, np.float32), device=device)

        self.law: Law = LAWS[type(evaluate)](evaluate, on)
        self.scale, self.kept_share, self.bias, self.dark = on(maps.scale), on(kept), on(bias), maps.dark
        self.x, self.y = on(maps.x), on(maps.y)

    @staticmethod
    def reads(evaluate: Evaluator) -> bool:
        """Return whether torch has the law of an evaluator."""
        return type(evaluate) in LAWS

    def slopes(self, greys: Tensor, gains: Tensor) -> Tensor:
        """Return the slopes of grey levels in the light of `gains` (B, 3, 3)."""
        share, (x, y) = 1.0 / (1.0 + gains[..., 0]), gains[..., 1:].unbind(2)
        down = share[..., None] * (1.0 - (share * y)[..., None] * self.y)
        across = (-share.square() * x)[..., None] * self.x
        light = down.float()[..., None] + across.float()[..., None, :]
        if self.dark is not None:
            light[:, self.dark] = 0.0
        change = (greys * light + SOFTENING_GREY) * self.scale - 1.0
        return self.law(change) * self.kept_share - self.bias


def _polynomial(evaluate: PolynomialEvaluator, on: Callable[[Any], Tensor]) -> Law:
    low, high, x = on(evaluate.per_row[:, :LOW]), on(evaluate.per_row[:, LOW:, :3]), on(evaluate.x)
    bound = float(evaluate.bound)

    def slopes(change: Tensor) -> Tensor:
        rows = change.permute(2, 1, 0, 3)  # one product a row of the picture, of all frames
        products = rows.new_empty((len(rows), evaluate.products, *rows.shape[2:]))
        products[:, :3] = rows
        for first, below, above in evaluate.raised:
            torch.mul(products[:, below], products[:, first], out=products[:, above])
        flat = products.flatten(2)
        sums = torch.cat([low @ flat, high @ flat[:, :3]], 1).view(len(rows), MAX_ORDER + 1, 2, *rows.shape[2:])
        found = sums[:, MAX_ORDER]
        for i in reversed(range(MAX_ORDER)):
            found = torch.addcmul(sums[:, i], found, x)
        return found.clamp(-bound, bound).permute(2, 1, 0, 3)

    return slopes


def _lookup(evaluate: LookupEvaluator, on: Callable[[Any], Tensor]) -> Law:
    table = on(evaluate.slopes.view(np.float32).reshape(-1, 2))
    per, shift = (on(one)[:, None, None] for one in (evaluate.per, evaluate.shift))

    def slopes(change: Tensor) -> Tensor:
        cells = (change * per + shift).round().clamp(0, FINE - 1).long()
        return table[(cells[:, 0] * FINE + cells[:, 1]) * FINE + cells[:, 2]].permute(0, 3, 1, 2)

    return slopes


LAWS: dict[type[Evaluator], Callable[[Any, Callable[[Any], Tensor]], Law]] = {
    PolynomialEvaluator: _polynomial,
    LookupEvaluator: _lookup,
}


def unmixed(greys: Tensor, drifts: Drifts, power: int) -> Tensor:
    """Return grey levels (B, 3, h, w) with the light's mixing corrected, as `drift.undo_drift`."""
    light, undo = greys.flatten(2), drifts.undo.float()
    linear = undo[..., :3] @ (light if power == 1 else light.square()) + undo[..., 3:]
    return torch.as_tensor(linear if power == 1 else linear.clamp(min=0.0).sqrt()).view(greys.shape)


def active_blocks(slopes: Tensor, tiled: TiledEvaluator, threshold: Tensor, per_noise: Tensor) -> Tensor:
    """Return the blocks (B, rows, columns) around steep or scattered `slopes` (B, 2, h, w).

    As `TiledEvaluator.windows`, whose `threshold` and `per_noise` (h, w) these are, before boxes are drawn.
    """
    steep = slopes.abs().amax(1) > threshold
    steep = grown(shrunk(steep, 2, 1, outside=True), 2, 1)
    near = functional.pad(torch.cat([slopes, slopes.square()], 1), (1, 1, 1, 1), mode="reflect")
    near = near[..., :-2] + near[..., 1:-1] + near[..., 2:]
    near = (near[..., :-2, :] + near[..., 1:-1, :] + near[..., 2:, :]) / 9.0
    scatter = (near[:, 2:] - near[:, :2].square()).sum(1) * per_noise
    typical = median(scatter[:, ::STRIDE, ::STRIDE].flatten(1))
    active = steep | (scatter > SCATTER_SIGMA**2 * typical.clamp(min=1.0)[:, None, None])
    (height, width), block = tiled.padded, tiled.block
    whole = functional.pad(active, (0, width - active.shape[2], 0, height - active.shape[1]))
    blocks = whole.reshape(-1, height // block, block, width // block, block).any(4).any(2)
    return grown(blocks, 3, 1)


def window_mask(blocks: Tensor, tiled: TiledEvaluator) -> Tensor:
    """Return the pixels (B, H, W) in rows and in columns with active `blocks` (B, h, w).

    Around one contact that is its box. All pixels where they cover more than MAX_WINDOW_SHARE of the picture.
    """
    (height, width), step = tiled.shape, tiled.px * tiled.block
    inside = blocks.any(2)[:, :, None, None, None] & blocks.any(1)[:, None, None, :, None]
    pixels = inside.expand(-1, -1, step, -1, step).flatten(3).flatten(1, 2)
    # the last few pixels may be in no block, or blocks reach beyond the picture
    pixels = functional.pad(pixels, (0, width - pixels.shape[2], 0, height - pixels.shape[1]))
    return pixels | (pixels.float().mean((1, 2)) >= MAX_WINDOW_SHARE)[:, None, None]
