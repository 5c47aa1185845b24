"""The circle through places some of which are not its own: quickly for every frame, or as well as can be.

`quick_circle` is the weighted algebraic fit, two rounds of it, linear in its unknowns; it is good to a part of a
pixel where the places lie about all of the circle. `fit_circle` is the geometric one, with its deviation:

    minimise  sum_i w_i rho( |p_i - c| - R )        rho: Tukey's biweight, its scale from the residuals

RANSAC (Fischler & Bolles, Comm. ACM 24 (1981) 381) finds the circle that most points agree on, whatever the
others do; the weighted geometric (orthogonal distance) fit then refines it. Units: mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.compiled import compiled
from tactilevision.records import Floats, Pair
from tactilevision.robust import frame_mad_std, geman_mcclure_weight, mad_std, tukey_weight

TRIALS = 200  # circles through three points: with half of all points wild none is good once in 4e11, 1/(7/8)^200
STIFFENING = 1e-9 * np.eye(3)  # added to normal equations that one direction may leave open


@dataclass(frozen=True, slots=True)
class Circle:
    """Centre (x, y) and radius, standard deviation of either, rms distance of the kept points, share kept."""

    centre_mm: Pair
    radius_mm: float
    centre_std_mm: float
    radius_std_mm: float
    residual_mm: float
    kept: float


def fit_circle(
    points_mm: Floats, *, start: tuple[Pair, float], scale_mm: float, independent: float
) -> Circle | None:
    """Robust circle through points (N, 2) from a start (centre, radius).

    `scale_mm` is what a point may be off at best (a fraction of a pixel); `independent` the number of points
    that err independently, since neighbours on an edge err together. None where fewer than half of
    the points agree on a circle.
    """
    if len(points_mm) < 8:
        return None
    begin = _consensus(points_mm, start, scale_mm)
    centre, radius, weights = _refine(points_mm, begin, scale_mm)
    inside = weights > 0
    if inside.mean() < 0.5:
        return None
    jacobian, residual = _linearised(points_mm, centre, radius)
    rms = float(np.sqrt(np.average(residual**2, weights=weights)))
    information = (jacobian * weights[:, None]).T @ jacobian * min(independent / len(points_mm), 1.0)
    variance = _inverse_diagonal(information) * max(rms, 0.1 * scale_mm) ** 2
    return Circle(
        (float(centre[0]), float(centre[1])),
        radius,
        float(np.sqrt(variance[:2].max())),
        float(np.sqrt(variance[2])),
        rms,
        float(inside.mean()),
    )


def _consensus(points: Floats, start: tuple[Pair, float], scale_mm: float) -> tuple[Floats, float]:
    """The circle through three points that most others lie on; the start, where no three points agree better.

    Three points p, p + b, p + c lie on the circle round p + u, 2 [b; c] u = [b b; c c].
    """
    tolerance, start_radius = 3 * scale_mm, start[1]
    rng = np.random.default_rng(len(points))  # a draw that repeats: the same points give the same circle
    first, b, c = points[rng.integers(0, len(points), (3, TRIALS))]
    b, c = b - first, c - first
    twice = 2.0 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    well_spread = np.abs(twice) > 1e-9 * start_radius**2
    first, b, c, twice = first[well_spread], b[well_spread], c[well_spread], twice[well_spread, None]
    square_b, square_c = (np.sum(side**2, axis=1) for side in (b, c))
    to_centre = (
        np.stack([c[:, 1] * square_b - b[:, 1] * square_c, b[:, 0] * square_c - c[:, 0] * square_b], axis=1)
        / twice
    )
    radii = np.hypot(*to_centre.T)
    likely = (0.3 * start_radius < radii) & (radii < 3 * start_radius)
    centres = np.concatenate([np.asarray(start[0], np.float64)[None], (first + to_centre)[likely]])
    radii = np.concatenate([[start_radius], radii[likely]])
    distance = np.hypot(*(points.T[:, None] - centres.T[..., None]))
    best = int(np.argmax(np.count_nonzero(np.abs(distance - radii[:, None]) < tolerance, axis=1)))
    return centres[best], float(radii[best])


def _refine(points: Floats, start: tuple[Floats, float], scale_mm: float) -> tuple[Floats, float, Floats]:
    centre, radius = np.array(start[0], dtype=np.float64), start[1]
    weights = np.ones(len(points))
    for _ in range(20):
        jacobian, residual = _linearised(points, centre, radius)
        weights = _tukey(residual, scale_mm)
        step, *_ = np.linalg.lstsq(jacobian * weights[:, None] ** 0.5, -residual * weights**0.5, rcond=None)
        centre, radius = centre + step[:2], radius + float(step[2])
        if np.abs(step).max() < 1e-6 * radius:
            break
    return centre, radius, weights


def _linearised(points: Floats, centre: Floats, radius: float) -> tuple[Floats, Floats]:
    offset = points - centre
    distance = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-9)
    return np.c_[-offset / distance[:, None], -np.ones(len(points))], distance - radius


def _inverse_diagonal(information: Floats) -> Floats:
    """Of a matrix (k, k) >= 0. A short arc leaves centre and radius open together: very large, never below 0."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(vectors**2 @ (1 / np.maximum(values, np.finfo(float).eps * values[-1])))


def _tukey(residual: Floats, scale_mm: float) -> Floats:
    spread = max(mad_std(residual, centre=0.0), 0.5 * scale_mm)
    return tukey_weight(residual, spread)


def quick_circle(x: Floats, y: Floats, *, weight: Floats) -> tuple[float, float, float]:
    """Centre x, y and radius, in mm or px as the places (n,) are, robust to what lies off the circle.

    minimise  sum w (x^2 + y^2 - a x - b y - c)^2      `weight` (n,) w, then times that of Geman & McClure

    Source: Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8.
    """
    if compiled():
        from tactilevision.integration.circle_kernels import quick_circle as quickly

        return quickly(x, y, weight)
    terms, squares = np.stack([x, y, np.ones_like(x)]), x * x + y * y
    keep = weight
    for _ in range(2):
        a, b, c = weighted_solution(terms, squares, weights=keep)
        radius = float(np.sqrt(max(c + 0.25 * (a * a + b * b), 1e-12)))
        off = np.sqrt((x - 0.5 * a) ** 2 + (y - 0.5 * b) ** 2) - radius
        keep = weight * geman_mcclure_weight(off, 2.0 * residual_std(off))
    return 0.5 * float(a), 0.5 * float(b), radius


def weighted_solution(terms: Floats, values: Floats, *, weights: Floats) -> Floats:
    """Weighted least squares (3,) of values (n,) over terms (3, n), in their unit."""
    weighted = terms * weights
    normal = weighted @ terms.T + STIFFENING
    return solved(normal, weighted @ values)


def solved(normal: Floats, right: Floats) -> Floats:
    """The solution (k,) of normal equations (k, k) x = right (k,), in their unit.

    They must be positive definite.
    """
    return np.asarray(cv2.solve(normal, right[:, None], flags=cv2.DECOMP_CHOLESKY)[1][:, 0])


def residual_std(off: Floats) -> float:
    """Robust deviation of residuals (n,) about 0, in their unit; never 0."""
    return frame_mad_std(off, centre=0.0) + 1e-9
