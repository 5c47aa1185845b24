"""The error model free of what the law lacks: from how repeats differ, never from what they share.

Also, for a bootstrap, the noise that would be estimated from each of many drawn errors at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibration.fit.least_squares import Fit, fit
from calibration.inputs.conditions import group_basis
from calibration.inputs.press_noise import TYPICAL_GAIN, TYPICAL_ZERO_MM
from calibration.noise.inner_products import Weighing
from calibration.noise.model import STATED_DOF, Noise
from calibration.noise.reml import (
    BEYOND_CHANCE,
    estimate_noise,
    far_less,
    log_sizes,
    newton_move,
    own_scale,
    prior_cost,
    sized,
    spread,
    stencil,
)
from calibration.repeats.at_denoised_depth import at_denoised_depth
from tactilevision.records import Floats

ALIKE = (
    1e-3  # columns that differ by less are one: depths of one indenter differ by such shares without meaning it
)


def repeat_noise(fitted: Fit) -> Noise:
    """The error model free of what the law lacks; where points leave nothing to compare, the fit's own and what is
    typical of presses. Points are presses too: they have a gain and a zero beside what is stated of them, and
    where nothing is, how they scatter over forces and slopes says which of N, % and mm it is constant in.
    """
    steady, stated = at_denoised_depth(fitted), fitted.noise.stated
    space = _explained(steady)
    if fitted.data.size - space.shape[1] < 3:
        if not (fitted.data.is_curves or stated) or fitted.noise.gain:
            return fitted.noise
        return replace(fitted.noise, gain=TYPICAL_GAIN, zero_mm=TYPICAL_ZERO_MM)
    return estimate_noise(
        steady.data,
        steady.about,
        residual_N=fitted.residual_N,
        jacobian=space,
        precision=np.zeros((space.shape[1],) * 2),
        stated=stated,
        of_presses=True,
    )


def beyond_stated(fitted: Fit) -> float | None:
    """How many times as much samples scatter as was stated of them; None where that may be chance.

    F of their own variance over the stated one, which is trusted like one measured on STATED_DOF readings.
    """
    from scipy.special import fdtrc

    if not fitted.noise.stated:
        return None
    dof = fitted.data.size - _explained(at_denoised_depth(fitted)).shape[1]  # as the estimate counts
    dof = dof if dof > 2 else fitted.data.size - int(np.count_nonzero(fitted.free))
    if dof < 1:
        return None
    own = own_scale(fitted.noise, dof)
    more = fdtrc(dof, STATED_DOF, own**2) < BEYOND_CHANCE
    return own if more or far_less(fitted.noise, dof) else None


def _explained(steady: Fit) -> Floats:
    """An orthonormal basis (N, r) of all that the law or any smooth curve of a group of repeats can explain."""
    columns = np.column_stack([steady.jacobian[:, steady.free], group_basis(steady.data)])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    size, axes = np.linalg.eigh(columns.T @ columns)
    kept = size > ALIKE**2 * size[-1]
    return np.asarray(columns @ axes[:, kept] / np.sqrt(size[kept]))


def refit_with_pure_noise(fitted: Fit) -> Fit:
    """The same model fitted with the noise that repeats show."""
    return fit(fitted.model, fitted.data, noise=repeat_noise(fitted), starts=fitted.values[None], tolerances=False)


def renewed_noise(fitted: Fit, errors_N: Floats) -> list[Noise]:
    """The noise that would be estimated from each column of errors (N, b) of a steadied fit: one Newton step.

    The likelihood is quadratic in the errors, so a stencil of ten points serves all columns at once.
    """
    if not (fitted.data.is_curves or fitted.noise.gain):
        return [replace(fitted.noise, scale=fitted.noise.scale * s) for s in _point_scales(fitted, errors_N)]
    centre, costs = log_sizes(fitted.noise), _on_stencil(fitted, errors_N)
    return [sized(fitted.noise, centre + newton_move(column, centre.size)) for column in costs.T]


def drawn_noise(fitted: Fit, rng: np.random.Generator, draws: int) -> list[Noise]:
    """Sizes of the noise as likely as the data leave them; of points, as estimated."""
    if not (fitted.data.is_curves or fitted.noise.gain):
        return [fitted.noise] * draws
    centre, costs = log_sizes(fitted.noise), _on_stencil(fitted, fitted.residual_N[:, None])
    moves = rng.standard_normal((draws, centre.size)) @ spread(costs[:, 0], centre.size).T
    return [sized(fitted.noise, centre + np.clip(move, -1, 1)) for move in moves]


def _on_stencil(fitted: Fit, errors_N: Floats) -> Floats:
    """-2 ln L and the priors' cost (k, b) of errors (N, b) about the fit's own sizes."""
    centre, cost = log_sizes(fitted.noise), _costs(fitted, errors_N)
    places = centre + stencil(centre.size)
    return np.array(
        [cost(sized(fitted.noise, logs)) + prior_cost(logs, trust=fitted.noise.trust) for logs in places]
    )


def _costs(fitted: Fit, errors_N: Floats) -> Callable[[Noise], Floats]:
    """-2 log L (b,) of many residuals (N, b) at any sizes."""
    weighing = Weighing(fitted.data, fitted.about, fitted.noise)
    columns, errors = weighing.take(_explained(fitted)), weighing.take(errors_N)
    within, across = weighing.product(columns, columns), weighing.product(columns, errors)
    squares = weighing.squares(errors)

    def cost(noise: Noise) -> Floats:
        information, seen = within.under(noise), across.under(noise)
        explained = np.sum(seen * np.linalg.solve(information, seen), axis=0)
        volume = weighing.log_volume(noise) + np.linalg.slogdet(information)[1]
        return np.asarray(squares.under(noise) - explained + volume)

    return cost


def _point_scales(fitted: Fit, errors_N: Floats) -> Floats:
    """Relative size of the noise from each draw of points, weighed with what was stated."""
    base = fitted.noise.scale * fitted.about.base_N
    q, _ = np.linalg.qr(_explained(fitted) / base[:, None])
    z = errors_N / base[:, None]
    squares = np.sum(z**2, axis=0) - np.sum((q.T @ z) ** 2, axis=0)
    dof = fitted.data.size - q.shape[1]
    if dof < 3:
        return np.ones(errors_N.shape[1])
    trust = fitted.noise.trust
    return np.asarray(np.sqrt((squares + trust) / (dof + trust)))
