"""The published route from c and beta to nu and E, with the intervals that its formulas alone give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibration.fit.identifiability import beta_name, main_radius
from calibration.fit.least_squares import Fit
from calibration.laws.flat_punch import NU_TABLE
from calibration.laws.paper import A_OVER_H, modulus_at, modulus_from, poisson_from_beta
from calibration.laws.theory.admissible_range import beta_outside_theory
from calibration.repeats.pure_error import repeatability_rms
from calibration.result.result import NO_CLOCK, CalibrationResult, common_assumptions, r_squared
from tactilevision.records import Estimate, Floats

Route = Callable[[float, float], float]


def published_route(fitted: Fit) -> CalibrationResult:
    """The material as the publication reads it from a fit of the Paper law."""
    radius, data = main_radius(fitted), fitted.data
    ratio = radius / float(np.min(data.presses.radius_mm))  # c is the smallest radius's
    routes: dict[str, tuple[Route, str]] = {
        "c": (lambda c, b: ratio * c, "N/mm"),
        "beta": (lambda c, b: b, "1"),
        "nu": (lambda c, b: poisson_from_beta(b), "1"),
        "E": (lambda c, b: modulus_from(ratio * c, b, radius_mm=radius), "MPa"),
        "reduced": (
            lambda c, b: modulus_from(ratio * c, b, radius_mm=radius) / (1 - poisson_from_beta(b) ** 2),
            "MPa",
        ),
    }
    gradients = {name: _gradient(fitted, route, radius) for name, (route, _) in routes.items()}
    found = {name: _estimate(fitted, *routes[name], gradients[name], radius) for name in routes}
    rows = np.array([gradients[name] for name in ("E", "nu", "c", "beta")])
    c, beta = found["c"], found["beta"]
    assert c.value is not None
    outside = beta_outside_theory(
        beta, replace(found["nu"], interval95=None), a_over_h=radius / data.gel.thickness_mm
    )
    return CalibrationResult(
        youngs_modulus=found["E"], poisson_ratio=found["nu"], poisson_ratio_source="beta", c=c, beta=beta,
        reduced_modulus=found["reduced"],
        youngs_modulus_of_nu=tuple((nu, modulus_at(c.value, nu, radius_mm=radius)) for nu in NU_TABLE),
        covariance=np.asarray(rows @ fitted.covariance @ rows.T), law="paper", r_squared=r_squared(fitted),
        rms_error_N=fitted.rms_error_N, noise_floor_N=repeatability_rms(fitted), clock_offset=NO_CLOCK,
        fitted=fitted, presses_accepted=data.presses.label,
        assumptions=(*_assumptions(fitted, radius), *common_assumptions(fitted)),
        warnings=(*fitted.warnings, *data.warnings, *([outside] if outside else [])),
        flags=("beta_outside_theory",) if outside else (),
    )  # fmt: skip


def _assumptions(fitted: Fit, radius: float) -> list[str]:
    true_ratio = radius / fitted.data.gel.thickness_mm
    return [
        "a reproduction of the published route, not a measurement of nu",
        "nu = 0.0813 ln(beta) + 0.4464, a line through five points (R^2 = 0.98)",
        f"kappa is taken at a/h = {A_OVER_H:g}; this gel has {true_ratio:.3f}",
        "the intervals hold the scatter of the measurements alone, not the errors of the route",
    ]


def _estimate(fitted: Fit, route: Route, unit: str, gradient: Floats, radius: float) -> Estimate:
    value = route(*_c_and_beta(fitted, fitted.values, radius))
    if not np.isfinite(value):
        return Estimate(None, None, None, unit, "the published law gives no nu in [0, 0.5) for this beta")
    std = float(np.sqrt(gradient @ fitted.covariance @ gradient))
    reach = fitted.reach(gradient) * std
    return Estimate(value, std, (value - reach, value + reach), unit)


def _gradient(fitted: Fit, route: Route, radius: float) -> Floats:
    gradient = np.zeros(fitted.values.size)
    for name in ("c_N_per_mm", beta_name(fitted, radius)):
        k = fitted.index(name)
        step = 1e-5 * fitted.parameters[k].scale
        sides = [fitted.values.copy() for _ in range(2)]
        sides[0][k] += step
        sides[1][k] -= step
        high, low = (route(*_c_and_beta(fitted, values, radius)) for values in sides)
        gradient[k] = (high - low) / (2 * step)
    return np.nan_to_num(gradient)


def _c_and_beta(fitted: Fit, values: Floats, radius: float) -> tuple[float, float]:
    return float(values[fitted.index("c_N_per_mm")]), float(values[fitted.index(beta_name(fitted, radius))])
