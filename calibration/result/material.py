"""Derive E, nu, c and beta from a fit, by the law that was fitted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from itertools import combinations

import numpy as np

from calibration.fit.finite_depth import finite_depth, stated_edge_mm, usual_softening
from calibration.fit.identifiability import (
    Rival,
    bend_of,
    beta_name,
    derived,
    gradient,
    identify,
    main_radius,
    modulus_of_nu,
    poisson_range,
    reaching_up,
    sticking_range,
    stiffness_of,
)
from calibration.fit.least_squares import Fit, fit
from calibration.fit.repeats import LEVEL, allow_for_indenters, repeatability_rms
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.checks import at_one_depth
from calibration.laws import FLAT, shape_of, theory
from calibration.laws.flat_punch import NU_TABLE, SILICONE_NU, FlatPunch
from calibration.laws.paper import A_OVER_H, Paper, modulus_at, modulus_from, poisson_from_beta
from calibration.laws.resultant import Resultant
from calibration.model.composition import Model
from calibration.result.poisson_routes import CONTRARY, contradictions, of_fit, rivals
from calibration.result.result import CalibrationResult, common_assumptions
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.mechanics.tables.punch import EDGE_OVER_H
from tactilevision.records.constants import NU_MAX, Z95
from tactilevision.records.measured import Estimate, Floats, Pair
from tactilevision.records.rig import Gel, Indenter

# c and beta of each of several radii, from the line through its own points.
#
# One law for all radii ties their stiffnesses by E, nu and a/h; friction and a rounded edge change each by some
# per cent.

LEAST = 3  # presses, or samples of a curve, for a line and its scatter
Line = tuple[float, Estimate, Estimate]


def own_lines(fitted: Fit) -> tuple[Line, ...]:
    """Return (radius, c, beta) of every radius.

    Those of the common law where one radius has too few points or one depth, and where effects are fitted along.
    """
    return tuple(_line(fitted, float(radius)) for radius in np.unique(fitted.data.presses.radius_mm))


def _line(fitted: Fit, radius: float) -> Line:
    plain = isinstance(fitted.model.law, FlatPunch) and not fitted.model.effects
    alone = line_alone(fitted, radius) if plain else None
    return alone or (radius, stiffness_of(fitted, radius), bend_of(fitted, radius))


def line_alone(fitted: Fit, radius: float) -> Line | None:
    """Return (radius, c, beta) of the line through this radius' presses; None for a single radius or no line."""
    mine = fitted.data.take(fitted.data.presses.radius_mm == radius)
    if mine.count == fitted.data.count or mine.size < LEAST or at_one_depth(mine):
        return None
    # a line does not depend on nu
    gel = replace(mine.gel, poisson_ratio=SILICONE_NU[0], poisson_ratio_std=0.0)
    alone = allow_for_indenters(fit(Model(FlatPunch()), replace(mine, gel=gel)))
    return radius, stiffness_of(alone, radius), bend_of(alone, radius)


# Consistency of several radii: the stiffness of a bonded layer grows with the radius as
#
#     c_b / c_a = (b / a) kappa(nu, b/h) / kappa(nu, a/h),    a < b,
#
# between the least nu of gels and nu = .5, since kappa grows faster with a/h the larger nu is.
# Source: mechanics/kappa.py.

RADII_FLAG = "radii_apart"
ALLOWED = 0.15  # of c: an edge of .1 mm that is not stated takes up to 13 % off (docs/explanation/limits.md)


def radii_apart(fitted: Fit) -> str:
    """Return a warning about the pair of radii whose stiffnesses contradict one gel most; "" where none do.

    For the flat punch alone: an effect that is fitted along may change c with the radius.
    """
    if not isinstance(fitted.model.law, FlatPunch) or not set(fitted.model.keys) <= set(TOLERANCES):
        return ""
    gel = fitted.data.gel
    alone = (line_alone(fitted, float(radius)) for radius in np.unique(fitted.data.presses.radius_mm))
    worst = max(_contrary([line for line in alone if line], gel), default=None)
    if worst is None:
        return ""
    _, a, b, found, low, high = worst
    return (
        f"from radius_mm = {a:g} to {b:g} the stiffness c grows {found:.3g} times; one gel of thickness_mm = "
        f"{gel.thickness_mm:g} lets it grow {low:.3g} to {high:.3g} times: do not trust E. Check these radii (is "
        "one a diameter?), which presses are of which, the thickness, and whether the rig gives"
    )


