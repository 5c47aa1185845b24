"""The term of slopes steeper than any ball showed, which belong to no round face and were not restored.

    variance(x, y) = (g l)^2      where the depth is over half of the greatest; 0 elsewhere

g: the steepest slope that was calibrated; l: mean width of the steep band, n px^2 / sqrt(4 pi A), n its pixels and
A the area behind it. Such a band may hide as much again as a slope of g drops over its width, and all behind it
stands on that. Vanishes where no slope is steeper than g. Assumes one contact, about round.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.records import Pair, SlopeMap

Picture = npt.NDArray[np.float32]
STEEP_SHARE = 0.95  # of the steepest slope that was calibrated: from there on a slope may be read too low
MIN_STEEP_PX = 12  # pixels of a steep band; fewer are noise
BEHIND = 0.5  # of the greatest depth: what is deeper lies behind the steep band


def hidden_step_mm(depth_mm: Picture, slopes: SlopeMap, *, steepest: float, every: int, mm_per_px: Pair) -> float:
    """What may be missing (mm) of `depth_mm` (h, w) behind slopes (H, W) steeper than `steepest` (mm/mm).

    `depth_mm` holds every `every`th pixel each way; `mm_per_px` (x, y) is of the whole picture.
    """
    p, q = slopes.dz_dx[::every, ::every], slopes.dz_dy[::every, ::every]
    steep_px = every**2 * np.count_nonzero((np.abs(p) > steepest) | (np.abs(q) > steepest))
    if steep_px < MIN_STEEP_PX:
        return 0.0
    area_px = max(float(every**2) * np.count_nonzero(depth_mm > BEHIND * depth_mm.max()), 1.0)
    width_px = steep_px / np.sqrt(4.0 * np.pi * area_px)
    return float(steepest * width_px * np.sqrt(mm_per_px[0] * mm_per_px[1]))


def add_steep_variance(variance_mm2: Picture, depth_mm: Picture, *, hidden_mm: float) -> None:
    """Add the part of a step of `hidden_mm` (mm) to `variance_mm2` (h, w) mm², in place, behind the steep band."""
    if hidden_mm > 0:
        variance_mm2 += np.float32(hidden_mm**2) * (depth_mm > BEHIND * depth_mm.max())
