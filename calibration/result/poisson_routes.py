"""The routes to Poisson's ratio, their combination and their agreement.

    bulge   the rise of the gel outside the contact, from the pictures: independent of force, hardly of friction
    radii   punches of several radii depend on the bonded base to different degrees
    prior   what recording.toml states; where it states nothing, the range of elastomers
    beta    the published log law of the curvature: shown and never used, since beta depends on friction and the
            constitutive law more than on nu

Independent routes are combined by their variances. Where they contradict each other the std grows by Birge's
ratio, and beyond CONTRARY the interval reaches to each. Source: Birge, Phys. Rev. 40 (1932) 207.

The range is no measurement. Solid elastomers are nearly incompressible (nu above .495: Nedoluha, Saadawi, Barney,
Soft Matter 2025, doi 10.1039/d5sm00535c); .45 allows for pads of cast silicone in place. The pictures' nu is
truncated there; one that contradicts the bound is kept, its std reaches towards the bound, and it is flagged
`nu_below_bound`: a foam, or an error of the pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calibration.fit.least_squares import Fit, fit
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import OPEN_NU, SILICONE_NU, STATED_NU_STD, FlatPunch
from calibration.laws.paper import poisson_from_beta
from calibration.model.composition import Model
from tactilevision.errors import ConvergenceError
from tactilevision.records.constants import NU_MAX, TAILS95, Z95
from tactilevision.records.measured import Estimate, Pair
from tactilevision.records.rig import Gel

AT_BOUND = 1e-4  # of nu: nearer to its bound a fit lies at it
REACH = 1.95  # std: slightly less than half of a 95 % interval
CONTRARY = 3  # std between two routes that contradict each other
BELOW_SIGMA = 2  # std below the bound at which nu contradicts it
CUT_SIGMA = 3  # std above the bound from which truncation is negligible
BELOW_BOUND = "nu_below_bound"  # the flag of a nu that contradicts the bound


@dataclass(frozen=True, slots=True)
class Route:
    """Poisson's ratio by one route; `used` where it is part of the result."""

    name: str
    poisson_ratio: Estimate
    used: bool


def of_bulge(bulge: Estimate | None) -> tuple[Route, ...]:
    """Return the route by the pictures."""
    return () if bulge is None else (Route("bulge", bulge, used=bulge.value is not None and bool(bulge.std)),)


def of_prior(gel: Gel, *, bulge: Estimate | None = None, bound: Pair | None = None) -> tuple[Route, ...]:
    """Return the stated nu, its std STATED_NU_STD unless stated; else the bound, used where it cuts `bulge`."""
    if gel.poisson_ratio is None:
        if bound is None:
            return ()
        limits = Estimate(
            None, None, bound, "1", f"{bound[0]:g} to {bound[1]:g}: a bound of elastomers, no measurement"
        )
        return (Route("prior", limits, used=within(bulge, bound) != bulge),)
    std = STATED_NU_STD if gel.poisson_ratio_std is None else gel.poisson_ratio_std
    return (Route("prior", Estimate.normal(gel.poisson_ratio, std, "1"), used=True),)


def of_radii(fitted: Fit) -> tuple[Route, ...]:
    """Return nu by several radii alone, from the same fit without a prior of nu; nothing for a single radius."""
    data, law = fitted.data, fitted.model.law
    if np.unique(data.presses.radius_mm).size < 2 or not isinstance(law, FlatPunch):
        return ()
    alone = replace(data, gel=replace(data.gel, poisson_ratio=None, poisson_ratio_std=None))
    try:
        found = fit(
            Model(replace(law, free_poisson_ratio=True), fitted.model.effects),
            alone,
            tolerances=False,
            noise=fitted.noise,
        )
    except ConvergenceError:
        return ()
    estimate = found.estimate("poisson_ratio")
    low, high = found.parameters[found.index("poisson_ratio")].bounds
    value = estimate.value or 0.0
    inside = low + AT_BOUND < value < high - AT_BOUND and bool(estimate.std)
    if not inside:
        estimate = replace(estimate, value=None, std=None, why="the radii differ too little for these errors")
    return (Route("radii", estimate, used=inside),)


def of_fit(fitted: Fit) -> tuple[Route, ...]:
    """Return the prior of nu of a fit and nu by its radii without that; nothing unless there are both."""
    gel = fitted.data.gel
    radii = () if gel.poisson_ratio is None else of_radii(fitted)
    return (*of_prior(gel), *radii) if radii else ()


def of_beta(beta: Estimate) -> tuple[Route, ...]:
    """Return the published log law at the ends and the middle of beta's interval; nothing for beta <= 0."""
    if beta.value is None or beta.interval95 is None or not beta.interval95[0] > 0:
        return ()
    value, low, high = (poisson_from_beta(b) for b in (beta.value, *beta.interval95))
    note = "the published log law: a reproduction, no measurement of nu"
    return (Route("beta", Estimate(value, (high - low) / (2 * Z95), (low, high), "1", note), used=False),)


def within(nu: Estimate | None, bound: Pair | None) -> Estimate | None:
    """Return nu truncated at a lower bound: mean and std of the truncated normal.

    One that contradicts the bound keeps its value, and its std reaches half-way to the bound.
    """
    if nu is None or nu.value is None or not nu.std or bound is None:
        return nu
    from scipy.stats import truncnorm

    beyond = (bound[0] - nu.value) / nu.std
    if beyond < -CUT_SIGMA:
        return nu
    if contradicts(nu, bound):
        return Estimate.normal(nu.value, max(nu.std, (bound[0] - nu.value) / 2), nu.unit)
    cut = truncnorm(beyond, np.inf, loc=nu.value, scale=nu.std)
    low, high = cut.ppf(TAILS95)
    return replace(nu, value=float(cut.mean()), std=float(cut.std()), interval95=(float(low), float(high)))


