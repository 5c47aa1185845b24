"""The reweighted fit of `drift.py` to the blocks of a frame, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINES, kernel
from tactilevision.compiled.parts import median, solved
from tactilevision.records import Floats

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
