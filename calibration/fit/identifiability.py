"""Which of E and nu the data determine, and which rest on a prior or an assumption.

One punch determines its stiffness c and the curve E(nu) = c (1 - nu^2) / (2 a kappa(nu, a/h)), not nu: E falls by
about 4 % for .01 of nu. nu comes from a stated prior, from the bulge next to the punch, or from several radii.
Where none of them determines it, E and nu have no value but an interval, by the range of silicones. A dry punch of
one radius has the finite elements' E at the presses' depths (finite_depth.py) where beta lies in the range of
contact laws; kappa's E is then inside the interval. Elsewhere unknown friction extends E's interval downwards by
the surplus of a sticking gel.

Friction and a rounded edge change the stiffness of each radius by another share, like another nu. Where neither is
stated, nu and E must hold for each such rival model: one that fits worse by chi^2 = D may be present in part, and
a share t of it costs t^2 D, so 95 % intervals extend a share 1.96/sqrt(D) of the way to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.fit.finite_depth import FiniteDepth, finite_depth, stated_edge_mm, straight_line
from calibration.fit.least_squares import Fit, fit_again, quantile95
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import NU_TABLE, OPEN_NU, STATED_NU_STD, FlatPunch
from calibration.laws.theory import GEL_MODULUS_MPA, punch_stiffness, sticking_surplus
from calibration.model.composition import Model
from calibration.model.stages import EDGE, STICKING
from tactilevision.errors import ConvergenceError
from tactilevision.mechanics.tables.punch import EDGE_OVER_H
from tactilevision.records.constants import NU_MAX, NU_SILICONE, ROUNDING, TAILS95, TINY, Z95
from tactilevision.records.measured import Estimate, Floats, Pair

Function = Callable[[Floats], Sequence[float]]  # of the parameters (p,): quantities (k,)
NODES = 201  # nu at which E's interval is taken
UNFIXED = 0.6  # of the range of nu: several radii determine nu where its interval is shorter
KEPT = 4  # fits whose rivals are cached
STEP = 1e-4  # of a parameter's scale, for derivatives


@dataclass(frozen=True, slots=True)
class Rival:
    """Another fit of the same presses (None: it cannot be fitted), and the share of the way to it that is open."""

    fitted: Fit | None
    share: float


@lru_cache(maxsize=KEPT)
def _rivals(fitted: Fit) -> tuple[Rival, ...]:
    """Return fits with a sticking gel, rounded edges, and both; none where nu is fixed.

    Where one cannot be fitted, all of silicones' nu.
    """
    law, data = fitted.model.law, fitted.data
    fixed = fitted.parameters[fitted.index("poisson_ratio")].fixed
    if fixed or np.unique(data.presses.radius_mm).size == 1 or not isinstance(law, FlatPunch):
        return ()
    known = _fits(fitted, EDGE) or all(i.edge_radius_mm is not None for i in data.indenters)
    try:
        sticking = stuck(fitted)
        laws = [law] if sticking is None else [law, replace(law, sticking=1.0)]
        fits = [] if known else [_again(fitted, one, with_usual_edges(data)) for one in laws]
    except ConvergenceError:
        return (Rival(None, 1.0),)
    fits += [] if sticking is None else [sticking]
    return tuple(Rival(one, min(Z95 / max(one.chi2 - fitted.chi2, TINY) ** 0.5, 1.0)) for one in fits)


@lru_cache(maxsize=KEPT)
def stuck(fitted: Fit) -> Fit | None:
    """Return the fit with a sticking gel; None where it already sticks or slides, or its friction is fitted.

    Raises ConvergenceError where it cannot be fitted.
    """
    law = fitted.model.law
    slides = fitted.data.lubricated or _fits(fitted, STICKING)
    if slides or not isinstance(law, FlatPunch) or law.sticking == 1:
        return None
    return _again(fitted, replace(law, sticking=1.0), fitted.data)


def _fits(fitted: Fit, condition: str) -> bool:
    return any(effect.condition == condition for effect in fitted.model.effects)


def _again(fitted: Fit, law: FlatPunch, data: Observations) -> Fit:
    return fit_again(replace(fitted, model=Model(law, fitted.model.effects)), data=data)


def with_usual_edges(data: Observations) -> Observations:
    """Return the data with the usual edge radius for each indenter that states none."""
    usual = EDGE_OVER_H * data.gel.thickness_mm
    edges = (usual if i.edge_radius_mm is None else i.edge_radius_mm for i in data.indenters)
    pairs = zip(data.indenters, edges, strict=True)
    return replace(data, indenters=tuple(replace(i, edge_radius_mm=edge) for i, edge in pairs))


@dataclass(frozen=True, slots=True)
class Identified:
    """E and nu as far as they are determined.

    `youngs_modulus_of_nu` pairs (nu, E) at the fitted c; `covariance` (4, 4) is of E, nu, c and beta.
    """

    youngs_modulus: Estimate
    poisson_ratio: Estimate
    poisson_ratio_source: str
    reduced_modulus: Estimate
    youngs_modulus_of_nu: tuple[Pair, ...]
    covariance: Floats
    assumptions: tuple[str, ...]


def identify(fitted: Fit, contrary: Sequence[Rival] = ()) -> Identified:
    """Return E and nu from a fit of the FlatPunch law with any effects; the intervals hold `contrary` fits too."""
    radius = main_radius(fitted)
    assumptions: list[str] = []
    own = _rivals(fitted)
    others = (*own, *contrary)
    nu, source = _poisson(fitted, others, assumptions, contrary=bool(contrary))
    deep = finite_depth(fitted, nu, radius_mm=radius)
    assumptions += [] if deep is None else [deep.words(NU_MAX if nu.value is None else nu.value)]
    surplus = sticking_range(fitted, nu, radius=radius, assumptions=[] if deep else assumptions)
    fits = [] if nu.value is None else [(one.fitted, one.share) for one in others if one.fitted is not None]
    surplus = 0.0 if len(fits) > len(contrary) else surplus  # a sticking gel is one of them

    def modulus(reduced: bool) -> Estimate:
        spread = _spread(fitted, nu, radius, reduced=reduced)
        found = _modulus(spread, nu, surplus)
        found = found if deep is None else _of_elements(spread, nu, deep, small_strain=found)
        for other, share in fits:
            at = other.estimate("poisson_ratio")
            theirs = _modulus(_spread(other, at, radius, reduced=reduced), at, 0.0)
            found = holding(found, theirs.interval95, share=share)
        return found

    youngs, reduced, covariance = modulus(reduced=False), modulus(reduced=True), _covariance(fitted, radius, deep)
    if contrary:
        wide = [_as_wide(one) for one in (youngs, nu, reduced)]
        sizes = np.array([(w.std or 0.0) / (one.std or 1.0) for w, one in zip(wide, (youngs, nu), strict=False)])
        youngs, nu, reduced = wide
        covariance = covariance * np.outer(*[np.append(sizes, (1.0, 1.0))] * 2)
    return Identified(
        youngs_modulus=youngs,
        poisson_ratio=nu,
        reduced_modulus=reduced,
        poisson_ratio_source=source,
        covariance=covariance,
        youngs_modulus_of_nu=modulus_of_nu(fitted, np.array(NU_TABLE), radius=radius, deep=deep),
        assumptions=tuple(assumptions),
    )


def _as_wide(one: Estimate) -> Estimate:
    """Return the estimate with a std whose interval is as long as its own."""
    low, high = one.interval95 or (0.0, 0.0)
    return replace(one, std=max(one.std or 0.0, (high - low) / (2 * Z95)))


def main_radius(fitted: Fit) -> float:
    """Return the radius with the most presses: c and beta are reported for it."""
    radii, counts = np.unique(fitted.data.presses.radius_mm, return_counts=True)
    return float(radii[np.argmax(counts)])


def beta_name(fitted: Fit, radius: float) -> str:
    """Return the name of this radius's beta."""
    return "beta" if np.unique(fitted.data.presses.radius_mm).size == 1 else f"beta[{radius:g}]"


