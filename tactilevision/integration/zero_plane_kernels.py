"""The reweighted fit of `zero_plane.py`, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import LINE, LINES, kernel
from tactilevision.integration.circle_kernels import solved
from tactilevision.records import Floats
from tactilevision.robust import MAD_TO_STD


@kernel(LINES, LINE, "Array(bool, 1, 'C', True)", "boolean", "float64", "float64", "float64", "float64", "float64",
        "int64", "float64")  # fmt: skip
def reweighted(
    terms: Floats, depth: Floats, untouched: npt.NDArray[np.bool_], rises: bool, decay_std: float,
    correlated: float, prior: float, stiffening: float, least_rise: float, rounds: int, tolerance: float,
) -> tuple[Floats, float, Floats, Floats]:  # fmt: skip
    """Coefficients (k,), scale of what is left, normal equations (k, k) and weights (n,), as `_reweighted_fit`."""
    count, size = len(terms), len(depth)
    weights, off, solution = untouched.astype(np.float64), np.empty(size), np.zeros(count)
    normal, scale = np.zeros((count, count)), 0.0
    for _ in range(rounds):
        right = np.zeros(count)
        for j in range(count):
            part = weights * terms[j]
            right[j] = np.sum(part * depth)
            for k in range(j + 1):
                normal[j, k] = np.sum(part * terms[k])
                normal[k, j] = normal[j, k]
            normal[j, j] *= 1.0 + stiffening
        normal[-1, -1] += prior
        before, solution = solution, solved(normal, right)
        off[:] = -depth
        for k in range(count):
            off += solution[k] * terms[k]
        off *= off
        kept, middle = off[untouched], np.count_nonzero(untouched) // 2
        scale = MAD_TO_STD * np.partition(kept, middle)[middle] ** 0.5 + 1e-12
        moved = np.abs(solution - before)[:3].max()
        if moved < tolerance * scale:
            break
        if rises:
            prior = correlated * (scale / (decay_std * abs(solution[-2]) + scale * least_rise)) ** 2
        for i in range(size):
            weights[i] = 1.0 / (1.0 + off[i] / (3.0 * scale) ** 2) ** 2 if untouched[i] else 0.0
    return solution, scale, normal, weights
