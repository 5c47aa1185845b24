"""The error model free of what the law lacks: from how repeats differ, never from what they share.

Also, for a bootstrap, the noise that would be estimated from each of many drawn errors at once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.conditions import group_basis, nominal_depth
from calibration.fitting import Fit, Problem, fit
from calibration.noise import Noise, Whitener
from calibration.reml import STATED_DOF, TYPICAL_GAIN, TYPICAL_ZERO_MM, estimate_noise, prior_cost
from tactilevision.records import Floats

ALIKE = (
    1e-3  # columns that differ by less are one: depths of one indenter differ by such shares without meaning it
)


def noise_from_repeats(fitted: Fit) -> Noise:
    """The error model free of what the law lacks; where points leave nothing to compare, the fit's own and what is
    typical of presses. Points with a stated noise are presses too: they have a gain and a zero beside it.
    """
    space, stated = _explained(fitted), fitted.noise.stated
    of_presses = fitted.data.is_curves or stated
    if fitted.data.size - space.shape[1] < 3:
        if not of_presses or fitted.noise.gain:
            return fitted.noise
        return replace(fitted.noise, gain=TYPICAL_GAIN, zero_mm=TYPICAL_ZERO_MM)
    return estimate_noise(fitted.data, fitted.about, residual_N=fitted.residual_N, jacobian=space,
                          precision=np.zeros((space.shape[1],) * 2), stated=stated,
                          of_presses=of_presses)  # fmt: skip


def _explained(fitted: Fit) -> Floats:
    """An orthonormal basis (N, r) of all that the law or any smooth curve of a group of repeats can explain."""
    # at depths without their readings' noise, or the law's columns less a hold's mean would be just that noise
    data = fitted.data.shifted(nominal_depth(fitted.data) - fitted.data.depth_mm)
    whitener = Whitener(data, fitted.noise, fitted.about)
    law = Problem(fitted.model, data, fitted.parameters, whitener).jacobian(fitted.values)
    columns = np.column_stack([law[:, fitted.free], group_basis(data)])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > ALIKE * size[0]])


def refit_with_pure_noise(fitted: Fit) -> Fit:
    """The same model fitted with the noise that repeats show."""
    return fit(fitted.model, fitted.data, noise=noise_from_repeats(fitted), starts=fitted.values[None],
               tolerances=False)  # fmt: skip


def renewed_noise(fitted: Fit, errors_N: Floats) -> list[Noise]:
    """The noise that would be estimated from each column of errors (N, b): one Newton step on the likelihood.

    The likelihood is quadratic in the errors, so a stencil of ten points serves all columns at once.
    """
    if not (fitted.data.is_curves or fitted.noise.gain):
        return [replace(fitted.noise, scale=fitted.noise.scale * s) for s in _point_scales(fitted, errors_N)]
    space = _explained(fitted)
    centre = np.log([fitted.noise.scale, max(fitted.noise.gain, 1e-6), max(fitted.noise.zero_mm, 1e-7)])
    step = 0.15
    stencil = [np.zeros(3), *[_unit(i) for i in range(3)], *[-_unit(i) for i in range(3)],
               *[_unit(i) + _unit(j) for i in range(3) for j in range(i + 1, 3)]]  # fmt: skip
    places = [centre + step * s for s in stencil]
    costs = np.array([_costs(fitted, logs, errors_N, space) + prior_cost(logs, stated=fitted.noise.stated)
                      for logs in places])  # fmt: skip
    return [_stepped(fitted.noise, centre, step, costs[:, k]) for k in range(errors_N.shape[1])]


def _unit(k: int) -> Floats:
    return np.asarray(np.eye(3)[k])


def _stepped(noise: Noise, centre: Floats, step: float, costs: Floats) -> Noise:
    """Newton's step of at most a factor e from ten costs."""
    gradient = (costs[1:4] - costs[4:7]) / (2 * step)
    hessian = np.diag((costs[1:4] + costs[4:7] - 2 * costs[0]) / step**2)
    for value, (i, j) in zip(costs[7:], [(0, 1), (0, 2), (1, 2)], strict=True):
        cross = (value - costs[1 + i] - costs[1 + j] + costs[0]) / step**2
        hessian[i, j] = hessian[j, i] = cross
    curvature, axes = np.linalg.eigh(hessian)
    move = -axes @ ((axes.T @ gradient) / np.maximum(curvature, 0.5))
    sizes = np.exp(centre + np.clip(move, -1, 1))
    return replace(noise, scale=float(sizes[0]), gain=float(sizes[1]), zero_mm=float(sizes[2]))


def _costs(fitted: Fit, logs: Floats, errors_N: Floats, space: Floats) -> Floats:
    """-2 log L (b,) of many residuals at one set of sizes; what does not depend on the residual is shared."""
    noise = replace(fitted.noise, scale=float(np.exp(logs[0])), gain=float(np.exp(logs[1])),
                    zero_mm=float(np.exp(logs[2])))  # fmt: skip
    whitener = Whitener(fitted.data, noise, fitted.about)
    white = whitener.apply(np.column_stack([space, errors_N]))
    j, z = white[:, : space.shape[1]], white[:, space.shape[1] :]
    q, r = np.linalg.qr(j)
    squares = np.sum(z**2, axis=0) - np.sum((q.T @ z) ** 2, axis=0)
    volume = 2 * float(np.sum(np.log(np.abs(np.diag(r)) + 1e-300)))
    return np.asarray(squares + volume + whitener.log_volume)


def _point_scales(fitted: Fit, errors_N: Floats) -> Floats:
    """Relative size of the noise from each draw of points, weighed with what was stated."""
    base = fitted.noise.scale * fitted.about.base_N
    q, _ = np.linalg.qr(_explained(fitted) / base[:, None])
    z = errors_N / base[:, None]
    squares = np.sum(z**2, axis=0) - np.sum((q.T @ z) ** 2, axis=0)
    dof = fitted.data.size - q.shape[1]
    if dof < 3:
        return np.ones(errors_N.shape[1])
    trust = STATED_DOF if fitted.noise.stated else 0.0
    return np.asarray(np.sqrt((squares + trust) / (dof + trust)))
