"""From a fit to the material: E, nu, c and beta by the law that was fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.identifiability import beta_name, identify, main_radius
from calibration.fit.least_squares import Fit
from calibration.laws import FLAT, shape_of
from calibration.laws.paper import Paper
from calibration.laws.theory.admissible_range import beta_outside_theory, deeper_than_elements
from calibration.laws.theory.plausible import FLAG, NU_FLAG, outside_gels, stated_outside_gels
from calibration.repeats.pure_error import repeatability_rms
from calibration.result.by_radius import own_lines
from calibration.result.poisson_routes import contradictions, holding_each, of_fit
from calibration.result.published_route import published_route
from calibration.result.radii_apart import FLAG as APART, radii_apart
from calibration.result.result import NO_CLOCK, CalibrationResult, common_assumptions, r_squared
from calibration.result.round_result import of_round

AT_BOUND = "beta_at_bound"  # the flag of a slope that the fit pushed as far as it may go


def material_by_routes(fitted: Fit) -> CalibrationResult:
    """The material behind a fit, its interval reaching to each route to nu where those contradict each other."""
    routes = of_fit(fitted)
    found = determine_material(holding_each(fitted, routes))
    return replace(found, warnings=(*found.warnings, *contradictions(routes)))


def determine_material(fitted: Fit) -> CalibrationResult:
    """The material behind a fit of any law in the catalogue."""
    if shape_of(fitted.model.law) != FLAT:
        found = of_round(fitted)
    else:
        found = published_route(fitted) if isinstance(fitted.model.law, Paper) else _of_default(fitted)
    told = (
        (FLAG, outside_gels(found.youngs_modulus)),
        (NU_FLAG, stated_outside_gels(fitted.data.gel)),
        (AT_BOUND, _at_bound(fitted)),
        (APART, radii_apart(fitted)),
    )
    for flag, said in told:
        if said:
            found = replace(found, warnings=(*found.warnings, said), flags=(*found.flags, flag))
    return found


def _at_bound(fitted: Fit) -> str:
    """A sentence where the fit pushed a slope beta to the end of its range; else empty."""
    ends = [
        f"{parameter.name} = {value:g}"
        for parameter, value, held in zip(fitted.parameters, fitted.values, fitted.at_bound, strict=True)
        if held and not parameter.fixed and parameter.name.startswith("beta")
    ]
    if not ends:
        return ""
    return (
        f"a slope stands at the end of its range ({', '.join(ends)}): the law does not fit, and c and E "
        "say little. Check the thickness, the radii, and the units of depth and force"
    )


def _of_default(fitted: Fit) -> CalibrationResult:
    known = identify(fitted)
    radius, lines = main_radius(fitted), own_lines(fitted)
    beta = fitted.estimate(beta_name(fitted, radius))  # of a sharp punch, as theory's
    h_mm = fitted.data.gel.thickness_mm
    outside = beta_outside_theory(beta, known.poisson_ratio, a_over_h=radius / h_mm)
    c, bend = next((c, bend) for one, c, bend in lines if one == radius)
    deep = deeper_than_elements(float(np.max(fitted.data.depth_mm)) / h_mm)
    return CalibrationResult(
        youngs_modulus=known.youngs_modulus, poisson_ratio=known.poisson_ratio, poisson_ratio_source=known.source,
        c=c, beta=bend, reduced_modulus=known.reduced_modulus,
        youngs_modulus_of_nu=known.modulus_of_nu, covariance=known.covariance, law=fitted.model.law.key,
        r_squared=r_squared(fitted), rms_error_N=fitted.rms_error_N, noise_floor_N=repeatability_rms(fitted),
        clock_offset=NO_CLOCK, fitted=fitted, presses_accepted=fitted.data.presses.label,
        by_radius=lines, assumptions=(*common_assumptions(fitted), *known.assumptions),
        warnings=(*fitted.warnings, *fitted.data.warnings, *filter(None, (outside, deep))),
        flags=("beta_outside_theory",) if outside else (),
    )  # fmt: skip
