"""Bounded non-linear least squares, scaled by the caller's own units and begun from several places.

Certified on the NIST StRD problems.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.records import Bools, Floats

Residual = Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True)
class Minimum:
    """Where the sum of squares is least: `values` (p,), `residual` (n,), `jacobian` (n, p), `at_bound` (p,)."""

    values: Floats
    residual: Floats
    jacobian: Floats
    at_bound: Bools
    evaluations: int

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residual @ self.residual)


@dataclass(frozen=True, slots=True)
class Box:
    """Bounds `low`, `high` and typical sizes `scale` of the parameters, (p,) each."""

    low: Floats
    high: Floats
    scale: Floats


QUICK = 1e-7  # a tolerance at or above this is content with one-sided derivatives
MAX_STEPS = 80  # of one descent: of 600 in recordings with several effects 1 % take more, and creep along a bound
MAX_RESTARTS = 4  # times that a descent begins anew from where it was, off its bounds, where it creeps no more


def minimise(
    residual: Residual, starts: Floats, *, box: Box, tolerance: float = 1e-10, settled: bool = True
) -> Minimum:
    """The best of the minima reached from `starts` (s, p), which are moved inside the box.

    A tolerance of QUICK or more halves the work: enough to rank models, not to certify digits. So are several
    starts ranked, and the best alone goes on to the last digits. Where it need not be `settled`, the last place of
    a descent that creeps on at a kink is taken for one.

    Raises ConvergenceError where no start leads to a minimum, InputError where a start gives no finite residual.
    """
    places, quick = np.atleast_2d(starts), tolerance
    if len(places) > 1:
        quick = max(tolerance, QUICK)
    tried = [_descend(residual, _inside(start, box), box, quick, settled) for start in places]
    best = min((one for one in tried if one is not None), key=lambda one: one.chi2, default=None)
    if best is not None and quick > tolerance:
        best = _descend(residual, _inside(best.values, box), box, tolerance, settled) or best
    if best is None:
        raise ConvergenceError(f"least squares found no minimum from {len(places)} starts")
    return best


def differentiate(residual: Residual, values: Floats, *, box: Box) -> Floats:
    """Jacobian (n, p), residual per unit of each value (p,): central differences, one-sided near a bound."""
    step = 6e-6 * np.maximum(np.abs(values), box.scale)  # cube root of the machine epsilon
    columns = []
    for k, size in enumerate(step):
        high, low = values.copy(), values.copy()
        high[k], low[k] = min(values[k] + size, box.high[k]), max(values[k] - size, box.low[k])
        columns.append((residual(high) - residual(low)) / (high[k] - low[k]))
    return np.column_stack(columns)


def _one_sided(residual: Residual, values: Floats, box: Box) -> Floats:
    """Jacobian (n, p) by forward differences, backward at the upper bound."""
    here = residual(values)
    columns = []
    for k, size in enumerate(1e-6 * np.maximum(np.abs(values), box.scale)):
        moved = values.copy()
        moved[k] += size if values[k] + size <= box.high[k] else -size
        columns.append((residual(moved) - here) / (moved[k] - values[k]))
    return np.column_stack(columns)


def _descend(residual: Residual, start: Floats, box: Box, tolerance: float, settled: bool) -> Minimum | None:
    from scipy.optimize import least_squares

    if not np.isfinite(residual(start)).all():
        raise InputError(
            "the model gives no finite force at a starting point", where="minimise", value=start.tolist()
        )

    def slope(values: Floats) -> Floats:
        if tolerance >= QUICK:
            return _one_sided(residual, values, box)
        return differentiate(residual, values, box=box)

    solve = partial(
        least_squares,
        residual,
        jac=slope,
        bounds=(box.low, box.high),
        x_scale=box.scale,
        xtol=tolerance,
        ftol=tolerance,
        gtol=1e-14,
        max_nfev=MAX_STEPS,
    )
    solution = solve(start)
    for _ in range(MAX_RESTARTS):
        if solution.status:
            break
        solution = solve(_inside(solution.x, box))
    if (settled and solution.status <= 0) or not np.isfinite(solution.fun).all():
        return None
    near = 1e-6 * box.scale
    at_bound = (solution.x - box.low < near) | (box.high - solution.x < near)
    found = Minimum(
        np.asarray(solution.x), np.asarray(solution.fun), np.asarray(solution.jac), at_bound, int(solution.nfev)
    )
    return found if at_bound.any() or tolerance >= QUICK else _polish(residual, found, box)


def _polish(residual: Residual, found: Minimum, box: Box) -> Minimum:
    """One Gauss-Newton step by orthogonal factors: the last digits of an ill-conditioned problem."""
    size = np.linalg.norm(found.jacobian, axis=0)
    if not (size > 0).all():
        return found
    step = np.linalg.lstsq(found.jacobian / size, -found.residual, rcond=None)[0] / size
    values = found.values + step
    if not ((values > box.low) & (values < box.high)).all():
        return found
    better = residual(values)
    slack = 1e-9 * found.chi2  # the sum of squares itself is only known to rounding
    if not float(better @ better) <= found.chi2 + slack:
        return found
    return Minimum(values, better, differentiate(residual, values, box=box), found.at_bound, found.evaluations + 1)


def _inside(start: Floats, box: Box) -> Floats:
    """A little off the bounds, where a bounded search may begin."""
    room = np.minimum(1e-3 * box.scale, 0.25 * (box.high - box.low))
    return np.clip(start, box.low + room, box.high - room)