def _of_elements(spread: _Spread, nu: Estimate, deep: FiniteDepth, *, small_strain: Estimate) -> Estimate:
    """Return E over F; its interval allows for other frictions and a sharp edge, and includes kappa's."""
    at = NU_MAX if nu.value is None else nu.value
    lower, higher = deep.room(at)
    by_elements = replace(spread, modulus=spread.modulus / deep.share(spread.nodes))
    found = reaching_up(_modulus(by_elements, nu, lower), higher)
    return holding(found, small_strain.interval95)


@dataclass(frozen=True, slots=True)
class _Spread:
    """E at each possible nu: nodes (k,), their weights, E (k,), and the relative std of E at known nu."""

    nodes: Floats
    weights: Floats
    modulus: Floats
    relative_std: float
    reach: float

    def quantile(self, share: float) -> float:
        """Return the quantile of the mixture of normals, widened by Student's quantile over the normal one."""
        std = self.modulus * (self.relative_std * self.reach / quantile95(np.inf) + 1e-12)
        return mixture_quantile(share, self.weights, self.modulus, std)


def mixture_quantile(share: float, weight: Floats, mean: Floats, std: Floats) -> float:
    """Return the quantile at `share` of a mixture of normals (k,), in their unit."""
    from scipy.optimize import brentq
    from scipy.special import ndtr

    low, high = mean.min() - 12 * std.max(), mean.max() + 12 * std.max()
    tolerance = ROUNDING * max(abs(low), abs(high))
    return float(brentq(lambda x: float(weight @ ndtr((x - mean) / std)) - share, low, high, xtol=tolerance))


