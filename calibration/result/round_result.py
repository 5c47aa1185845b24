"""The material behind a fit of a ball or a cone.

Such a body has no stiffness c at depth 0 and no place on a curve beta(nu): E follows from the force at a known nu,
E(nu) = E F(nu_0)/F(nu) at the deepest sample. Where nothing fixes nu, E has no value but the interval over what
silicones span.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.laws.flat_punch import NU_TABLE, SILICONE_NU
from calibration.repeats.pure_error import repeatability_rms
from calibration.result.result import NO_CLOCK, CalibrationResult, common_assumptions, r_squared
from calibration.result.round_sticking import stuck_shift
from tactilevision.records import Estimate, Floats, Pair

NO_C = "a ball or a cone has no stiffness at depth 0: its force grows as a power of the depth"


def of_round(fitted: Fit) -> CalibrationResult:
    """E and nu with intervals, and what they rest on."""
    curve = tuple((nu, _modulus_at(fitted, nu)) for nu in NU_TABLE)
    nu, modulus = fitted.estimate("poisson_ratio"), fitted.estimate("youngs_modulus_MPa")
    stated = fitted.data.gel.poisson_ratio is not None
    low_nu, high_nu = SILICONE_NU
    modulus, about = _if_stuck(fitted, modulus)
    lines = [about, *common_assumptions(fitted)]
    if not stated:
        nu = Estimate(
            None, None, SILICONE_NU, "1", "a round body hardly feels nu: its force gives E at a known nu"
        )
        values = [_modulus_at(fitted, one) for one in SILICONE_NU]
        reach = 1 + _reach(modulus)
        span = (min(values) / reach, max(values) * reach)
        modulus = Estimate(None, None, span, "MPa", "it needs Poisson's ratio: see youngs_modulus_of_nu")
        lines.insert(0, f"nothing fixes poisson_ratio; silicone gels lie in [{low_nu:g}, {high_nu:g}]")
    return CalibrationResult(
        youngs_modulus=modulus, poisson_ratio=nu, poisson_ratio_source="prior",
        c=Estimate(None, None, None, "N/mm", NO_C), beta=fitted.estimate("beta"),
        reduced_modulus=_reduced(fitted, modulus), youngs_modulus_of_nu=curve, covariance=_covariance(fitted),
        law=fitted.model.law.key, r_squared=r_squared(fitted), rms_error_N=fitted.rms_error_N,
        noise_floor_N=repeatability_rms(fitted), clock_offset=NO_CLOCK, fitted=fitted,
        presses_accepted=fitted.data.presses.label, assumptions=tuple(lines),
        warnings=(*fitted.warnings, *fitted.data.warnings),
    )  # fmt: skip


def _if_stuck(fitted: Fit, modulus: Estimate) -> tuple[Estimate, str]:
    """E with its interval wide enough for a gel that sticks to the body, unless the presses were lubricated."""
    if np.all(fitted.data.presses.lubricated == 1):
        return modulus, "frictionless: the presses were lubricated"
    shift = stuck_shift(fitted)
    assert modulus.interval95 is not None
    low, high = modulus.interval95
    wide = (min(low, low / (1 + shift)), max(high, high / (1 + shift)))
    way = "higher" if shift < 0 else "lower"
    return replace(modulus, interval95=wide), (
        f"friction is unknown: the law is frictionless, and E may be {way} by up to {100 * abs(shift):.1f} % "
        "where the gel sticks to the body; E's interval reaches that far"
    )


def _modulus_at(fitted: Fit, nu: float) -> float:
    """E that gives the same force at the deepest sample with another nu."""
    k, e = fitted.index("poisson_ratio"), fitted.index("youngs_modulus_MPa")
    deepest = int(np.argmax(fitted.data.depth_mm))
    other: Floats = fitted.values.copy()
    other[k] = nu
    forces = [fitted.model.predict(values, fitted.data)[deepest] for values in (fitted.values, other)]
    return float(fitted.values[e] * forces[0] / forces[1])


def _reach(modulus: Estimate) -> float:
    """Half of the relative interval of E at known nu."""
    assert modulus.value is not None
    assert modulus.interval95 is not None
    return (modulus.interval95[1] - modulus.interval95[0]) / (2 * modulus.value)


def _reduced(fitted: Fit, modulus: Estimate) -> Estimate:
    """E/(1 - nu^2), nearly the same at any nu: of the ends where nu is open."""
    k = fitted.index("poisson_ratio")
    if modulus.value is None:
        low, high = modulus.interval95 or (np.nan, np.nan)
        span: Pair = (low / (1 - SILICONE_NU[1] ** 2), high / (1 - SILICONE_NU[0] ** 2))
        return replace(modulus, interval95=span)
    factor = 1 / (1 - float(fitted.values[k]) ** 2)
    low, high = modulus.interval95 or (np.nan, np.nan)
    return Estimate(factor * modulus.value, factor * (modulus.std or 0.0), (factor * low, factor * high), "MPa")


def _covariance(fitted: Fit) -> Floats:
    """(4, 4) of E, nu, c, beta; nothing for c, which there is not."""
    places = [fitted.index(name) for name in ("youngs_modulus_MPa", "poisson_ratio", "beta")]
    found = np.zeros((4, 4))
    found[np.ix_([0, 1, 3], [0, 1, 3])] = fitted.covariance[np.ix_(places, places)]
    return found
