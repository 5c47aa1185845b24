"""Parameters free of the bias that the noise of depth readings brings: errors in both variables.

    minimise |W (y - f(d*) - f'(d*) (d - d*))|^2,    d* = d + share e/f',    share = (f' std_w)^2 / b^2

e is what the samples' own noise leaves of the residual, b its std, d the depth as read. At depths as read, model
and residual hold the same noise: slopes come out too flat, and what bends a curve too strong or too weak. d* is
the depth to which a reading belongs, given its force; effects remember depths as read. Unbiased but for terms of
second order in the noise of a reading, times the curve's curvature.
Sources: Britt, Luecke, Technometrics 15 (1973) 233; Fuller, Measurement Error Models, 1987, 3.2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.least_squares import Fit, Problem, inverse_information, linearise
from calibration.inputs.observations import Observations
from calibration.noise.model import Whitener, depth_share
from tactilevision.records import Floats

TURNS = 2  # the second moves E by a hundredth of what the first does


def with_errors_in_depth(fitted: Fit) -> Fit:
    """The same model, data and noise, with the values (p,) and covariance (p, p) of such a fit.

    Of curves whose depth has a part in the noise; any other fit is returned as it is.
    """
    if not (fitted.data.is_curves and depth_share(fitted.data, fitted.about.slope_N_per_mm).any()):
        return fitted
    problem, values = _at_depths(fitted, fitted.data, fitted.values), fitted.values
    for _ in range(TURNS):
        problem = _at_depths(fitted, _true_depth(fitted, problem.data, values), values)
        found = problem.solve(values[None])
        values = problem.full(found.values)
    return _as_read(fitted, values, found.jacobian)


def _true_depth(fitted: Fit, data: Observations, values: Floats) -> Observations:
    """The readings at the depths that they and their forces show, from those of the turn before."""
    given = fitted.data
    about, _ = linearise(fitted.model, values, data=data)
    slope = about.slope_N_per_mm
    left = given.normal_N - about.force_N + slope * data.off_mm
    own = Whitener(data, fitted.noise, about).of_samples(left)
    moving = np.where(slope == 0, np.inf, slope)
    return replace(given, off_mm=depth_share(data, slope) * own / moving)


def _at_depths(fitted: Fit, data: Observations, values: Floats) -> Problem:
    """The problem at these depths; forces carried there along the slope."""
    about, _ = linearise(fitted.model, values, data=data)
    whitener = Whitener(data, fitted.noise, about)
    return Problem(fitted.model, data, fitted.parameters, whitener, about.slope_N_per_mm * data.off_mm)


def _as_read(fitted: Fit, values: Floats, jacobian: Floats) -> Fit:
    """The fit with these values, its residual at depths as read; `jacobian` (n, f) of what was minimised."""
    about, _ = linearise(fitted.model, values, data=fitted.data)
    problem = _at_depths(fitted, fitted.data, values)
    rows = problem.residual(values[problem.free])
    covariance = np.zeros((values.size,) * 2)
    covariance[np.ix_(problem.free, problem.free)] = inverse_information(jacobian)
    residual = fitted.data.normal_N - about.force_N
    found = replace(fitted, values=values, covariance=covariance, jacobian=problem.jacobian(values), about=about)
    white, chi2 = -rows[: fitted.data.size], float(rows @ rows)
    return replace(found, force_N=about.force_N, residual_N=residual, white=white, chi2=chi2)
