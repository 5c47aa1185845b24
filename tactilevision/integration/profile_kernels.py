"""Slopes along the rays of a rim of `circular_edges.py`, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import BYTES2, LINE32, LINES, PLANE, kernel
from tactilevision.records import Floats

Picture = npt.NDArray[np.float32]


@kernel(LINE32, LINE32, LINE32, LINE32, "float32", "float32", "float32[:, ::1]", "float32[:, ::1]")
def rays(
    across: Picture, down: Picture, r: Picture, s: Picture, left: float, top: float, x: Picture, y: Picture
) -> None:
    """Places `x`, `y` (K, J) in px along directions (K,): `r`, `s` (J,) px along x and y from a centre."""
    for k in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[k, j] = across[k] * r[j] + left
            y[k, j] = down[k] * s[j] + top


@kernel(PLANE, PLANE, BYTES2, LINE32, LINE32, "int64")
def inward(
    p: Picture, q: Picture, known: npt.NDArray[np.uint8], across: Picture, down: Picture, each: int
) -> Floats:
    """Slopes (K, J), mm/mm, towards the centre, means of `each` directions (K each, J); NaN: unknown."""
    out = np.empty((p.shape[0] // each, p.shape[1]))
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = np.float32(0.0)
            for i in range(each * k, each * k + each):
                slope = -across[i] * p[i, j] - down[i] * q[i, j]
                total += slope if known[i, j] else np.float32(np.nan)
            out[k, j] = total / each
    return out


@kernel(LINES, "Array(float64, 1, 'C', True)")
def quantiles(values: Floats, shares: Floats) -> Floats:
    """What a share (n,) of the known values in each column of (K, J) do not exceed, (n, J), or NaN."""
    out, column = np.full((len(shares), values.shape[1]), np.nan), np.empty(values.shape[0])
    for j in range(values.shape[1]):
        count = 0
        for k in range(values.shape[0]):
            value = values[k, j]
            if not np.isnan(value):
                i = count
                while i and column[i - 1] > value:
                    column[i] = column[i - 1]
                    i -= 1
                column[i] = value
                count += 1
        for n in range(len(shares) if count else 0):
            out[n, j] = column[int(shares[n] * (count - 1))]
    return out