def _poisson(
    fitted: Fit, others: Sequence[Rival], assumptions: list[str], *, contrary: bool
) -> tuple[Estimate, str]:
    """Return nu and its source; no value where nothing determines it. Its interval extends to `others`."""
    k = fitted.index("poisson_ratio")
    parameter = fitted.parameters[k]
    several = np.unique(fitted.data.presses.radius_mm).size > 1
    stated, possible = fitted.data.gel.poisson_ratio, poisson_range(fitted)
    low, high = possible
    if stated is not None:
        if fitted.data.gel.poisson_ratio_std is None:
            assumptions.append(f"poisson_ratio = {stated:g} is stated without a std; {STATED_NU_STD:g} is assumed")
        if parameter.fixed:
            assumptions.append(f"poisson_ratio = {stated:g} is taken as exact, as stated")
            return Estimate(stated, 0.0, (stated, stated), "1"), "prior"
        found = _reaching(fitted.estimate("poisson_ratio"), others)
        prior_std = parameter.prior.std if parameter.prior else np.inf
        sharpened = several and fitted.std("poisson_ratio") < 0.7 * prior_std
        return found, "radii" if sharpened else "prior"
    if several and not parameter.fixed:
        found = _reaching(fitted.estimate("poisson_ratio"), others)
        if contrary or np.ptp(found.interval95 or possible) < UNFIXED * (high - low):
            return found, "radii"
    kinds = {NU_SILICONE: "silicone gels lie", OPEN_NU: "tabulated gels lie"}
    kind = kinds.get(possible, "the rise next to the punch leaves it")
    assumptions.append(f"these data do not determine poisson_ratio; {kind} in [{low:.4g}, {high:.4g}]")
    why = "one punch radius determines the stiffness c and the curve E(nu), not nu"
    if several:
        why = "the radii differ too little for these errors to determine nu"
        begin, end = fitted.estimate("poisson_ratio").interval95 or possible
        if not parameter.fixed and min(end, high) - max(begin, low) < UNFIXED * (high - low):
            why = f"the radii give nu from {begin:.4g} to {end:.4g}, unknown friction and edges most of its range"
    return Estimate(None, None, possible, "1", why), "prior"


def poisson_range(fitted: Fit) -> Pair:
    """Return the range of nu where nothing determines it."""
    law = fitted.model.law
    return law.poisson_range if isinstance(law, FlatPunch) else NU_SILICONE


def _reaching(nu: Estimate, others: Sequence[Rival]) -> Estimate:
    for other in others:
        theirs = NU_SILICONE if other.fitted is None else other.fitted.estimate("poisson_ratio").interval95
        nu = holding(nu, theirs, share=other.share)
    return nu


def holding(one: Estimate, other: Pair | None, *, share: float = 1.0) -> Estimate:
    """Return the estimate with its interval extended to another one's ends, or this share of the way."""
    if one.interval95 is None or other is None:
        return one
    low, high = one.interval95
    return replace(one, interval95=(low + share * min(other[0] - low, 0), high + share * max(other[1] - high, 0)))