def _contrary(lines: list[Line], gel: Gel) -> Iterator[tuple[float, ...]]:
    """Yield the excess over theory's range (ln), both radii, the growth of c and its range."""
    for (a, c_a, _), (b, c_b, _) in combinations(lines, 2):
        ratios = np.array([a, b]) / gel.thickness_mm
        inside = A_OVER_H_RANGE[0] <= ratios[0] and ratios[1] <= A_OVER_H_RANGE[1]
        if not inside or not c_a.value or not c_b.value or min(c_a.value, c_b.value) <= 0:
            continue
        low, high = (
            b / a * float(np.divide(*fast_kappa(nu, ratios)[::-1])) for nu in (theory.LEAST_POISSON_RATIO, NU_MAX)
        )
        found = c_b.value / c_a.value
        std = float(np.hypot((c_a.std or 0.0) / c_a.value, (c_b.std or 0.0) / c_b.value))
        beyond = max(np.log(low / found), np.log(found / high)) - max(CONTRARY * std, ALLOWED)
        if beyond > 0:
            yield beyond, a, b, found, low, high


# The published route from c and beta to nu and E, with the intervals of its formulas alone.

STEP = 1e-5  # of a parameter's scale, for derivatives


def published_route(fitted: Fit) -> CalibrationResult:
    """Return the material by the published formulas from a fit of the Paper law."""
    radius, data = main_radius(fitted), fitted.data
    ratio = radius / float(np.min(data.presses.radius_mm))  # c is the smallest radius's
    at_c, at_beta = fitted.index("c_N_per_mm"), fitted.index(beta_name(fitted, radius))

    def route(values: Floats) -> tuple[float, ...]:
        c, beta = ratio * float(values[at_c]), float(values[at_beta])
        nu, modulus = poisson_from_beta(beta), modulus_from(c, beta, radius_mm=radius)
        return modulus, nu, c, beta, modulus / (1 - nu**2)

    why = "the published law gives no nu in [0, 0.5) for this beta"
    units = ("MPa", "1", "N/mm", "1", "MPa")
    of_modulus, of_nu, of_c, of_beta, of_reduced = derived(fitted, route, units, step=STEP, why=why)
    rows, stiffness = gradient(fitted, route, step=STEP)[:4], route(fitted.values)[2]
    h_mm = data.gel.thickness_mm
    outside = theory.beta_outside_theory(of_beta, replace(of_nu, interval95=None), a_over_h=radius / h_mm)
    assumptions = (
        "a reproduction of the published route, not a measurement of nu",
        "nu = 0.0813 ln(beta) + 0.4464, a line through five points (R^2 = 0.98)",
        f"kappa is taken at a/h = {A_OVER_H:g}; this gel has {radius / h_mm:.3f}",
        "the intervals hold the scatter of the measurements alone, not the errors of the route",
    )
    return CalibrationResult(
        youngs_modulus=of_modulus, poisson_ratio=of_nu, poisson_ratio_source="beta", c=of_c, beta=of_beta,
        reduced_modulus=of_reduced,
        youngs_modulus_of_nu=tuple((n, modulus_at(stiffness, n, radius_mm=radius)) for n in NU_TABLE),
        covariance=np.asarray(rows @ fitted.covariance @ rows.T), fitted=fitted,
        assumptions=(*assumptions, *common_assumptions(fitted)),
        warnings=(*fitted.warnings, *data.warnings, *([outside] if outside else [])),
        flags=("beta_outside_theory",) if outside else (),
    )  # fmt: skip


# Bias of E of a ball or a cone where the gel sticks to it.
#
# At small strain a round body hardly depends on friction; at large strain
#
#     P_stick/P_free - 1 = k(nu) (w/h)^2 R/h,     k = .10 .47 1.0 1.45 at nu = .40 .45 .48 .4999
#
# From finite elements of balls with R = 1 to 3 h to w/h = .2, within a third of the surplus. A cone counts as the
# ball of the same contact radius at the same depth. The law's free beta absorbs part of it and makes E too low.

NU = (0.40, 0.45, 0.48, NU_MAX)  # at which SURPLUS was computed
SURPLUS = (0.10, 0.47, 1.00, 1.45)  # k(nu) of the equation above, by finite elements


def stuck_surplus(poisson_ratio: float, radius_over_h: Floats | float, *, w_over_h: Floats) -> Floats:
    """Return P_stick/P_free - 1 of a ball, any shape."""
    return np.asarray(np.interp(poisson_ratio, NU, SURPLUS) * np.square(w_over_h) * radius_over_h)


