"""Pure error and error model from repeated presses."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.least_squares import FINE, Fit, fit_again
from calibration.fit.tolerances import HEIGHTS
from calibration.inputs.conditions import group_basis
from calibration.inputs.observations import TYPICAL_GAIN, TYPICAL_ZERO_MM, Ints
from calibration.noise import reml
from calibration.noise.model import STATED_DOF, Noise
from tactilevision.records.constants import NONZERO
from tactilevision.records.measured import Floats

LEVEL = 0.05  # p below which a difference is significant
ALIKE = 1e-3  # relative difference of columns that count as one, as of depths of one indenter


def repeat_noise(fitted: Fit) -> Noise:
    """Return the noise estimated from differences between repeats, free of what the law lacks.

    Where points have no repeats, the fit's own noise with the usual gain and zero. Points have a gain and a zero
    in addition to their stated noise; where none is stated, their scatter over forces and slopes determines them.
    """
    steady, stated = at_denoised_depth(fitted), fitted.noise.stated
    space = _explained(steady)
    if fitted.data.size - space.shape[1] < 3:
        if not (fitted.data.is_curves or stated) or fitted.noise.gain:
            return fitted.noise
        return replace(fitted.noise, gain=TYPICAL_GAIN, zero_mm=TYPICAL_ZERO_MM)
    return reml.estimate_noise(
        steady.data,
        steady.about,
        residual_N=fitted.residual_N,
        jacobian=space,
        precision=np.zeros((space.shape[1],) * 2),
        stated=stated,
        of_presses=True,
    )


def beyond_stated(fitted: Fit) -> float | None:
    """Return the samples' std over the stated one; None where the difference is not significant.

    By F of the two variances, the stated one with STATED_DOF degrees of freedom.
    """
    from scipy.special import fdtrc

    if not fitted.noise.stated:
        return None
    dof = fitted.data.size - _explained(at_denoised_depth(fitted)).shape[1]  # as the estimate counts
    dof = dof if dof > 2 else fitted.data.size - int(np.count_nonzero(fitted.free))
    if dof < 1:
        return None
    own = reml.own_scale(fitted.noise, dof)
    more = fdtrc(dof, STATED_DOF, own**2) < reml.BEYOND_CHANCE
    return own if more or reml.far_below_stated(fitted.noise, dof) else None


def _explained(steady: Fit) -> Floats:
    """Return an orthonormal basis (N, r) of what the law or a smooth curve of a group of repeats can explain."""
    columns = np.column_stack([steady.jacobian[:, steady.free], group_basis(steady.data)])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), NONZERO)
    size, axes = np.linalg.eigh(columns.T @ columns)
    kept = size > ALIKE**2 * size[-1]
    return np.asarray(columns @ axes[:, kept] / np.sqrt(size[kept]))


def refit_with_pure_noise(fitted: Fit, *, ftol: float = FINE) -> Fit:
    """Refit the same model with the noise of repeats."""
    return fit_again(fitted, noise=repeat_noise(fitted), ftol=ftol)


def renewed_noise(fitted: Fit, errors_N: Floats) -> list[Noise]:
    """Return the noise estimated from each column of errors (N, b) of a fit at denoised depths: one Newton step.

    The likelihood is quadratic in the errors, so a stencil of ten points serves all columns at once.
    """
    if not (fitted.data.is_curves or fitted.noise.gain):
        return [replace(fitted.noise, scale=fitted.noise.scale * s) for s in _point_scales(fitted, errors_N)]
    centre, costs = reml.log_sizes(reml.sizes_of([fitted.noise])[0]), _on_stencil(fitted, errors_N)
    return [reml.sized(fitted.noise, centre + reml.newton_move(column, centre.size)) for column in costs.T]


def drawn_noise(fitted: Fit, rng: np.random.Generator, draws: int) -> list[Noise]:
    """Sample sizes of the noise from their posterior; for points, return the estimate."""
    if not (fitted.data.is_curves or fitted.noise.gain):
        return [fitted.noise] * draws
    centre, costs = (
        reml.log_sizes(reml.sizes_of([fitted.noise])[0]),
        _on_stencil(fitted, fitted.residual_N[:, None]),
    )
    moves = rng.standard_normal((draws, centre.size)) @ reml.spread(costs[:, 0], centre.size).T
    return [reml.sized(fitted.noise, centre + np.clip(move, -1, 1)) for move in moves]


def _on_stencil(fitted: Fit, errors_N: Floats) -> Floats:
    """Return -2 ln L plus the priors' cost (k, b) of errors (N, b) about the fit's own sizes."""
    weighing, columns, sizes, information, own = _stencil(fitted)
    errors = weighing.take(errors_N)
    seen = weighing.product(columns, errors).under_each(sizes)
    explained = np.sum(seen * np.linalg.solve(information, seen), axis=1)
    return np.asarray(weighing.squares(errors).under_each(sizes) - explained + own[:, None])


@lru_cache(maxsize=2)  # a bootstrap asks once a batch
def _stencil(fitted: Fit) -> tuple[reml.Weighing, reml.Columns, Floats, Floats, Floats]:
    """Return what the costs of all errors share: the explained columns under each noise, and their own costs."""
    centre = reml.log_sizes(reml.sizes_of([fitted.noise])[0])
    places = centre + reml.stencil(centre.size)
    sizes = np.exp(places)
    weighing = reml.Weighing(fitted.data, fitted.about, fitted.noise)
    columns = weighing.take(_explained(fitted))
    information = weighing.product(columns, columns).under_each(sizes)
    volume = weighing.weigh(sizes)[1] + np.linalg.slogdet(information)[1]
    own = volume + reml.prior_cost(places, trust=fitted.noise.trust)
    return weighing, columns, sizes, information, own


def _point_scales(fitted: Fit, errors_N: Floats) -> Floats:
    """Return the relative size of the noise from each draw of points, weighted with the stated one."""
    base = fitted.noise.scale * fitted.about.base_N
    q, _ = np.linalg.qr(_explained(fitted) / base[:, None])
    z = errors_N / base[:, None]
    squares = np.sum(z**2, axis=0) - np.sum((q.T @ z) ** 2, axis=0)
    dof = fitted.data.size - q.shape[1]
    if dof < 3:
        return np.ones(errors_N.shape[1])
    trust = fitted.noise.trust
    return np.asarray(np.sqrt((squares + trust) / (dof + trust)))


def pure_error(residual: Floats, groups: Ints) -> tuple[float, int]:
    """Return the sum of squares of a residual (N,) within groups (N,) of equal conditions, and its dof."""
    count = np.bincount(groups)
    mean = np.bincount(groups, residual) / np.maximum(count, 1)
    return float(np.sum((residual - mean[groups]) ** 2)), int(np.sum(np.maximum(count - 1, 0)))


def allow_for_indenters(fitted: Fit) -> Fit:
    """Return the fit with its covariance widened where indenters scatter more about the law than their repeats.

    Presses of one indenter share its machined height. Where the F test of the indenters' mean squares over the
    repeats' is significant at 5 %, intervals use the former with its few degrees of freedom.
    """
    from scipy.special import fdtrc

    data = fitted.data
    if data.is_curves or HEIGHTS in fitted.model.keys:
        return fitted
    groups = data.presses.indenter[data.press]
    squares, dof = pure_error(fitted.white, groups)
    used = int(np.count_nonzero(fitted.free)) - sum(p.prior is not None for p in fitted.parameters if not p.fixed)
    between = np.unique(groups).size - used
    if dof < 3 or between < 1:
        return fitted
    own, other = squares / dof, max(fitted.chi2 - squares, 0.0) / between
    if own <= 0 or fdtrc(between, dof, other / own) > LEVEL:
        return fitted
    ratio = max(other, 1.0)
    warning = (
        f"the indenters scatter about the law {np.sqrt(other / own):.1f} times as much as their repeats: heights "
        "are off by more than stated, or an effect is missing; the intervals are widened accordingly"
    )
    return replace(
        fitted,
        covariance=_widened(fitted, ratio),
        noise=replace(fitted.noise, dof=float(between)),
        warnings=(*fitted.warnings, warning),
    )


def _widened(fitted: Fit, ratio: float) -> Floats:
    """Return the covariance (p, p) with the data's part `ratio` times as large and the priors' unchanged."""
    place = np.ix_(fitted.free, fitted.free)
    size = np.sqrt(np.diag(fitted.covariance[place]))  # parameters of very different sizes
    known = np.diag((size * fitted.prior_weight[fitted.free]) ** 2)
    of_data = np.linalg.pinv(fitted.covariance[place] / np.outer(size, size)) - known
    wider = fitted.covariance.copy()
    wider[place] = np.linalg.pinv(of_data / ratio + known) * np.outer(size, size)
    return wider


def repeatability_rms(fitted: Fit) -> float:
    """Return the std, N, of forces of similar presses about the model.

    For points with repeats the pure error, sqrt(sum of squares within indenters / (points - indenters)); else the
    std of the noise model. An rms error over few points divides by their number and may lie below it; compare it
    with the held-out error. Source: Draper and Smith, Applied Regression Analysis, ch. 2.
    """
    data = fitted.data
    if not data.is_curves:
        squares, dof = pure_error(fitted.residual_N, data.presses.indenter[data.press])
        if dof >= 3:
            return float(np.sqrt(squares / dof))
    return float(np.sqrt(np.mean(fitted.noise.std_N(fitted.about) ** 2)))
