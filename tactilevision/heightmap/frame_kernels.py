"""Compiled kernels of the zero plane, the two-grid equations and inconsistent light."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINE, LINES, PLANE, PLANES, kernel
from tactilevision.compiled.parts import nth, solved
from tactilevision.records.measured import Floats
from tactilevision.robust import MAD_TO_STD

# The equations of `two_grid_poisson.py`, compiled: one axis of them by elimination.

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


# The reweighted fit of `zero_plane.py`, compiled.


@kernel()
def _equations(terms: Floats, depth: Floats, weights: Floats, stiffening: float) -> tuple[Floats, Floats]:
    """Normal equations (k, k) of terms (k, n) under weights (n,), a little stiffer, and their right side (k,)."""
    count, size = len(terms), len(depth)
    normal, right = np.zeros((count, count)), np.zeros(count)
    for j in range(count):
        total = 0.0
        for i in range(size):
            total += weights[i] * terms[j, i] * depth[i]
        right[j] = total
        for k in range(j + 1):
            total = 0.0
            for i in range(size):
                total += weights[i] * terms[j, i] * terms[k, i]
            normal[j, k], normal[k, j] = total, total
        normal[j, j] *= 1.0 + stiffening
    return normal, right


@kernel(LINES, LINE, "Array(bool, 1, 'C', True)", "boolean", *["float64"] * 5, "int64", "float64")
def reweighted(
    terms: Floats,
    depth: Floats,
    untouched: npt.NDArray[np.bool_],
    rises: bool,
    decay_std: float,
    correlated: float,
    prior: float,
    stiffening: float,
    least_rise: float,
    rounds: int,
    tolerance: float,
) -> tuple[Floats, float, Floats, Floats]:
    """Coefficients (k,) in mm, scale of the rest, normal equations (k, k), weights (n,), as `_reweighted_fit`."""
    count, size = len(terms), len(depth)
    weights, off, kept, solution = untouched.astype(np.float64), np.empty(size), np.empty(size), np.zeros(count)
    normal, scale = np.zeros((count, count)), 0.0
    for _ in range(rounds):
        normal, right = _equations(terms, depth, weights, stiffening)
        normal[-1, -1] += prior
        before, solution = solution, solved(normal, right)
        counted = 0
        for i in range(size):
            lies = -depth[i]
            for k in range(count):
                lies += solution[k] * terms[k, i]
            off[i] = lies * lies
            if untouched[i]:
                kept[counted] = off[i]
                counted += 1
        scale = MAD_TO_STD * nth(kept[:counted], counted // 2) ** 0.5 + 1e-12
        moved = 0.0
        for k in range(min(count, 3)):
            moved = max(moved, abs(solution[k] - before[k]))
        if moved < tolerance * scale:
            break
        if rises:
            prior = correlated * (scale / (decay_std * abs(solution[-2]) + scale * least_rise)) ** 2
        for i in range(size):
            weights[i] = 1.0 / (1.0 + off[i] / (3.0 * scale) ** 2) ** 2 if untouched[i] else 0.0
    return solution, scale, normal, weights


# Cells held against the light's law, of `inconsistent_light.py`, compiled.

Planes = npt.NDArray[np.float32]


@kernel(PLANES, PLANES, "Array(float32, 4, 'C', True)", "Array(int64, 2, 'C', True)", "float32[:, :, ::1]")
def off_law(change: Planes, slopes: Planes, answers: Planes, powers: npt.NDArray[np.int64], off: Planes) -> None:
    """What changes (3, h, w) are `off` the law of light, of `answers` (k, 3, h, w) to slopes (2, h, w)."""
    width = change.shape[2]
    p, q, light = (
        np.ones((5, width), np.float32),
        np.ones((5, width), np.float32),
        np.empty((3, width), np.float32),
    )
    for row in range(change.shape[1]):
        for n in range(1, 5):
            for i in range(width):
                p[n, i], q[n, i] = p[n - 1, i] * slopes[0, row, i], q[n - 1, i] * slopes[1, row, i]
        light[:] = np.float32(1.0)
        for k in range(powers.shape[0]):
            of_p, of_q = p[powers[k, 0]], q[powers[k, 1]]
            for c in range(3):
                answer, line = answers[k, c, row], light[c]
                for i in range(width):
                    line[i] += answer[i] * (of_p[i] * of_q[i])
        for c in range(3):
            for i in range(width):
                steep = np.sqrt(np.float32(1.0) + p[2, i] + q[2, i])
                off[c, row, i] = change[c, row, i] + np.float32(1.0) - light[c, i] / steep


@kernel(PLANES, PLANE, PLANES, "float32", "float32", "float32", "float32[:, ::1]", "float32[:, ::1]")
def against_law(
    off: Planes,
    size: Picture,
    noise_square: Planes,
    usual: float,
    limit: float,
    tiny: float,
    score: Picture,
    share: Picture,
) -> None:
    """Put in t over its `limit`, and the `share` of the change of colour, of `size`, that is not explained."""
    for row in range(size.shape[0]):
        for i in range(size.shape[1]):
            of_size = usual * size[row, i]
            square, length = np.float32(0.0), np.float32(0.0)
            for c in range(off.shape[0]):
                one = off[c, row, i] * off[c, row, i]
                square += one / (noise_square[c, row, i] + of_size * of_size)
                length += one
            score[row, i] = np.sqrt(square) / limit
            share[row, i] = np.sqrt(length) / (size[row, i] + tiny)