def stuck_shift(fitted: Fit) -> float:
    """Return the relative bias of E where the gel sticks: the fit of E and beta to the surplus."""
    data, e, k = fitted.data, fitted.index("youngs_modulus_MPa"), fitted.index("beta")
    strain = np.maximum(data.depth_mm, 0) / data.gel.thickness_mm
    radius = np.array(
        [
            ball_radius_mm(data.indenters[i], w)
            for i, w in zip(data.presses.indenter[data.press], data.depth_mm, strict=True)
        ]
    )
    nu = float(fitted.values[fitted.index("poisson_ratio")])
    surplus = fitted.force_N * stuck_surplus(nu, radius / data.gel.thickness_mm, w_over_h=strain)
    prior = fitted.parameters[k].prior
    held = 0.0 if prior is None else fitted.rms_error_N / prior.std
    matrix = np.vstack([fitted.jacobian[:, [e, k]], [0.0, held]])
    return float(np.linalg.lstsq(matrix, np.append(surplus, 0.0), rcond=None)[0][0] / fitted.values[e])


def ball_radius_mm(indenter: Indenter, depth_mm: float) -> float:
    """Return the ball's radius; of a cone a^2/w with a = (2/pi) w tan, the ball of the same contact radius."""
    if indenter.half_angle_deg is None:
        return indenter.radius_mm
    return float((2 / np.pi * np.tan(np.radians(indenter.half_angle_deg))) ** 2 * max(depth_mm, 0.0))


# The material of a fit of a ball or a cone: E(nu) = E F(nu_0)/F(nu) at the deepest sample. Where nothing
# determines nu, E has the interval over silicones' range and no value.

NO_C = "a ball or a cone has no stiffness at depth 0: its force grows as a power of the depth"


def of_round(fitted: Fit) -> CalibrationResult:
    """Return E and nu with intervals and assumptions."""
    curve = tuple((nu, _modulus_at(fitted, nu)) for nu in NU_TABLE)
    nu, modulus = fitted.estimate("poisson_ratio"), fitted.estimate("youngs_modulus_MPa")
    stated = fitted.data.gel.poisson_ratio is not None
    low_nu, high_nu = SILICONE_NU
    modulus, about = _if_stuck(fitted, modulus)
    lines = [about, *common_assumptions(fitted)]
    if not stated:
        nu = Estimate(
            None, None, SILICONE_NU, "1", "a round body hardly depends on nu: its force gives E at a known nu"
        )
        values = [_modulus_at(fitted, one) for one in SILICONE_NU]
        assert modulus.value is not None
        assert modulus.interval95 is not None
        reach = 1 + (modulus.interval95[1] - modulus.interval95[0]) / (2 * modulus.value)
        span = (min(values) / reach, max(values) * reach)
        modulus = Estimate(None, None, span, "MPa", "it needs Poisson's ratio: see youngs_modulus_of_nu")
        lines.insert(0, f"nothing fixes poisson_ratio; silicone gels lie in [{low_nu:g}, {high_nu:g}]")
    return CalibrationResult(
        youngs_modulus=modulus, poisson_ratio=nu, poisson_ratio_source="prior",
        c=Estimate(None, None, None, "N/mm", NO_C), beta=fitted.estimate("beta"),
        reduced_modulus=_reduced(fitted, modulus), youngs_modulus_of_nu=curve, covariance=_covariance(fitted),
        fitted=fitted, assumptions=tuple(lines),
        warnings=(*fitted.warnings, *fitted.data.warnings),
    )  # fmt: skip


def of_resultants(fitted: Fit) -> CalibrationResult:
    """Return E by the readings next to resultants of pictures, at the calibration's nu, with its change."""
    scale = 1 / (1 - float(fitted.values[1]) ** 2)

    def moduli(values: Floats) -> tuple[float, float]:
        return fitted.model.modulus(values), scale * fitted.model.modulus(values)

    modulus, reduced = derived(fitted, moduli, ("MPa", "MPa"))
    covariance = np.zeros((4, 4))
    covariance[0, 0] = (modulus.std or 0.0) ** 2
    nothing = Estimate(
        None, None, None, "1", "the contact's shape is the picture's: there is no stiffness of a punch"
    )
    stated = fitted.parameters[0].prior
    assert stated is not None
    return CalibrationResult(
        youngs_modulus=modulus, poisson_ratio=fitted.estimate("poisson_ratio"), poisson_ratio_source="prior",
        c=replace(nothing, unit="N/mm"), beta=nothing, reduced_modulus=reduced,
        youngs_modulus_of_nu=((float(fitted.values[1]), float(fitted.values[0])),), covariance=covariance,
        fitted=fitted, warnings=(*fitted.warnings, *fitted.data.warnings),
        assumptions=(
            f"E is held to the calibration's, {stated.mean:.4g} +- {stated.std:.2g} MPa, at its nu",
            *common_assumptions(fitted),
        ),
    )  # fmt: skip


