"""Fit a model to measurements by whitened, bounded least squares with priors.

    minimise |W (y - f(theta))|^2 + sum ((theta_k - mean_k) / std_k)^2,    covariance (J^T J)^-1

The noise is estimated from the residuals of the first fit, and the fit repeated with it. Intervals use Student's t
with the degrees of freedom of the noise. The covariance is the curvature at the minimum, linear in the data's
error. The minimiser is certified on the NIST StRD problems.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from calibration.fit.tolerances import TOLERANCES, with_tolerances
from calibration.inputs.observations import TYPICAL_GAIN, TYPICAL_ZERO_MM, Observations
from calibration.model.composition import Model
from calibration.model.stages import Parameter
from calibration.noise.model import Linear, Noise, Whitener, base_noise
from calibration.noise.reml import UNKNOWN_SHARE, estimate_noise
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.records.constants import MICRO, NONZERO, TAILS95, TINY
from tactilevision.records.measured import Bools, Estimate, Floats

Residual = Callable[[Floats], Floats]
Linearised = Callable[[Floats], tuple[Floats, Floats]]
ROOT = 6e-6  # cube root of the machine epsilon: step of central differences
FINE = 1e-10  # tolerance of a minimum
QUICK = 1e-7  # tolerance from which one-sided derivatives suffice
MAX_STEPS = 80  # of one descent: of 600 in recordings with several effects 1 % take more
MAX_RESTARTS = 4  # of a descent from its last place, off its bounds
TOO_FEW = (
    "there are no more measurements than parameters and no noise is stated: the intervals rest on an assumed "
    "noise of 2 % of the largest force"
)
MAX_ITERATIONS = 3  # fit, noise, fit, noise, fit: more change nothing at the sixth digit


@dataclass(frozen=True, slots=True)
class Minimum:
    """Minimum of the sum of squares: `values` (p,), `residual` (n,), `jacobian` (n, p), `at_bound` (p,)."""

    values: Floats
    residual: Floats
    jacobian: Floats
    at_bound: Bools

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


def box_of(parameters: Sequence[Parameter]) -> Box:
    """Return the bounds and scales of the parameters that are not fixed."""
    free = [p for p in parameters if not p.fixed]
    low, high = (np.array([p.bounds[side] for p in free]) for side in (0, 1))
    return Box(low, high, np.array([p.scale for p in free]))


def minimise(
    linear: Linearised, starts: Floats, *, box: Box, tolerance: float = FINE, settled: bool = True
) -> Minimum:
    """Return the best of the minima reached from `starts` (s, p), which are moved inside the box.

    `linear` returns the residual (n,) and its Jacobian (n, p) at values (p,).
    Several starts are ranked at a tolerance of QUICK, which halves the work, and the best is refined to
    `tolerance`. Without `settled` the last place of a descent that has not converged (at a kink) is accepted.
    Raises ConvergenceError where no start leads to a minimum, InputError where a start gives no finite residual.
    """
    places, quick = np.atleast_2d(starts), tolerance
    if len(places) > 1:
        quick = max(tolerance, QUICK)

    at = lru_cache(maxsize=1)(lambda place: linear(np.frombuffer(place)))  # a search asks for one, then the other

    def descend(start: Floats, least: float) -> Minimum | None:
        of: tuple[Residual, Residual] = (lambda x: at(x.tobytes())[0], lambda x: at(x.tobytes())[1])
        return _descend(*of, _inside(start, box), box=box, tolerance=least, settled=settled)

    tried = [descend(start, quick) for start in places]
    best = min((one for one in tried if one is not None), key=lambda one: one.chi2, default=None)
    if best is not None and quick > tolerance:
        best = descend(best.values, tolerance) or best
    if best is None:
        raise ConvergenceError(f"least squares found no minimum from {len(places)} starts")
    return best


def by_differences(residual: Residual, box: Box) -> Linearised:
    """Return the function of `minimise` whose Jacobian is that of differences."""
    return lambda values: (residual(values), differentiate(residual, values, box=box))


def differentiate(residual: Residual, values: Floats, *, box: Box) -> Floats:
    """Return the Jacobian (n, p) of the residual per parameter, by central differences, one-sided at a bound."""
    columns = []
    for k, size in enumerate(ROOT * np.maximum(np.abs(values), box.scale)):
        high, low = values.copy(), values.copy()
        high[k], low[k] = min(values[k] + size, box.high[k]), max(values[k] - size, box.low[k])
        columns.append((residual(high) - residual(low)) / (high[k] - low[k]))
    return np.column_stack(columns)


def _descend(
    residual: Residual, slopes: Residual, start: Floats, *, box: Box, tolerance: float, settled: bool
) -> Minimum | None:
    from scipy.optimize import least_squares

    if not np.isfinite(residual(start)).all():
        raise InputError(
            "the model gives no finite force at a starting point", where="minimise", value=start.tolist()
        )

    solve = partial(
        least_squares,
        residual,
        jac=slopes,
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
    near = MICRO * box.scale
    at_bound = (solution.x - box.low < near) | (box.high - solution.x < near)
    found = Minimum(np.asarray(solution.x), np.asarray(solution.fun), np.asarray(solution.jac), at_bound)
    return found if at_bound.any() or tolerance >= QUICK else _polish(residual, slopes, found, box=box)


def _polish(residual: Residual, slopes: Residual, found: Minimum, *, box: Box) -> Minimum:
    """Refine a minimum by one Gauss-Newton step by orthogonal factors, for ill-conditioned problems."""
    size = np.linalg.norm(found.jacobian, axis=0)
    if not (size > 0).all():
        return found
    step = np.linalg.lstsq(found.jacobian / size, -found.residual, rcond=None)[0] / size
    values = found.values + step
    if not ((values > box.low) & (values < box.high)).all():
        return found
    better = residual(values)
    if not float(better @ better) <= (1 + TINY) * found.chi2:  # known to rounding only
        return found
    return Minimum(values, better, slopes(values), found.at_bound)


def _inside(start: Floats, box: Box) -> Floats:
    """Return the start moved a little off the bounds."""
    room = np.minimum(1e-3 * box.scale, (box.high - box.low) / 4)
    return np.clip(start, box.low + room, box.high - room)


class Parametrised:
    """What follows from a table of parameters, some of them fixed, some with priors."""

    __slots__ = ()
    parameters: tuple[Parameter, ...]

    @property
    def free(self) -> Bools:
        """Which parameters are fitted (p,)."""
        return np.array([not p.fixed for p in self.parameters])

    @property
    def prior_weight(self) -> Floats:
        """1/std of each parameter's prior (p,); 0 without one."""
        return np.array([0.0 if p.prior is None else 1 / p.prior.std for p in self.parameters])