def reaching_up(one: Estimate, share: float) -> Estimate:
    """Return the estimate with its upper end raised by this share of its value, as the root of squares."""
    if one.interval95 is None:
        return one
    low, high = one.interval95
    middle = high if one.value is None else one.value
    return replace(one, interval95=(low, middle + float(np.hypot(high - middle, share * middle))))


def sticking_range(fitted: Fit, nu: Estimate, *, radius: float, assumptions: list[str]) -> float:
    """Return the share by which E may be lower because the gel sticks; 0 for lubricated presses."""
    sticks = isinstance(fitted.model.law, FlatPunch) and fitted.model.law.sticking == 1
    if fitted.data.lubricated or sticks:
        wet = "the presses were lubricated: no friction"
        assumptions.append(wet if fitted.data.lubricated else "the gel sticks to the indenter's face")
        return 0.0
    surplus: float = sticking_surplus(
        NU_MAX if nu.value is None else nu.value, radius / fitted.data.gel.thickness_mm
    )
    assumptions.append(
        f"friction is unknown: kappa is frictionless, and E may be lower by up to {100 * surplus:.1f} % where the "
        "gel sticks, which E's interval includes"
    )
    return surplus


def _line(fitted: Fit, values: Floats, radius: float) -> Pair:
    """Return c and beta of one radius at these parameters: of the line through P/w with the stated edge."""
    stiffness = fitted.model.state(values, fitted.data).stiffness_N_per_mm
    sharp = float(np.median(stiffness[fitted.data.radius_mm == radius]))
    nu, beta = (float(values[fitted.index(name)]) for name in ("poisson_ratio", beta_name(fitted, radius)))
    edge = stated_edge_mm(fitted, radius) or 0.0
    start, slope = straight_line(fitted, radius, edge_mm=edge, poisson_ratio=nu, beta=beta)
    return sharp * start, slope


def stiffness_of(fitted: Fit, radius: float) -> Estimate:
    """Return c of one radius, N/mm: the intercept of the line through P/w, not below 0."""
    found = derived(fitted, lambda v: _line(fitted, v, radius)[:1], ["N/mm"])[0]
    low, high = found.interval95 or (0.0, 0.0)
    return replace(found, interval95=(max(low, 0.0), high))


def bend_of(fitted: Fit, radius: float) -> Estimate:
    """Return beta of one radius: the slope of that line over its intercept."""
    if not stated_edge_mm(fitted, radius):
        return fitted.estimate(beta_name(fitted, radius))
    return derived(fitted, lambda v: _line(fitted, v, radius)[1:], ["1"])[0]


def derived(
    fitted: Fit, function: Function, units: Sequence[str], *, step: float = STEP, why: str = ""
) -> list[Estimate]:
    """Return functions (k,) of the parameters (p,), in their units, with std by the delta method.

    None with the reason `why` where one is not finite.
    """
    found = []
    rows = zip(function(fitted.values), gradient(fitted, function, step=step), units, strict=True)
    for value, slope, unit in rows:
        std = float(np.sqrt(slope @ fitted.covariance @ slope))
        reach = fitted.reach(slope) * std
        known = Estimate(float(value), std, (float(value - reach), float(value + reach)), unit)
        found.append(known if np.isfinite(value) else Estimate(None, None, None, unit, why))
    return found


def gradient(fitted: Fit, function: Function, *, step: float = STEP) -> Floats:
    """Return the derivatives (k, p) of functions of the parameters, per their units, by central differences."""
    slopes = np.zeros((len(function(fitted.values)), fitted.values.size))
    for k in np.flatnonzero(fitted.free):
        side = step * fitted.parameters[k].scale * np.eye(fitted.values.size)[k]
        ahead, behind = (np.array(function(fitted.values + s)) for s in (side, -side))
        slopes[:, k] = (ahead - behind) / (2 * side[k])
    return np.nan_to_num(slopes)


