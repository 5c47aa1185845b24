"""Joint confidence region of E and nu, and the allowance of E for a rounded edge."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.finite_depth import finite_depth, usual_softening
from calibration.fit.identifiability import main_radius, modulus_of_nu, poisson_range, sticking_range
from calibration.laws.flat_punch import SILICONE_NU
from calibration.result.result import CalibrationResult
from tactilevision.mechanics.tables.punch import EDGE_OVER_H
from tactilevision.records.constants import NU_MAX, Z95
from tactilevision.records.measured import Estimate, Floats, Pair

# The joint region of E and nu, and the band of each route to nu.
#
# At the fitted stiffness c, E(nu) = c (1 - nu^2)/(2 a kappa). The 95 % region follows it:
#
#     nu = nu_0 + k s_nu t,    E = E(nu) (1 +- k s_E sqrt(1 - t^2)),    -1 <= t <= 1,    k^2 = 5.99 (two unknowns)
#
# s_nu the std of nu, s_E the relative one of E at known nu. It reaches down to a gel that sticks to the face,
# where friction is unknown, and up to a rounded edge, where none is stated. Where nothing determines nu the region
# is the band about the curve over silicones' range.

TWO_UNKNOWNS = 2.4477  # sqrt of the 95 % point of chi square with 2 degrees of freedom
USUAL_NU = 0.3  # the curve begins here unless nu is below
STEPS = 61  # values of nu along the region's edge


@dataclass(frozen=True, slots=True)
class Band:
    """One route's 95 % interval of nu."""

    name: str
    interval: Pair
    used: bool


@dataclass(frozen=True, slots=True)
class JointPicture:
    """`region` (k, 2) the outline in (nu, E); `curve` (n, 2) of E(nu) at the fitted c; `best` (nu, E) or None."""

    curve: Floats
    region: Floats
    best: Pair | None
    bands: tuple[Band, ...]


def joint_picture(result: CalibrationResult) -> JointPicture:
    """Return the joint region of a fit of the default law, with each route to nu."""
    radius = main_radius(result.fitted)
    surplus = sticking_range(result.fitted, result.poisson_ratio, radius=radius, assumptions=[])
    softer = usual_softening(result.fitted, radius, poisson_ratio=result.poisson_ratio.value or SILICONE_NU[1])
    nu, modulus = result.poisson_ratio.value, result.youngs_modulus.value
    low = (result.poisson_ratio.interval95 or SILICONE_NU)[0]
    floor = USUAL_NU if nu is None or nu > USUAL_NU else 0.0
    grid = np.linspace(max(low - 0.05, floor), NU_MAX, STEPS)
    deep = finite_depth(result.fitted, result.poisson_ratio, radius_mm=radius)
    if deep is not None:
        surplus = max(surplus, deep.room(result.poisson_ratio.value or SILICONE_NU[1])[0])
    curve = np.array(modulus_of_nu(result.fitted, grid, radius=radius, deep=deep))
    relative = _relative_std(result)
    if nu is None or modulus is None:
        across = np.linspace(*poisson_range(result.fitted), STEPS)
        centre, half = _modulus(result, across, radius), np.full(STEPS, Z95 * relative)
    else:
        t = np.sin(np.linspace(-np.pi / 2, np.pi / 2, STEPS))  # close where the outline turns
        across = nu + TWO_UNKNOWNS * (result.poisson_ratio.std or 0.0) * t
        keep = (across > 0) & (across < 0.5)
        t, across = t[keep], across[keep]
        centre = modulus * _modulus(result, across, radius) / _modulus(result, np.array([nu]), radius)[0]
        half = TWO_UNKNOWNS * relative * np.sqrt(1 - t**2)
    upper, lower = centre * (1 + half) * (1 + softer), centre * (1 - half) / (1 + surplus)
    region = np.concatenate([np.column_stack([across, upper]), np.column_stack([across, lower])[::-1]])
    bands = tuple(
        Band(r.name, r.poisson_ratio.interval95, r.used)
        for r in result.routes
        if r.poisson_ratio.interval95 is not None and r.poisson_ratio.value is not None
    )
    return JointPicture(curve, region, None if nu is None or modulus is None else (nu, modulus), bands)


def _modulus(result: CalibrationResult, nu: Floats, radius_mm: float) -> Floats:
    """Return E (n,) at the fitted stiffness."""
    deep = finite_depth(result.fitted, result.poisson_ratio, radius_mm=radius_mm)
    return np.array(modulus_of_nu(result.fitted, np.minimum(nu, NU_MAX), radius=radius_mm, deep=deep))[:, 1]


def _relative_std(result: CalibrationResult) -> float:
    """Return the relative std of E at known nu."""
    variance, cross, of_nu = result.covariance[0, 0], result.covariance[0, 1], result.covariance[1, 1]
    rest = variance - (cross**2 / of_nu if of_nu > 0 else 0.0)
    fitted = float(result.fitted.values[result.fitted.index("youngs_modulus_MPa")])
    return float(np.sqrt(max(rest, 0.0)) / fitted)


# Allowance of E for a rounded edge where none is stated:
#
#     E -> E (1 + s),    r = h/60
#
# s is what a rounding r takes off the line through P/w; r, .05 mm on 3 mm of gel, is that of usual
# turned edges. A rounded punch taken for sharp makes the gel look softer. E keeps its value; its 95 % interval
# reaches up by s, combined with the rest as the root of the sum of squares. Where E is the elements' at finite
# depth it is that of the usual edge already, and s stands for one twice as round.


def allow_for_edge(result: CalibrationResult) -> CalibrationResult:
    """Return the result with E's upper end raised and an assumption; unchanged where the edge is stated."""
    data, radius, nu = result.fitted.data, main_radius(result.fitted), result.poisson_ratio.value
    stated = [i.edge_radius_mm for i in data.indenters if i.radius_mm == radius]
    if all(edge is not None for edge in stated):
        return result
    share = usual_softening(result.fitted, radius, poisson_ratio=SILICONE_NU[1] if nu is None else nu)
    edge = data.gel.thickness_mm * EDGE_OVER_H
    said = (
        f"no edge radius is stated: E is that of one rounded by {edge:.2g} mm, and one rounded twice as much "
        f"would raise it by some {100 * share:.1f} %; E's interval allows for that"
        if finite_depth(result.fitted, result.poisson_ratio, radius_mm=radius) is not None
        else f"no edge radius is stated: E may be higher by up to {100 * share:.1f} % where the punch's edge is "
        f"rounded by {edge:.2g} mm; E's interval allows for that"
    )
    return replace(
        result,
        youngs_modulus=_reaching(result.youngs_modulus, share),
        reduced_modulus=_reaching(result.reduced_modulus, share),
        assumptions=(*result.assumptions, said),
    )


def _reaching(modulus: Estimate, share: float) -> Estimate:
    if modulus.interval95 is None:
        return modulus
    low, high = modulus.interval95
    value = high if modulus.value is None else modulus.value
    return replace(modulus, interval95=(low, value + float(np.hypot(high - value, share * value))))