def prior_pulls(values: Floats, parameters: Sequence[Parameter]) -> Floats:
    """Return (value - mean)/std, dimensionless, for each prior (k,) of a parameter (p,) that is not fixed."""
    pairs = zip(values, parameters, strict=True)
    table = [(v - p.prior.mean) / p.prior.std for v, p in pairs if p.prior is not None and not p.fixed]
    return np.array(table, dtype=float)


@dataclass(frozen=True, slots=True, eq=False)
class Fit(Parametrised):
    """Fit of a model to data.

    `values` (p,) in the order of `parameters`; `covariance` (p, p), 0 for fixed ones; `force_N` (N,) of the model,
    `residual_N` measured less model, `white` the whitened residual; `jacobian` (N, p) of the force; `noise` with
    the linearisation `about` at which it applies; `chi2` includes the priors; `at_bound` (p,).
    """

    model: Model
    data: Observations
    parameters: tuple[Parameter, ...]
    values: Floats
    covariance: Floats
    force_N: Floats
    residual_N: Floats
    white: Floats
    jacobian: Floats
    noise: Noise
    about: Linear
    chi2: float
    at_bound: Bools
    warnings: tuple[str, ...] = ()

    @property
    def whitener(self) -> Whitener:
        """Whitener of its noise."""
        return Whitener(self.data, self.noise, self.about)

    @property
    def problem(self) -> Problem:
        """The problem that it is a minimum of, under its own noise and linearisation."""
        return Problem(self.model, self.data, self.parameters, self.whitener)

    @property
    def dof(self) -> float:
        """Samples less fitted parameters, each prior counting as a sample; may be 0."""
        priors = sum(p.prior is not None and not p.fixed for p in self.parameters)
        return float(self.data.size + priors - np.count_nonzero(self.free))

    @property
    def rms_error_N(self) -> float:
        """Root mean square of measured less model."""
        return float(np.sqrt(np.mean(self.residual_N**2)))

    def index(self, name: str) -> int:
        """Return the index of a parameter. Raises InputError for an unknown name."""
        names = [p.name for p in self.parameters]
        if name not in names:
            remedy = f"It has {', '.join(names)}."
            raise InputError("the model has no such parameter", where=self.model.name, value=name, remedy=remedy)
        return names.index(name)

    def std(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        k = self.index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def reach(self, gradient: Floats) -> float:
        """Return the half width of a 95 % interval of a linear function of the parameters, over its std.

        Only the noise's part of the variance has few degrees of freedom; a prior's is exact (Satterthwaite,
        Biometrics 2 (1946) 110).
        """
        with np.errstate(over="ignore"):  # a parameter that the data do not determine
            whole = float(gradient @ self.covariance @ gradient)
        if not np.isfinite(whole):
            return quantile95(self.noise.dof)
        weight = self.prior_weight
        known = weight > 0  # without a prior a parameter may be unknown
        stated = float(np.sum((weight[known] * (self.covariance @ gradient)[known]) ** 2))
        share = (whole - stated) / whole if whole > 0 else 1.0
        return quantile95(self.noise.dof / max(share, MICRO) ** 2)

    def estimate(self, name: str) -> Estimate:
        """Return a parameter with its std and 95 % interval, neither of them wider than the bounds."""
        k = self.index(name)
        parameter, value, std = self.parameters[k], float(self.values[k]), self.std(name)
        reach = self.reach(np.eye(self.values.size)[k]) * std
        low, high = np.clip([value - reach, value + reach], *parameter.bounds)
        within = min(std, parameter.bounds[1] - parameter.bounds[0])
        return Estimate(value, within, (float(low), float(high)), parameter.unit)


def r_squared(measured: Floats, modelled: Floats) -> float:
    """Return 1 less the residual over the total sum of squares of values (n,) in any unit; NaN for a constant."""
    total = float(np.sum((measured - measured.mean()) ** 2))
    return 1 - float(np.sum((measured - modelled) ** 2)) / total if total > 0 else float("nan")


def quantile95(dof: float) -> float:
    """Return Student's two-sided 95 % quantile, for one degree of freedom at least."""
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(max(dof, 1.0), TAILS95[1]) if np.isfinite(dof) else ndtri(TAILS95[1]))