def _spread(fitted: Fit, nu: Estimate, radius: float, *, reduced: bool) -> _Spread:
    """Return E over nu: on one radius along the exact curve E(nu), on several along the fit's own slope.

    `reduced`: E/(1 - nu^2) instead.
    """
    from scipy.special import ndtri

    e, k = fitted.index("youngs_modulus_MPa"), fitted.index("poisson_ratio")
    value, variance, cross = fitted.values[e], fitted.covariance[e, e], fitted.covariance[e, k]
    nu_variance, centre = fitted.covariance[k, k], float(fitted.values[k])
    rest = variance - (cross**2 / nu_variance if nu_variance > 0 else 0.0)
    if nu.value is None:
        nodes = np.linspace(*poisson_range(fitted), NODES)
    elif nu.std == 0:
        nodes = np.array([nu.value])
    else:
        nodes = centre + np.sqrt(nu_variance) * ndtri((np.arange(NODES) + 0.5) / NODES)
        nodes = nodes[(nodes > 0) & (nodes <= NU_MAX)] if centre < NU_MAX else np.array([centre])
    slope = cross / nu_variance if nu_variance > 0 else 0.0
    if np.unique(fitted.data.presses.radius_mm).size == 1 or nu.value is None:
        modulus = value * _unit(fitted, centre, radius) / np.array([_unit(fitted, n, radius) for n in nodes])
    else:
        modulus = value * np.exp(slope / value * (nodes - centre))
    modulus = modulus / (1 - nodes**2) if reduced else modulus
    relative = float(np.sqrt(max(rest, 0.0)) / value)
    at_nu = np.eye(fitted.values.size)[e]
    at_nu[k] = -slope  # E at a given nu
    reach = fitted.reach(at_nu)
    return _Spread(nodes, np.full(nodes.size, 1 / nodes.size), modulus, relative, reach)


def _unit(fitted: Fit, nu: float, radius: float) -> float:
    thickness = fitted.data.gel.thickness_mm
    return float(punch_stiffness(1.0, float(nu), radius_mm=np.array([radius]), thickness_mm=thickness)[0])


def _modulus(spread: _Spread, nu: Estimate, surplus: float) -> Estimate:
    """Return E (or E*) with its interval; no value where nu has none."""
    if nu.value is None:
        reach = spread.reach * spread.relative_std
        low, high = spread.modulus.min() * max(1 - reach, 0.0) / (1 + surplus), spread.modulus.max() * (1 + reach)
        why = "it follows from c only at a known Poisson's ratio: see youngs_modulus_of_nu"
        return Estimate(None, None, (float(low), float(high)), "MPa", why)
    if spread.reach * spread.relative_std >= 1:  # the interval reaches 0: nothing is determined
        why = "another parameter takes its place in these data; the interval is the range of gels"
        return Estimate(None, None, GEL_MODULUS_MPA, "MPa", why)
    mean = float(np.interp(nu.value, spread.nodes, spread.modulus))
    low, high = map(spread.quantile, TAILS95)
    std = float(np.sqrt(np.var(spread.modulus) + np.mean((spread.modulus * spread.relative_std) ** 2)))
    return Estimate(mean, std, (low / (1 + surplus), high), "MPa")


def modulus_of_nu(
    fitted: Fit, poisson_ratios: Floats, *, radius: float, deep: FiniteDepth | None = None
) -> tuple[Pair, ...]:
    """Return (nu, E in MPa) for each of `poisson_ratios` (n,), at the fitted stiffness of `radius` in mm."""
    modulus, nu = (float(fitted.values[fitted.index(n)]) for n in ("youngs_modulus_MPa", "poisson_ratio"))
    stiffness = modulus * _unit(fitted, nu, radius)
    shares = np.ones(poisson_ratios.size) if deep is None else deep.share(poisson_ratios)
    return tuple(
        (float(one), float(stiffness / _unit(fitted, float(one), radius) / share))
        for one, share in zip(poisson_ratios, shares, strict=True)
    )


def _covariance(fitted: Fit, radius: float, deep: FiniteDepth | None) -> Floats:
    """Return the covariance (4, 4) of E, nu, c, beta by the delta method; an open nu is fixed."""
    e, k = fitted.index("youngs_modulus_MPa"), fitted.index("poisson_ratio")

    def quantities(values: Floats) -> tuple[float, ...]:
        share = 1.0 if deep is None else float(deep.share(values[k]))
        return (values[e] / share, values[k], *_line(fitted, values, radius))

    rows = gradient(fitted, quantities)
    return np.asarray(rows @ fitted.covariance @ rows.T)
