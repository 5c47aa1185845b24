"""Small parts of many kernels: medians as in `tactilevision/robust.py`, and normal equations solved.

numba sees a change of a kernel's own file alone: after one here, delete what it kept (`__pycache__/*.nbi`).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import kernel

Floats = npt.NDArray[np.float64]
SINGULAR = 2.0**-52  # a pivot below it leaves normal equations without a solution, as OpenCV has it


@kernel()
def nth(values: Floats, n: int) -> float:
    """Of values (n,), left in part in order (Hoare), that which has `n` in front of it, in their unit."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if n <= j:
            high = j
        elif n >= i:
            low = i
        else:
            break
    return values[n]


@kernel()
def median(values: Floats) -> float:
    """The median of values (n,), at least one, none NaN, in their unit."""
    ordered, half = values.copy(), len(values) // 2
    upper = nth(ordered, half)
    if len(values) % 2:
        return upper
    lower = ordered[0]
    for i in range(1, half):
        lower = max(lower, ordered[i])
    return 0.5 * (lower + upper)


@kernel()
def solved(normal: Floats, right: Floats) -> Floats:
    """The solution (k,) of normal equations (k, k), by Cholesky, in their unit; 0 where they are singular."""
    count, low, x = len(right), np.zeros(normal.shape), right.copy()
    for i in range(count):
        for j in range(i + 1):
            left = normal[i, j]
            for k in range(j):
                left -= low[i, k] * low[j, k]
            if i > j:
                low[i, j] = left / low[j, j]
            elif left < SINGULAR:
                return np.zeros(count)
            else:
                low[i, i] = np.sqrt(left)
    for i in range(count):
        for k in range(i):
            x[i] -= low[i, k] * x[k]
        x[i] /= low[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            x[i] -= low[k, i] * x[k]
        x[i] /= low[i, i]
    return x
