"""Compiled kernels: colour change, drift fit, and the polynomial method."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import BYTES3, LINE32, LINES, PLANE, PLANES, kernel
from tactilevision.compiled.parts import median, solved
from tactilevision.records.measured import Floats

# The colour changes of `colour_change.py`, compiled.

Planes = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]


@kernel(BYTES3, PLANES, PLANES, PLANES, "int64", "int64", "float32", "float32[:, :, ::1]")
def changes(
    rgb: Bytes,
    down: Planes,
    across: Planes,
    scale: Planes,
    top: int,
    left: int,
    softening: float,
    out: Planes,
) -> None:
    """Changes (3, h, w), relative, into `out` from row `top` and column `left` of a picture (H, W, 3) on.

    Its gain is the product of `down` (3, H, 2) and `across` (3, 2, W); `scale` (3, H, W).
    """
    count, height, width = out.shape
    apart = np.empty((count, width), np.float32)
    for row in range(height):
        pixels, red, green, blue = rgb[top + row, left:], apart[0], apart[1], apart[2]
        for i in range(width):
            red[i], green[i], blue[i] = pixels[i, 0], pixels[i, 1], pixels[i, 2]
        for c in range(count):
            first, second = down[c, top + row]
            grey, per_grey, line = apart[c], scale[c, top + row, left:], out[c, row]
            level, lean = across[c, 0, left:], across[c, 1, left:]
            for i in range(width):
                gain = first * level[i] + second * lean[i]
                line[i] = (grey[i] * gain + softening) * per_grey[i] - np.float32(1.0)


# The reweighted fit of `drift.py` to the blocks of a frame, compiled.

Bools = npt.NDArray[np.bool_]
LINES3, BLOCKS = "Array(float64, 3, 'C', True)", "Array(bool, 1, 'C', True)"


@kernel()
def _squares(change: Floats, gains: Floats, terms: Floats, out: Floats) -> None:
    """Squared distance (n,) of blocks from a drift over the channels."""
    out[:] = 0.0
    for c in range(3):
        one, x, y = terms[c, 0], terms[c, 1], terms[c, 2]
        for i in range(len(out)):
            off = change[c, i] - (gains[c, 0] * one[i] + gains[c, 1] * x[i] + gains[c, 2] * y[i])
            out[i] += off * off


@kernel()
def _near_contact(touched: Bools, width: int) -> Bools:
    """Blocks within 3 to either side of a contact of 2 by 2 blocks."""
    height, near = len(touched) // width, np.zeros(len(touched), np.bool_)
    for row in range(height):
        for i in range(width):
            here = touched[row * width + i]
            if row:
                here &= touched[(row - 1) * width + i]
            if i:
                here &= touched[row * width + i - 1]
            if row and i:
                here &= touched[(row - 1) * width + i - 1]
            if here:
                for y in range(max(row - 4, 0), min(row + 4, height)):
                    near[y * width + max(i - 4, 0) : y * width + min(i + 4, width)] = True
    return near


@kernel()
def _fit(
    weighted: Floats,
    weights: Floats,
    basis: Floats,
    normal: Floats,
    constant: Floats,
    plane_share: float,
    least_plane: float,
    correlated: float,
) -> Floats:
    """Gains (3, 3): weighted ridge regression, each channel by itself."""
    sums, right = np.zeros(27), np.zeros((3, 3))
    for i in range(len(weights)):
        for k in range(27):
            sums[k] += weights[i] * normal[i, k]
        for c in range(3):
            for k in range(3):
                right[c, k] += weighted[c, i] * weights[i] * basis[i, k]
    gains = np.empty((3, 3))
    for c in range(3):
        square = sums[9 * c : 9 * c + 9].reshape(3, 3)
        square[0, 0] += 1e-9
        precision = correlated / (plane_share * abs(constant[c]) + least_plane) ** 2
        square[1, 1] += precision
        square[2, 2] += precision
        gains[c] = solved(square, right[c])
    return gains


@kernel(*[LINES] * 3, LINES3, LINES, LINES, BLOCKS, "int64", *["float64"] * 5, "int64", "int64", "float64")
def reweighted(
    change: Floats,
    start: Floats,
    shown: Floats,
    terms: Floats,
    basis: Floats,
    normal: Floats,
    usable: Bools,
    width: int,
    median_square: float,
    touched_square: float,
    plane_share: float,
    least_plane: float,
    correlated: float,
    fewest: int,
    rounds: int,
    tolerance: float,
) -> tuple[Floats, Floats, Bools, float]:
    """Gains (3, 3), relative, from `start`, weights (n,) of blocks, those touched, their limit."""
    weighted, gains, squares, limit = change * shown, start, np.empty(len(usable)), 0.0
    fitting, touched = np.empty(len(usable)), np.zeros(len(usable), np.bool_)
    for _ in range(rounds):
        _squares(change, gains, terms, squares)
        scale = max(1.0, median(squares[usable]) / median_square)
        limit = touched_square * scale
        some = False
        for i in range(len(usable)):
            touched[i] = usable[i] and squares[i] > limit
            some |= touched[i]
            fitting[i] = 1.0 / (1.0 + squares[i] / (9.0 * scale)) ** 2 if usable[i] else 0.0
        if some:
            near, away = _near_contact(touched, width), 0
            for i in range(len(usable)):
                away += not near[i] and fitting[i] > 0.0
            for i in range(len(usable) if away >= fewest else 0):
                fitting[i] = 0.0 if near[i] else fitting[i]
        before = gains
        gains = _fit(weighted, fitting, basis, normal, before[:, 0], plane_share, least_plane, correlated)
        moved = 0.0
        for c in range(3):
            for k in range(3):
                moved = max(moved, abs(gains[c, k] - before[c, k]))
        if moved < tolerance:
            break
    return gains, fitting, touched, limit


# The polynomial of `polynomial.py` over rows of pixels, compiled; as Horner has it, in colours and in x.

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
