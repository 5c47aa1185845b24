"""The reweighted fit of `zero_plane.py`, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINE, LINES, kernel
from tactilevision.compiled.parts import nth, solved
from tactilevision.records import Floats
from tactilevision.robust import MAD_TO_STD


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
