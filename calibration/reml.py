"""The error model's sizes from the data: restricted maximum likelihood, held by weak priors where repeats are
few.

    -2 log L = sum over presses of log|V_p| + log|J^T V^-1 J + Lambda| + r^T P r

J the model's derivatives, Lambda the priors' precision, P projects the fitted part out. With few presses the
sizes of gain and zero are hardly known: log-normal priors about .5 % and 4 um (a factor 2.7 either way) then
keep them from collapsing to 0, and fade as presses are added. Sources: Patterson, Thompson, Biometrika 58
(1971) 545; Harville, J. Am. Stat. Assoc. 72 (1977) 320.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.hereditary import Grid
from calibration.noise import Linear, Noise
from tactilevision.records import Floats

TYPICAL_GAIN, TYPICAL_ZERO_MM, SPREAD = 0.005, 0.004, 1.0
UNKNOWN_SHARE = 0.02  # of the largest force: a noise to assume where nothing was stated or left over
STATED_DOF = 20.0  # a stated noise is trusted like one measured on so many readings
CORRELATIONS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95)


@dataclass(frozen=True, slots=True)
class Grams:
    """Inner products a press, of the columns [gain, zero | residual(s) | jacobian], all at scale 1: (M, c, c)."""

    table: Floats
    sizes: Floats
    columns: int
    precision: Floats
    log_jump: float


def estimate_noise(data: Observations, about: Linear, *, residual_N: Floats, jacobian: Floats,
                   precision: Floats, stated: bool, of_presses: bool | None = None) -> Noise:  # fmt: skip
    """The likeliest noise for residuals (N,) of a fit with `jacobian` (N, p) and priors' `precision` (p, p).

    `of_presses`: whether presses have a gain and a zero of their own; None: curves have.
    """
    dof = max(data.size - jacobian.shape[1] + float(np.count_nonzero(np.diag(precision))), 0.0)
    first = Noise(1.0 if stated else max(float(np.std(residual_N)), 1e-9), stated=stated)
    shared = data.is_curves if of_presses is None else of_presses
    if dof < 1 and not stated:  # nothing is left over to estimate it from
        return replace(first, scale=UNKNOWN_SHARE * float(np.max(np.abs(about.force_N))), dof=1.0)
    best, lowest = first, np.inf
    for rho in CORRELATIONS if data.is_curves else (0.0,):
        grams = inner_products(data, about, residual_N, jacobian, precision, rho)
        found, cost = _best(grams, replace(first, correlation=rho), shared)
        if cost < lowest - 1e-9:
            best, lowest = found, cost
        elif cost > lowest + 20:  # past the best correlation the cost only grows
            break
    freedom = dof + STATED_DOF if stated else dof
    if data.is_curves:
        freedom = max(data.count - 1.0, 1.0) + STATED_DOF / 2
    return replace(best, dof=max(freedom, 1e-9))


def inner_products(data: Observations, about: Linear, residual_N: Floats, jacobian: Floats,
                   precision: Floats, rho: float) -> Grams:  # fmt: skip
    """What the likelihood needs of the data, once for all sizes at one correlation."""
    grid = Grid.of(data)
    columns = np.column_stack([about.force_N, about.slope_N_per_mm, residual_N, jacobian]) / about.base_N[:, None]
    table = columns[grid.rows] * grid.real[:, :, None]
    if rho:
        later = (table[:, 1:] - rho * table[:, :-1]) / np.sqrt(1 - rho**2) * grid.real[:, 1:, None]
        table = np.concatenate([table[:, :1], later], axis=1)
    sizes = grid.real.sum(axis=1).astype(float)
    jump = float(np.sum(sizes - 1)) * np.log(1 - rho**2) if rho else 0.0
    return Grams(np.einsum("mti,mtj->mij", table, table), sizes, 2, precision, jump)


def minus_two_log_likelihood(logs: Floats, grams: Grams, *, shared: bool) -> float:
    """For logs = ln scale (, ln gain, ln zero_mm); leaves out what is constant."""
    variance = np.exp(2 * logs[0])
    rest = grams.table[:, 2:, 2:]
    cost = float(grams.sizes.sum()) * 2 * logs[0] + grams.log_jump
    if shared:
        size = np.exp(logs[1:3])
        inner = grams.table[:, :2, :2] * size[:, None] * size / variance
        across = grams.table[:, :2, 2:] * size[:, None] / variance
        inverse, volumes = _inverse_beside_one(inner)
        cost += float(np.sum(np.log(volumes)))
        lost = np.einsum("mri,mrs,msj->ij", across, inverse, across, optimize=True) * variance
        total = (rest.sum(axis=0) - lost) / variance
    else:
        total = rest.sum(axis=0) / variance
    information = total[1:, 1:] + grams.precision
    sign, volume = np.linalg.slogdet(information)
    if sign <= 0:
        return 1e30  # finite, so that a search can step back
    explained = total[0, 1:] @ np.linalg.solve(information, total[1:, 0])
    return float(cost + volume + total[0, 0] - explained)


def prior_cost(logs: Floats, *, stated: bool) -> float:
    """-2 ln of what is known beforehand of logs = ln scale (, ln gain, ln zero_mm): presses have a usual gain and
    zero, and a stated noise a scale of 1 (scaled inverse chi-squared).
    """
    usual = np.log([TYPICAL_GAIN, TYPICAL_ZERO_MM])[: logs.size - 1]
    cost = float(np.sum(((logs[1:] - usual) / SPREAD) ** 2))
    return cost + STATED_DOF * float(2 * logs[0] + np.exp(-2 * logs[0])) if stated else cost


def _inverse_beside_one(inner: Floats) -> tuple[Floats, Floats]:
    """(1 + A)^-1 and det(1 + A) for positive A (m, 2, 2): by hand, since sizes that a search only
    passes through make A so large that 1 is lost beside it.
    """
    a, b, d = inner[:, 0, 0], inner[:, 0, 1], inner[:, 1, 1]
    volume = 1 + a + d + np.maximum(a * d - b * b, 0.0)
    return np.moveaxis(np.array([[1 + d, -b], [-b, 1 + a]]), 2, 0) / volume[:, None, None], volume


def _best(grams: Grams, first: Noise, shared: bool) -> tuple[Noise, float]:
    from scipy.optimize import minimize

    centre = np.log([first.scale, TYPICAL_GAIN, TYPICAL_ZERO_MM])[: 3 if shared else 1]

    def cost(logs: Floats) -> float:
        return minus_two_log_likelihood(logs, grams, shared=shared) + prior_cost(logs, stated=first.stated)

    bounds = [(c - 8, c + 8) for c in centre]
    solution = minimize(cost, centre, method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-10})
    sizes = np.exp(solution.x)
    found = replace(first, scale=float(sizes[0]))
    if shared:
        found = replace(found, gain=float(sizes[1]), zero_mm=float(sizes[2]))
    return found, float(solution.fun)