def narrowed(bound: Pair | None, bulge: Estimate | None) -> Pair | None:
    """Return the bound, cut from below by the interval of a rise that leaves nu open (at the end of its range)."""
    low, high = bound or OPEN_NU
    if bulge is None or bulge.value is not None or bulge.interval95 is None:
        return bound
    return (bulge.interval95[0], high) if low < bulge.interval95[0] < high else bound


def contradicts(nu: Estimate | None, bound: Pair | None) -> bool:
    """Return whether a nu lies below the bound by more than BELOW_SIGMA std."""
    if nu is None or nu.value is None or not nu.std or bound is None:
        return False
    return bound[0] - nu.value > BELOW_SIGMA * nu.std


def informed(data: Observations, bulge: Estimate | None, *, bound: Pair | None = SILICONE_NU) -> Observations:
    """Return the data with the pictures' nu combined with the gel's prior; a nu stated as exact stays.

    Where nothing is stated of nu, it is truncated at `bound`, None: not.
    """
    bulge = within(bulge, bound) if data.gel.poisson_ratio is None else bulge
    routes = [route for route in (*of_bulge(bulge), *of_prior(data.gel)) if route.used]
    if not any(route.name == "bulge" for route in routes) or data.gel.poisson_ratio_std == 0:
        return data
    values = np.array([route.poisson_ratio.value for route in routes])
    stds = np.array([route.poisson_ratio.std for route in routes])
    mean = float(np.average(values, weights=stds**-2.0))
    std = float(np.sum(stds**-2.0) ** -0.5) * max(apart(routes), 1.0)
    if apart(routes) > CONTRARY:
        std = max(std, _reach(mean, routes))
    gel = replace(data.gel, poisson_ratio=min(mean, NU_MAX), poisson_ratio_std=std)
    return replace(data, gel=gel)


def apart(routes: Sequence[Route]) -> float:
    """Return the largest distance, in std, between two of the routes that are used; 0 for fewer than two."""
    known = [(r.poisson_ratio.value, r.poisson_ratio.std or 0.0) for r in routes if r.used]
    pairs = combinations([(value, std) for value, std in known if value is not None], 2)
    gaps = ((abs(a - b), float(np.hypot(s, t))) for (a, s), (b, t) in pairs)
    return max((gap / spread for gap, spread in gaps if spread > 0), default=0.0)


def tightest(routes: Sequence[Route]) -> str:
    """Return the name of the used route with the smallest std; "prior" where there is none."""
    known = [route for route in routes if route.used and route.poisson_ratio.std is not None]
    return min(known, key=lambda route: route.poisson_ratio.std or 0.0).name if known else "prior"


def holding_each(fitted: Fit, routes: Sequence[Route]) -> Fit:
    """Return the fit with nu's std so large, where its routes contradict each other, that its interval holds each.

    The covariance with E and c grows along; a fixed nu stays.
    """
    if apart(routes) <= CONTRARY:
        return fitted
    k = fitted.index("poisson_ratio")
    std = float(np.sqrt(fitted.covariance[k, k]))
    if std <= 0:
        return fitted
    wider = max(std, _reach(float(fitted.values[k]), routes))
    along = fitted.covariance[:, k] / std
    return replace(fitted, covariance=fitted.covariance + (wider**2 / std**2 - 1) * np.outer(along, along))


def _reach(nu: float, routes: Sequence[Route]) -> float:
    """Return the std with which the interval about `nu` holds every route that is used."""
    known = [r.poisson_ratio.value for r in routes if r.used and r.poisson_ratio.value is not None]
    return max(abs(nu - one) for one in known) / REACH


def in_words(routes: Sequence[Route]) -> tuple[list[str], list[str]]:
    """Return assumptions and warnings: nu by each route, and the distance of those that were used."""
    words = {
        "bulge": "the rise outside the contact",
        "radii": "the several radii",
        "prior": "the stated value",
        "beta": "the published law of beta (not used)",
    }
    said = [
        f"{words[r.name]} {r.poisson_ratio.value:.4f} ± {r.poisson_ratio.std or 0.0:.2g}"
        for r in routes
        if r.poisson_ratio.value is not None
    ]
    between = apart(routes)
    used = sum(route.used for route in routes)
    lines = ["Poisson's ratio by route: " + "; ".join(said)] if said else []
    if used > 1:
        lines.append(f"the routes to Poisson's ratio that were used lie {between:.1f} standard deviations apart")
    silent = []
    for r in (one for one in routes if one.poisson_ratio.value is None):
        if r.name != "prior":
            silent.append(f"{words[r.name]} does not determine it: {r.poisson_ratio.why}")
        elif r.used:
            silent.append(f"Poisson's ratio is held to {r.poisson_ratio.why}")
    return [*lines, *silent], contradictions(routes)


def contradictions(routes: Sequence[Route]) -> list[str]:
    """Return a warning where the routes that are used contradict each other."""
    between = apart(routes)
    if between <= CONTRARY:
        return []
    exact = any(route.name == "prior" and route.poisson_ratio.std == 0 for route in routes)
    return [
        f"the routes to Poisson's ratio contradict each other by {between:.1f} standard deviations: "
        + ("it is taken as stated" if exact else "its interval is widened to reach to each")
        + ". Check the stated one, the thickness and the radii"
    ]
