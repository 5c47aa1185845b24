"""Slopes to depth where the picture's border is known to lie flat: all of it at depth 0.

    z = 0 on the outermost pixels,   L z = div (p, q) within        L, div: those of `poisson.py`

solved exactly by one pair of sine transforms. A border that is known takes no error of slope along: of waves and
tilts that wrong slopes make, what a free border lets float is gone. It erases a true tilt as well, and bends a
contact that the border cuts; so the heights that the slopes themselves give the border are looked at first.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.errors import InputError
from tactilevision.integration.dct_poisson import edge_divergence
from tactilevision.records import Pair, SlopeMap

Array = npt.NDArray[np.floating[Any]]
MAX_BORDER_RISE = 0.05  # of the depth that comes out: what the border may rise or fall by


def integrate_dirichlet(slopes: SlopeMap, mm_per_px: Pair) -> Array:
    """Depth (H, W) in mm, float64, 0 on the outermost pixels.

    Raises InputError where the slopes are not finite and valid throughout, or go up and down along the border by
    more than MAX_BORDER_RISE of the depth within: a contact, or a tilt, is cut by it.
    """
    p, q = np.asarray(slopes.dz_dx, np.float64), np.asarray(slopes.dz_dy, np.float64)
    known = np.isfinite(p) & np.isfinite(q) & (True if slopes.valid is None else slopes.valid)
    if min(p.shape) < 3 or not known.all():
        raise InputError(
            "a flat border needs slopes everywhere, on 3 by 3 pixels at least",
            where="integrate",
            value=p.shape,
            remedy="Leave the border free.",
        )
    right = edge_divergence(p, q, half=np.array([0.5 / step for step in mm_per_px]))[1:-1, 1:-1]
    bend = [
        (2.0 - 2.0 * np.cos(np.pi * np.arange(1, count + 1) / (count + 1))) / step**2
        for count, step in zip(right.shape, mm_per_px[::-1], strict=True)
    ]
    modes = fft.dstn(right, type=1) / -(bend[0][:, None] + bend[1][None, :])
    depth = np.pad(fft.idstn(modes, type=1), 1)
    rises, deep = _rises_mm(p, q, mm_per_px), float(np.abs(depth).max())
    if rises > MAX_BORDER_RISE * deep:
        raise InputError(
            "the border is not flat",
            where="integrate",
            value=f"{rises:.3f} mm up and down it",
            remedy="Leave the border free.",
        )
    return np.asarray(depth)


def _rises_mm(p: Array, q: Array, mm_per_px: Pair) -> float:
    """The greatest difference of height along a side of the border, by its own slopes."""
    sides = [(p[0], mm_per_px[0]), (p[-1], mm_per_px[0]), (q[:, 0], mm_per_px[1]), (q[:, -1], mm_per_px[1])]
    heights = [np.cumsum(0.5 * (side[1:] + side[:-1])) * step for side, step in sides]
    return max(float(np.ptp(height)) for height in heights)
