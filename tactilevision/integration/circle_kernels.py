"""Circles through places, and through the flanks of a rim, of `circle.py` and `circular_edges.py`, compiled."""

from __future__ import annotations

import numpy as np

from tactilevision.compiled import LINE, LINES, kernel
from tactilevision.compiled.parts import median, solved
from tactilevision.records import Floats
from tactilevision.robust import MAD_TO_STD

STIFFENING = 1e-9  # on the diagonal of normal equations, as circle.py has it


@kernel()
def _weighted(terms: Floats, values: Floats, weights: Floats) -> Floats:
    """Weighted least squares (3,) of values (n,) over terms (3, n)."""
    normal, right = STIFFENING * np.eye(3), np.zeros(3)
    for i in range(len(values)):
        for j in range(3):
            part = weights[i] * terms[j, i]
            right[j] += part * values[i]
            for k in range(3):
                normal[j, k] += part * terms[k, i]
    return solved(normal, right)


@kernel()
def _std(off: Floats) -> float:
    return MAD_TO_STD * median(np.abs(off)) + 1e-9


@kernel()
def _kept(off: Floats, width: float) -> Floats:
    """Geman and McClure's weights (n,), as robust.py has them."""
    return 1.0 / np.square(1.0 + np.square(off * (1.0 / width)))


@kernel(LINE, LINE, LINE)
def quick_circle(x: Floats, y: Floats, weight: Floats) -> tuple[float, float, float]:
    """Centre and radius of places (n,), in their unit, as `circle.quick_circle` has them."""
    terms, squares, keep = np.ones((3, len(x))), x * x + y * y, weight
    terms[0], terms[1] = x, y
    a, b, radius = 0.0, 0.0, 0.0
    for _ in range(2):
        a, b, c = _weighted(terms, squares, keep)
        radius = np.sqrt(max(c + 0.25 * (a * a + b * b), 1e-12))
        off = np.sqrt((x - 0.5 * a) ** 2 + (y - 0.5 * b) ** 2) - radius
        keep = weight * _kept(off, 2.0 * _std(off))
    return 0.5 * a, 0.5 * b, radius


@kernel(LINE, LINES, LINE)
def flanks(places: Floats, profiles: Floats, parts: Floats) -> Floats:
    """Places (K,) where profiles (K, J) fall to `parts` (K,) of their peak, inwards from it, in mm; or NaN."""
    out = np.full(len(profiles), np.nan)
    for k in range(len(profiles)):
        line, top = profiles[k], -1
        for i in range(len(line)):
            if not np.isnan(line[i]) and (top < 0 or line[i] > line[top]):
                top = i
        for i in range(top - 1, -1, -1):
            level = parts[k] * line[top]
            if line[i] < level:
                share = (level - line[i]) / (line[i + 1] - line[i])
                out[k] = places[i] + share * (places[1] - places[0])
                break
    return out


@kernel(LINE, LINES, "float64", "int64")
def harmonics(places: Floats, terms: Floats, tolerance: float, rounds: int) -> tuple[Floats, float, float]:
    """Mean, cos and sin part (3,) of places (n,) over terms (3, n), spread and rms of the rest, robust, in mm."""
    off, solution = places - median(places), np.zeros(3)
    scale = _std(off)
    for _ in range(rounds):
        before, solution = solution, _weighted(terms, places, _kept(off, 2.0 * scale))
        off = places - (solution[0] * terms[0] + solution[1] * terms[1] + solution[2] * terms[2])
        scale = _std(off)
        if np.abs(solution - before).max() < tolerance * scale:
            break
    return solution, scale, np.sqrt(np.mean(off * off))