def fit(
    model: Model,
    data: Observations,
    *,
    noise: Noise | None = None,
    starts: Floats | None = None,
    tolerances: bool = True,
    ftol: float = FINE,
) -> Fit:
    """Fit `model` to `data`; the noise is estimated unless given.

    `starts` (s, p) replaces the model's own; `ftol` is the tolerance of its last minimum. Raises InputError for
    more free parameters than the data can carry.
    """
    whole = with_tolerances(model, data) if tolerances else model
    parameters = whole.parameters(data)
    points = _starts(whole, data) if starts is None else np.atleast_2d(starts)
    start = points[0]
    about, stated = linearise(whole, start, data=data)
    current = noise or first_noise(data, about, stated=stated)
    turns = MAX_ITERATIONS if noise is None else 2
    for turn in range(turns):
        problem = Problem(whole, data, parameters, Whitener(data, current, about))
        found = problem.solve(points, tolerance=ftol if turn == turns - 1 else QUICK)
        values = problem.full(found.values)
        about, stated = linearise(whole, values, data=data)
        points = values[None]
        if noise is None and turn < MAX_ITERATIONS - 1:
            current = _noise_of(problem, values, about, stated)
    fitted = finish(problem, found, current, about)
    return replace(fitted, warnings=(TOO_FEW,)) if fitted.dof < 1 and not stated else fitted


def fit_again(
    fitted: Fit, *, data: Observations | None = None, noise: Noise | None = None, ftol: float = FINE
) -> Fit:
    """Refit the same model, starting from its values, to other data or with another noise."""
    data, noise, starts = data or fitted.data, noise or fitted.noise, fitted.values[None]
    return fit(fitted.model, data, noise=noise, starts=starts, tolerances=False, ftol=ftol)


def linearise(model: Model, values: Floats, *, data: Observations) -> tuple[Linear, bool]:
    """Return force (N,) in N, slope (N,) in N/mm and noise (N,) at parameters (p,); whether noise was stated."""
    slope = model.slope(values, data)
    base, stated = base_noise(data, slope)
    return Linear(model.predict(values, data), slope, base), stated


def first_noise(data: Observations, about: Linear, *, stated: bool) -> Noise:
    """Return the noise assumed before there is a residual."""
    scale = 1.0 if stated else UNKNOWN_SHARE * float(np.max(np.abs(data.normal_N)))
    shared = data.is_curves
    return Noise(scale, TYPICAL_GAIN if shared else 0.0, TYPICAL_ZERO_MM if shared else 0.0, stated=stated)