def _if_stuck(fitted: Fit, modulus: Estimate) -> tuple[Estimate, str]:
    """Return E with its interval wide enough for a gel that sticks to the body, unless presses were lubricated."""
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
    """Return E that gives the same force at the deepest sample with another nu."""
    k, e = fitted.index("poisson_ratio"), fitted.index("youngs_modulus_MPa")
    deepest = int(np.argmax(fitted.data.depth_mm))
    other: Floats = fitted.values.copy()
    other[k] = nu
    forces = [fitted.model.predict(values, fitted.data)[deepest] for values in (fitted.values, other)]
    return float(fitted.values[e] * forces[0] / forces[1])


def _reduced(fitted: Fit, modulus: Estimate) -> Estimate:
    """Return E/(1 - nu^2), nearly the same at any nu; where nu is open the interval of both ends."""
    low, high = modulus.interval95 or (np.nan, np.nan)
    if modulus.value is None:
        span: Pair = (low / (1 - SILICONE_NU[1] ** 2), high / (1 - SILICONE_NU[0] ** 2))
        return replace(modulus, interval95=span)
    factor = 1 / (1 - float(fitted.values[fitted.index("poisson_ratio")]) ** 2)
    return Estimate(factor * modulus.value, factor * (modulus.std or 0.0), (factor * low, factor * high), "MPa")


def _covariance(fitted: Fit) -> Floats:
    """Return the covariance (4, 4) of E, nu, c, beta; 0 for c, which a round body does not have."""
    places = [fitted.index(name) for name in ("youngs_modulus_MPa", "poisson_ratio", "beta")]
    found = np.zeros((4, 4))
    found[np.ix_([0, 1, 3], [0, 1, 3])] = fitted.covariance[np.ix_(places, places)]
    return found


# From a fit to the material: E, nu, c and beta by the law that was fitted.

AT_BOUND = "beta_at_bound"  # the flag of a slope at the end of its range


def material_by_routes(fitted: Fit) -> CalibrationResult:
    """Return the material of a fit, its interval over all routes to nu where these contradict each other."""
    routes = of_fit(fitted)
    warnings, flags = contradictions(routes)
    return determine_material(fitted, rivals(fitted, routes)).noted(*warnings, flags=flags)


def determine_material(fitted: Fit, contrary: Sequence[Rival] = ()) -> CalibrationResult:
    """Return the material of a fit of any law in the catalogue; a punch's intervals hold `contrary` fits too."""
    if isinstance(fitted.model.law, Resultant):
        found = of_resultants(fitted)
    elif shape_of(fitted.model.law) != FLAT:
        found = of_round(fitted)
    else:
        found = published_route(fitted) if isinstance(fitted.model.law, Paper) else _of_default(fitted, contrary)
    found = replace(found, noise_floor_N=repeatability_rms(fitted))
    checks = (
        (theory.FLAG, theory.outside_gels(found.youngs_modulus)),
        (theory.NU_FLAG, theory.stated_outside_gels(fitted.data.gel)),
        (AT_BOUND, _at_bound(fitted)),
        (RADII_FLAG, radii_apart(fitted)),
    )
    for flag, said in checks:
        found = found.noted(said, flags=[flag]) if said else found
    return found


def _at_bound(fitted: Fit) -> str:
    """Return a warning where a slope beta lies at the end of its range; else ""."""
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


def _of_default(fitted: Fit, contrary: Sequence[Rival]) -> CalibrationResult:
    known = identify(fitted, contrary)
    radius, lines = main_radius(fitted), own_lines(fitted)
    beta = fitted.estimate(beta_name(fitted, radius))  # of a sharp punch, as theory's
    h_mm = fitted.data.gel.thickness_mm
    outside = theory.beta_outside_theory(beta, known.poisson_ratio, a_over_h=radius / h_mm)
    c, bend = next((c, bend) for one, c, bend in lines if one == radius)
    deep = theory.deeper_than_elements(float(np.max(fitted.data.depth_mm)) / h_mm)
    known = replace(known, assumptions=(*common_assumptions(fitted), *known.assumptions))
    return CalibrationResult(
        **{f.name: getattr(known, f.name) for f in fields(known)}, c=c, beta=bend, fitted=fitted, by_radius=lines,
        warnings=(*fitted.warnings, *fitted.data.warnings, *filter(None, (outside, deep))),
        flags=("beta_outside_theory",) if outside else (),
    )  # fmt: skip


