"""The equations of `two_grid_poisson.py`, compiled: one axis of them by elimination."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINE, LINES, kernel
from tactilevision.records import Floats

Picture = npt.NDArray[np.float32]
BLOCK = 32  # waves at once, so that what is found of them stays in the cache
SINGULAR = 1e-9  # a pivot below it is that of the one mode whose mean is open: its last point stays at 0


@kernel(LINE, "int64", "float64", "float64")
def pivots(bend: Floats, count: int, first: float, last: float) -> Floats:
    """1 over the pivots (count, m) of 2 z_j - z_(j-1) - z_(j+1) + bend z_j, for each `bend` (m,); no unit.

    `first` and `last` are 1 where an end of the line is free, 0 where it is fixed.
    """
    out = np.zeros((count, len(bend)))
    for j in range(count):
        ends = 2.0 - (first if j == 0 else 0.0) - (last if j == count - 1 else 0.0)
        for i in range(len(bend)):
            pivot = ends + bend[i] - (out[j - 1, i] if j else 0.0)
            out[j, i] = 1.0 / pivot if pivot > SINGULAR else 0.0
    return out


@kernel("float32[:, ::1]", LINES, "float64")
def sweep(modes: Picture, inverse: Floats, square: float) -> None:
    """Put z (n, m), mm, in place of `modes` (n, m), 1/mm, with the `inverse` (n, m) of `pivots`.

    -`square` modes_j, `square` in mm^2, is the right side of their equations.
    """
    count, width = modes.shape
    found = np.zeros((count + 1, BLOCK))
    for left in range(0, width, BLOCK):
        size = min(BLOCK, width - left)
        found[0] = 0.0
        for j in range(count):
            now, before, mode, per_pivot = found[j], found[max(j - 1, 0)], modes[j, left:], inverse[j, left:]
            for i in range(size):
                now[i] = (before[i] - square * mode[i]) * per_pivot[i]  # before the first there is 0
        for j in range(count - 1, -1, -1):
            now, after, mode, per_pivot = found[j], found[j + 1], modes[j, left:], inverse[j, left:]
            for i in range(size):
                now[i] += per_pivot[i] * after[i]
                mode[i] = now[i]