@dataclass(frozen=True, slots=True)
class Problem(Parametrised):
    """Least-squares problem of a model, data and a whitener; `carried_N` (N,) is added to the forces."""

    model: Model
    data: Observations
    parameters: tuple[Parameter, ...]
    whitener: Whitener
    carried_N: Floats | float = 0.0

    @property
    def box(self) -> Box:
        """Bounds and scales of the free parameters."""
        return box_of(self.parameters)

    def full(self, free_values: Floats) -> Floats:
        """Return all values from the free ones."""
        values = np.array([p.default for p in self.parameters])
        values[self.free] = free_values
        return values

    def residual(self, free_values: Floats) -> Floats:
        """Return the residual (n,) alone, in standard deviations."""
        return self.linear(free_values)[0]

    def solve(self, starts: Floats, *, tolerance: float = FINE) -> Minimum:
        """Return the best minimum from `starts` (s, p) of all parameters."""
        return minimise(self.linear, starts[:, self.free], box=self.box, tolerance=tolerance)

    def linear(self, free_values: Floats) -> tuple[Floats, Floats]:
        """Return the whitened model less measurement and a row for each of k priors, and slopes (N + k, q)."""
        values, free, weight = self.full(free_values), self.free, self.prior_weight
        force, slopes = self.model.linear(values, self.data, free=free)
        off = force - self.data.normal_N - self.carried_N
        white = self.whitener.apply(np.column_stack([off, slopes[:, free]]))
        residual = np.concatenate([white[:, 0], prior_pulls(values, self.parameters)])
        return residual, np.vstack([white[:, 1:], np.diag(weight)[(weight > 0) & free][:, free]])

    def jacobian(self, values: Floats) -> Floats:
        """Return d force/d parameter (N, p) without whitening; 0 for fixed parameters."""
        return self.model.linear(values, self.data, free=self.free)[1]


def _noise_of(problem: Problem, values: Floats, about: Linear, stated: bool) -> Noise:
    free = problem.free
    return estimate_noise(
        problem.data,
        about,
        residual_N=problem.data.normal_N - about.force_N,
        jacobian=problem.jacobian(values)[:, free],
        precision=np.diag(problem.prior_weight[free] ** 2),
        stated=stated,
    )


def _starts(model: Model, data: Observations) -> Floats:
    """Return the defaults, then for each effect its own starts with the others at their defaults."""
    rest = model.defaults(data)
    rows = [rest]
    for effect in model.effects:
        if effect.key in TOLERANCES:
            continue
        for start in effect.starts(data):
            row = rest.copy()
            row[model.slices(data)[effect.key]] = start
            rows.append(row)
    return np.array(rows)


def finish(problem: Problem, found: Minimum, noise: Noise, about: Linear) -> Fit:
    """Return the fit of a problem at a minimum, with this noise, linear about it."""
    free, size = problem.free, problem.data.size
    values = problem.full(found.values)
    covariance = np.zeros((free.size, free.size))
    covariance[np.ix_(free, free)] = inverse_information(found.jacobian)
    residual = problem.data.normal_N - about.force_N
    at_bound = np.zeros(free.size, dtype=bool)
    at_bound[free] = found.at_bound
    return Fit(
        model=problem.model, data=problem.data, parameters=problem.parameters, values=values,
        covariance=covariance, force_N=about.force_N, residual_N=residual, white=-found.residual[:size],
        jacobian=problem.jacobian(values), noise=noise, about=about, chi2=found.chi2, at_bound=at_bound,
    )  # fmt: skip


def unexplained(columns: Floats, values: Floats) -> Floats:
    """Return the part of values (n,) or (n, k) that the columns (n, p) do not explain, in their unit."""
    basis, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), NONZERO))
    return np.asarray(values - basis @ (basis.T @ values))


def inverse_information(jacobian: Floats) -> Floats:
    """Return (J^T J)^-1 (p, p) of J (n, p), per unit of residual, by singular values of the scaled J.

    A parameter that the data do not determine gets a huge variance.
    """
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1e-100)
    _, s, right = np.linalg.svd(jacobian / size, full_matrices=False)
    s = np.maximum(s, TINY)
    back = right.T / s
    return np.asarray((back @ back.T) / np.outer(size, size))