# The joint region of E and nu.
#
# At the fitted stiffness c, E(nu) = c (1 - nu^2)/(2 a kappa). The 95 % region follows it:
#
#     nu = nu_0 + k s_nu t,    E = E(nu) (1 +- k s_E sqrt(1 - t^2)),    -1 <= t <= 1,    k^2 = 5.99 (two unknowns)
#
# s_nu the std of nu, s_E the relative one of E at known nu. It reaches down to a gel that sticks to the face,
# where friction is unknown, and up to a rounded edge, where none is stated. Where nothing determines nu the region
# is the band about the curve over silicones' range.

TWO_UNKNOWNS = float(np.sqrt(-2 * np.log(LEVEL)))  # root of the 95 % point of chi square of 2 degrees of freedom
USUAL_NU = 0.3  # the curve begins here unless nu is below
STEPS = 61  # values of nu along the region's edge


def joint_region(result: CalibrationResult) -> tuple[Floats, Floats]:
    """Return the curve (n, 2) of E(nu) in MPa at the fitted c, and the outline (k, 2) of the region in (nu, E)."""
    fitted, ratio, radius = result.fitted, result.poisson_ratio, main_radius(result.fitted)
    nu, modulus, deep = ratio.value, result.youngs_modulus.value, finite_depth(fitted, ratio, radius_mm=radius)
    at = nu or SILICONE_NU[1]

    def curve(places: Floats) -> Floats:
        return np.array(modulus_of_nu(fitted, np.minimum(places, NU_MAX), radius=radius, deep=deep))

    variance, cross, of_nu = result.covariance[0, 0], result.covariance[0, 1], result.covariance[1, 1]
    rest = variance - (cross**2 / of_nu if of_nu > 0 else 0.0)
    relative = np.sqrt(max(rest, 0.0)) / float(fitted.values[fitted.index("youngs_modulus_MPa")])
    if nu is None or modulus is None:
        across = np.linspace(*poisson_range(fitted), STEPS)
        centre, half = curve(across)[:, 1], np.full(STEPS, Z95 * relative)
    else:
        t = np.sin(np.linspace(-np.pi / 2, np.pi / 2, STEPS))  # close where the outline turns
        across = nu + TWO_UNKNOWNS * (ratio.std or 0.0) * t
        keep = (across > 0) & (across < 0.5)
        t, across = t[keep], across[keep]
        centre = modulus * curve(across)[:, 1] / curve(np.array([nu]))[0, 1]
        half = TWO_UNKNOWNS * relative * np.sqrt(1 - t**2)
    surplus = sticking_range(fitted, ratio, radius=radius, assumptions=[])
    surplus = surplus if deep is None else max(surplus, deep.room(at)[0])
    upper = centre * (1 + half) * (1 + usual_softening(fitted, radius, poisson_ratio=at))
    lower = centre * (1 - half) / (1 + surplus)
    region = np.concatenate([np.column_stack([across, upper]), np.column_stack([across, lower])[::-1]])
    begin = max((ratio.interval95 or SILICONE_NU)[0] - 0.05, USUAL_NU if at > USUAL_NU else 0.0)
    return curve(np.linspace(begin, NU_MAX, STEPS)), region


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
    fitted, nu, radius = result.fitted, result.poisson_ratio, main_radius(result.fitted)
    if stated_edge_mm(fitted, radius) is not None:
        return result
    share = usual_softening(fitted, radius, poisson_ratio=SILICONE_NU[1] if nu.value is None else nu.value)
    edge, more = fitted.data.gel.thickness_mm * EDGE_OVER_H, f"{100 * share:.1f} %"
    if finite_depth(fitted, nu, radius_mm=radius) is None:
        said = f"E may be higher by up to {more} where the punch's edge is rounded by {edge:.2g} mm"
    else:
        said = f"E is that of one rounded by {edge:.2g} mm; rounded twice as much, it would be some {more} higher"
    said = f"no edge radius is stated: {said}; E's interval allows for that"
    return replace(
        result,
        youngs_modulus=reaching_up(result.youngs_modulus, share),
        reduced_modulus=reaching_up(result.reduced_modulus, share),
        assumptions=(*result.assumptions, said),
    )
