"""The polynomial of `polynomial.py` over rows of pixels, compiled; as Horner has it, in colours and in x."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINE32, PLANE, kernel

Picture = npt.NDArray[np.float32]
Line = npt.NDArray[np.float32]
PRODUCTS = 19  # c: coefficients (6 * 19,) of a row, power of x by product of one to three colours
FOURTH = 15  # d: the same (2 * 15,) of products of four colours


@kernel()
def _five(c: Line, k: int, x: float) -> float:
    """The polynomial of fifth order in x that belongs to product `k`; and of second, and of first, below."""
    high = ((c[5 * PRODUCTS + k] * x + c[4 * PRODUCTS + k]) * x + c[3 * PRODUCTS + k]) * x
    return ((high + c[2 * PRODUCTS + k]) * x + c[PRODUCTS + k]) * x + c[k]


@kernel()
def _two(c: Line, k: int, x: float) -> float:
    return (c[2 * PRODUCTS + k] * x + c[PRODUCTS + k]) * x + c[k]


@kernel()
def _one(c: Line, k: int, x: float) -> float:
    return c[PRODUCTS + k] * x + c[k]


@kernel(PLANE, PLANE, PLANE, PLANE, LINE32, "float32", "float32[:, ::1]")
def slopes(
    red: Picture, green: Picture, blue: Picture, rows: Picture, across: Line, bound: float, out: Picture
) -> None:
    """One slope (h, w) of changes (h, w), into `out`; coefficients by `rows` (h, 6 * 19), x `across` (w,)."""
    for row in range(out.shape[0]):
        c, red_row, green_row, blue_row, out_row = rows[row], red[row], green[row], blue[row], out[row]
        for i in range(out.shape[1]):
            r, g, b, x = red_row[i], green_row[i], blue_row[i], across[i]
            of_r = r * _one(c, 9, x) + g * _one(c, 10, x) + b * _one(c, 11, x) + _two(c, 3, x)
            of_r = r * of_r + g * (g * _one(c, 12, x) + b * _one(c, 13, x) + _two(c, 4, x))
            of_r += b * (b * _one(c, 14, x) + _two(c, 5, x)) + _five(c, 0, x)
            of_g = g * (g * _one(c, 15, x) + b * _one(c, 16, x) + _two(c, 6, x))
            of_g += b * (b * _one(c, 17, x) + _two(c, 7, x)) + _five(c, 1, x)
            slope = r * of_r + g * of_g + b * (b * (b * _one(c, 18, x) + _two(c, 8, x)) + _five(c, 2, x))
            out_row[i] = min(max(slope, -bound), bound)


@kernel()
def _four(d: Line, k: int, x: float) -> float:
    """The polynomial of first order in x that belongs to product `k` of four colours, the first of them 0."""
    return d[FOURTH + k] * x + d[k]


@kernel(PLANE, PLANE, PLANE, PLANE, LINE32, "float32", "float32[:, ::1]")
def add_fourth(
    red: Picture, green: Picture, blue: Picture, rows: Picture, across: Line, bound: float, out: Picture
) -> None:
    """Add to one slope (h, w), `out`, what products of four of the changes (h, w) make, and hold it to `bound`.

    Coefficients by `rows` (h, 2 * 15), x `across` (w,).
    """
    for row in range(out.shape[0]):
        d, red_row, green_row, blue_row, out_row = rows[row], red[row], green[row], blue[row], out[row]
        for i in range(out.shape[1]):
            r, g, b, x = red_row[i], green_row[i], blue_row[i], across[i]
            of_rr = r * (r * _four(d, 0, x) + g * _four(d, 1, x) + b * _four(d, 2, x))
            of_rr += g * (g * _four(d, 3, x) + b * _four(d, 4, x)) + b * b * _four(d, 5, x)
            of_rg = g * (g * _four(d, 6, x) + b * _four(d, 7, x)) + b * b * _four(d, 8, x)
            of_gg = g * (g * _four(d, 10, x) + b * _four(d, 11, x)) + b * b * _four(d, 12, x)
            of_bbb = r * _four(d, 9, x) + g * _four(d, 13, x) + b * _four(d, 14, x)
            slope = out_row[i] + r * (r * of_rr + g * of_rg) + g * g * of_gg + b * b * b * of_bbb
            out_row[i] = min(max(slope, -bound), bound)
