"""Slopes to depth: the least-squares surface of a field of slopes, with its borders free.

Unknown: the depth z at the pixels. The slopes p = dz/dx, q = dz/dy are known at the pixels too, so each is
averaged onto the half-pixel edge between two neighbours, where the difference of their depths lives:

    minimise  sum_edges w_e [ (z_(i+1) - z_i)/d - (p_i + p_(i+1))/2 ]^2      d: mm per pixel, per axis

With w = 1 the normal equations are a 5-point Laplacian with natural (Neumann) borders, which cosine transforms
solve (`dct_poisson.py`). The solution is exact for the scheme: a plane, a tilt and a paraboloid come back to
rounding error. The error on a smooth surface falls with the square of the pixel. The mean of the surface is left
at 0 (the slopes do not know it); `tactilevision.integration.zero_plane` finds the untouched gel.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.integration.dct_poisson import transform_solver
from tactilevision.integration.dirichlet_poisson import integrate_dirichlet
from tactilevision.records import Pair, SlopeMap

Array = npt.NDArray[np.floating[Any]]
FLOOR = 1e-4  # weight of an edge that is not known: it only keeps an island's level from floating


def integrate(
    slopes: SlopeMap,
    mm_per_px: Pair,
    *,
    weights: Array | None = None,
    tolerance: float = 1e-6,
    border: Literal["free", "flat"] = "free",
) -> Array:
    """Depth (H, W) in mm of `slopes`, its mean 0; float32 slopes are integrated in float32, others in float64.

    `weights` (H, W) in [0, 1] says how far each pixel's slopes are to be trusted (0: not at all; the surface is
    then carried over from the other pixels); None trusts all alike, which is one pair of cosine transforms.
    Pixels outside `slopes.valid`, or not finite, count as weight 0. `tolerance` is the relative residual
    at which the weighted solution stops. `border="flat"`: the outermost pixels are known to lie at depth 0, and
    slopes everywhere (`dirichlet_poisson.py`).
    Raises InputError on shapes that do not match, ConvergenceError where the weighted solution does not settle.
    """
    dz_dx, dz_dy = _checked(slopes)
    if border == "flat":
        return integrate_dirichlet(slopes, mm_per_px)
    known = None if slopes.valid is None and weights is None else _known(slopes)
    if known is None and weights is None:
        solver = transform_solver(dz_dx.shape, mm_per_px, dz_dx.dtype.char)
        with np.errstate(invalid="ignore"):
            depth = solver.solve(solver.divergence(dz_dx, dz_dy))
        if np.isfinite(depth[0, 0]):  # one slope that is not finite leaves no depth finite
            return depth
        known = _known(slopes)
    trust = np.ones(dz_dx.shape) if weights is None else np.clip(np.asarray(weights, dtype=np.float64), 0.0, 1.0)
    if trust.shape != dz_dx.shape:
        raise InputError("weights have the shape of the slopes", where="integrate", value=trust.shape)
    if known is not None:
        trust = np.where(known, trust, 0.0)
        dz_dx, dz_dy = np.where(known, dz_dx, 0.0), np.where(known, dz_dy, 0.0)
    return weighted(dz_dx, dz_dy, weights=trust, mm_per_px=mm_per_px, tolerance=tolerance).astype(
        slopes.dz_dx.dtype
    )


def divergence(x_edges: Array, y_edges: Array, mm_per_px: Pair) -> Array:
    """Divergence (H, W) of `x_edges` (H, W-1) and `y_edges` (H-1, W): minus the adjoint of `gradient`.

    No flow crosses the border, so the divergence sums to 0.
    """
    out = np.zeros((x_edges.shape[0], y_edges.shape[1]), dtype=x_edges.dtype)
    along_x, along_y = x_edges / mm_per_px[0], y_edges / mm_per_px[1]
    out[:, :-1] += along_x
    out[:, 1:] -= along_x
    out[:-1] += along_y
    out[1:] -= along_y
    return out


def gradient(depth: Array, mm_per_px: Pair) -> tuple[Array, Array]:
    """Differences of `depth` (H, W) over the edges: (H, W-1) along x and (H-1, W) along y, mm per mm."""
    return np.diff(depth, axis=1) / mm_per_px[0], np.diff(depth, axis=0) / mm_per_px[1]


def weighted(
    dz_dx: Array,
    dz_dy: Array,
    *,
    weights: Array,
    mm_per_px: Pair,
    tolerance: float = 1e-6,
    max_iterations: int = 500,
) -> Array:
    """The weighted least-squares surface (H, W), mean 0, by conjugate gradients behind the exact transform.

    An edge's weight is the smaller of its two pixels', at least FLOOR. Preconditioned by the unweighted
    solution the spectrum lies in [FLOOR, 1], gathered at both ends, so that tens of iterations do.
    """
    weights = np.asarray(weights, dtype=np.float64)
    w_x, w_y = np.minimum(weights[:, 1:], weights[:, :-1]), np.minimum(weights[1:], weights[:-1])
    target_x = np.where(w_x > 0, 0.5 * (dz_dx[:, 1:] + dz_dx[:, :-1]), 0.0)  # unknown: stretched like a membrane
    target_y = np.where(w_y > 0, 0.5 * (dz_dy[1:] + dz_dy[:-1]), 0.0)
    w_x, w_y = np.maximum(w_x, FLOOR), np.maximum(w_y, FLOOR)
    return solve_edges(
        target_x,
        target_y,
        w_x=w_x,
        w_y=w_y,
        mm_per_px=mm_per_px,
        tolerance=tolerance,
        max_iterations=max_iterations,
    )


def solve_edges(
    target_x: Array,
    target_y: Array,
    *,
    w_x: Array,
    w_y: Array,
    mm_per_px: Pair,
    tolerance: float = 1e-6,
    max_iterations: int = 500,
    start: Array | None = None,
) -> Array:
    """Depth whose differences are nearest to the targets (H, W-1), (H-1, W) under the weights of the edges."""
    solver = transform_solver((target_x.shape[0], target_y.shape[1]), mm_per_px, "d")

    def stiffness(depth: Array) -> Array:
        g_x, g_y = gradient(depth, mm_per_px)
        return -divergence(w_x * g_x, w_y * g_y, mm_per_px)

    right = -divergence(w_x * target_x, w_y * target_y, mm_per_px)
    depth: Array = np.zeros_like(right) if start is None else np.array(start, dtype=np.float64)
    residual = right - stiffness(depth) if start is not None else right.copy()
    step = solver.solve(-residual)
    goal = tolerance**2 * abs(float(np.vdot(right, solver.solve(-right))))
    energy, direction = float(np.vdot(residual, step)), step
    for _ in range(max_iterations):
        if energy <= goal:
            return np.asarray(depth - depth.mean())
        pushed = stiffness(direction)
        length = energy / float(np.vdot(direction, pushed))
        depth = depth + length * direction
        residual = residual - length * pushed
        step = solver.solve(-residual)
        before, energy = energy, float(np.vdot(residual, step))
        direction = step + (energy / before) * direction
    raise ConvergenceError(
        f"weighted integration stopped after {max_iterations} iterations at a relative residual of "
        f"{np.sqrt(energy / goal) * tolerance:.1e}, {tolerance:.1e} was asked for"
    )


def _known(slopes: SlopeMap) -> npt.NDArray[np.bool_] | None:
    finite = np.isfinite(slopes.dz_dx) & np.isfinite(slopes.dz_dy)
    known = finite if slopes.valid is None else finite & slopes.valid
    return None if known.all() else known


def _checked(slopes: SlopeMap) -> tuple[Array, Array]:
    shape = slopes.dz_dx.shape
    if len(shape) != 2 or slopes.dz_dy.shape != shape or min(shape) < 2:
        raise InputError(
            "slopes are two fields (H, W) alike, at least 2 by 2",
            where="integrate",
            value=(shape, slopes.dz_dy.shape),
        )
    if slopes.dz_dx.dtype == np.float32 and slopes.dz_dy.dtype == np.float32:
        return slopes.dz_dx, slopes.dz_dy
    return np.asarray(slopes.dz_dx, dtype=np.float64), np.asarray(slopes.dz_dy, dtype=np.float64)
