"""The polynomial of `polynomial.py` over rows of pixels, compiled; as Horner has it, in colours and in x."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINE32, PLANE, kernel

Picture = npt.NDArray[np.float32]
Line = npt.NDArray[np.float32]
CUBIC = 19  # products of three colours at most
POWERS = 6  # of x; c: coefficients (6 * n,) of a row, power of x by one of n products of colours, 19 or 34


@kernel()
def _five(c: Line, n: int, k: int, x: float) -> float:
    """The polynomial of fifth order in x that belongs to product `k`; and of second, and of first, below."""
    high = ((c[5 * n + k] * x + c[4 * n + k]) * x + c[3 * n + k]) * x
    return ((high + c[2 * n + k]) * x + c[n + k]) * x + c[k]


@kernel()
def _two(c: Line, n: int, k: int, x: float) -> float:
    return (c[2 * n + k] * x + c[n + k]) * x + c[k]


@kernel()
def _one(c: Line, n: int, k: int, x: float) -> float:
    return c[n + k] * x + c[k]


@kernel()
def _cubic(c: Line, n: int, r: float, g: float, b: float, x: float) -> float:
    """The slope that products of three colours at most make."""
    of_r = r * _one(c, n, 9, x) + g * _one(c, n, 10, x) + b * _one(c, n, 11, x) + _two(c, n, 3, x)
    of_r = r * of_r + g * (g * _one(c, n, 12, x) + b * _one(c, n, 13, x) + _two(c, n, 4, x))
    of_r += b * (b * _one(c, n, 14, x) + _two(c, n, 5, x)) + _five(c, n, 0, x)
    of_g = g * (g * _one(c, n, 15, x) + b * _one(c, n, 16, x) + _two(c, n, 6, x))
    of_g += b * (b * _one(c, n, 17, x) + _two(c, n, 7, x)) + _five(c, n, 1, x)
    return r * of_r + g * of_g + b * (b * (b * _one(c, n, 18, x) + _two(c, n, 8, x)) + _five(c, n, 2, x))


@kernel()
def _fourth(c: Line, n: int, r: float, g: float, b: float, x: float) -> float:
    """What products of four colours add to it."""
    rr = r * (r * _one(c, n, 19, x) + g * _one(c, n, 20, x) + b * _one(c, n, 21, x))
    rr += g * (g * _one(c, n, 22, x) + b * _one(c, n, 23, x)) + b * b * _one(c, n, 24, x)
    rg = g * (g * _one(c, n, 25, x) + b * _one(c, n, 26, x)) + b * b * _one(c, n, 27, x)
    gg = g * (g * _one(c, n, 29, x) + b * _one(c, n, 30, x)) + b * b * _one(c, n, 31, x)
    bbb = b * (r * _one(c, n, 28, x) + g * _one(c, n, 32, x) + b * _one(c, n, 33, x))
    return r * (r * rr + g * rg) + g * g * gg + b * b * bbb


@kernel(PLANE, PLANE, PLANE, PLANE, LINE32, "float32", "float32[:, ::1]")
def slopes(
    red: Picture, green: Picture, blue: Picture, rows: Picture, across: Line, bound: float, out: Picture
) -> None:
    """One slope (h, w) of changes (h, w), into `out`; coefficients by `rows` (h, 6 * n), x `across` (w,)."""
    n = rows.shape[1] // POWERS
    for row in range(out.shape[0]):
        c, red_row, green_row, blue_row, out_row = rows[row], red[row], green[row], blue[row], out[row]
        for i in range(out.shape[1]):
            r, g, b, x = red_row[i], green_row[i], blue_row[i], across[i]
            slope = _cubic(c, n, r, g, b, x)
            if n > CUBIC:
                slope += _fourth(c, n, r, g, b, x)
            out_row[i] = min(max(slope, -bound), bound)
