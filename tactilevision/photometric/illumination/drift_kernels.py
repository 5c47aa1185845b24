"""The reweighted fit of `drift.py` to the blocks of a frame, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINES, kernel
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
def _fit(weighted: Floats, weights: Floats, basis: Floats, normal: Floats, precision: Floats) -> Floats:
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
        square[1, 1] += precision[c]
        square[2, 2] += precision[c]
        gains[c] = np.linalg.solve(square, right[c])
    return gains


@kernel(LINES, LINES, LINES, LINES3, LINES, LINES, BLOCKS, "int64", "float64", "float64", "float64", "float64",
        "float64", "int64", "int64", "float64")  # fmt: skip
def reweighted(
    change: Floats, start: Floats, shown: Floats, terms: Floats, basis: Floats, normal: Floats, usable: Bools,
    width: int, median_square: float, touched_square: float, plane_share: float, least_plane: float,
    correlated: float, fewest: int, rounds: int, tolerance: float,
) -> tuple[Floats, Floats, Bools, float]:  # fmt: skip
    """Gains (3, 3) from a `start`, weights (n,) of the blocks, which are touched, and their limit, as `_reweighted`."""
    weighted, gains, squares, limit = change * shown, start, np.empty(len(usable)), 0.0
    fitting, touched = np.empty(len(usable)), np.zeros(len(usable), np.bool_)
    for _ in range(rounds):
        _squares(change, gains, terms, squares)
        scale = max(1.0, np.median(squares[usable]) / median_square)
        limit = touched_square * scale
        weights = usable / np.square(1.0 + squares * (1.0 / (9.0 * scale)))
        touched = usable & (squares > limit)
        fitting = weights
        if touched.any():
            away = weights * ~_near_contact(touched, width)
            if np.count_nonzero(away) >= fewest:
                fitting = away
        before = gains
        precision = correlated / np.square(plane_share * np.abs(gains[:, 0]) + least_plane)
        gains = _fit(weighted, fitting, basis, normal, precision)
        if np.abs(gains - before).max() < tolerance:
            break
    return gains, fitting, touched, limit
