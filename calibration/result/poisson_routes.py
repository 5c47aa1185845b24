"""The routes to Poisson's ratio, their combination and their agreement.

    bulge   the rise of the gel outside the contact, from the pictures: independent of force, hardly of friction
    radii   punches of several radii depend on the bonded base to different degrees
    prior   what recording.toml states; where it states nothing, the range of elastomers
    beta    the published log law of the curvature: shown and never used, since beta depends on friction and the
            constitutive law more than on nu

The radii's is a profile likelihood D(nu), others' ((nu - value) / std)^2, the bound's 0 inside. Two routes lie

    sqrt(min (D_1 + D_2))

standard deviations apart, |a - b| / hypot(s, t) for two normal ones; it also holds for a best at the end of the
range. Independent routes are combined by their variances. Where they contradict each other the std grows by
Birge's ratio, and beyond CONTRARY, flagged `routes_contradict`, the intervals of nu and E reach to each. Sources:
Wilks, Ann. Math. Stat. 9 (1938) 60; Birge, Phys. Rev. 40 (1932) 207.

The range is no measurement. Solid elastomers are nearly incompressible (nu above .495: Nedoluha, Saadawi, Barney,
Soft Matter 2025, doi 10.1039/d5sm00535c); .45 allows for pads of cast silicone in place. The pictures' nu is
truncated there; a nu that contradicts the bound is kept and flagged `nu_below_bound`: a foam, or an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from calibration.effects import EFFECTS
from calibration.fit.identifiability import Rival
from calibration.fit.least_squares import Fit, fit
from calibration.fit.profile_likelihood import Profile, profile
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import OPEN_NU, SILICONE_NU, STATED_NU_STD, FlatPunch
from calibration.laws.paper import poisson_from_beta
from calibration.model.composition import Model
from calibration.model.stages import THICKNESS
from tactilevision.errors import ConvergenceError
from tactilevision.records.constants import MICRO, NU_MAX, TAILS95, TINY, Z95
from tactilevision.records.measured import Estimate, Floats, Pair
from tactilevision.records.rig import Gel

REACH = 1.95  # std: slightly less than half of a 95 % interval
CONTRARY = 3  # std between two routes that contradict each other
FLAT = 0.6  # of its range: an interval as long shows that the radii do not determine nu
STEPS = 4001  # places between two routes at which the sum of their D is taken
CONTRADICT = "routes_contradict"  # the flag of routes that contradict each other
BELOW_BOUND = "nu_below_bound"  # the flag of a nu that contradicts the bound
WORDS = {
    "bulge": "the rise outside the contact",
    "radii": "the several radii",
    "prior": "the stated value",
    "beta": "the published law of beta (not used)",
}  # each route in a sentence


@dataclass(frozen=True, slots=True)
class Route:
    """Poisson's ratio by one route; `used` where it is part of the result; `profile` of the radii."""

    name: str
    poisson_ratio: Estimate
    used: bool
    profile: Profile | None = None

    @property
    def is_bound(self) -> bool:
        """Whether it is a range without a value."""
        return self.name == "prior" and self.poisson_ratio.value is None

    def deviance(self, nu: Floats) -> Floats:
        """Return D at nu (n,)."""
        found = self.poisson_ratio
        if self.profile is not None:
            return self.profile(nu)
        if found.value is not None and found.std:
            return ((nu - found.value) / found.std) ** 2
        low, high = found.interval95 or (0.0, 0.0)
        return np.where((low <= nu) & (nu <= high), 0.0, np.inf)

    def nearest(self, other: Route) -> float:
        """Return its value, or the place in its range nearest to another's value."""
        value = self.poisson_ratio.value
        return float(np.clip(other.poisson_ratio.value or 0.0, *self._range)) if value is None else value

    @property
    def _range(self) -> Pair:
        return self.poisson_ratio.interval95 or OPEN_NU

    def __str__(self) -> str:
        found = self.poisson_ratio
        if found.value is None:
            return f"the bound of elastomers {self._range[0]:g} to {self._range[1]:g}"
        low, high = self._range
        if (self.profile is not None and found.value - low < MICRO) or high - found.value < MICRO:
            return f"{WORDS[self.name]} {found.value:.4f} ({low:.4f} to {high:.4f})"
        return f"{WORDS[self.name]} {found.value:.4f} ± {found.std or 0.0:.2g}"


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
    """Return nu by several radii alone, by its profile likelihood without a prior; nothing for a single radius."""
    data, law = fitted.data, fitted.model.law
    if np.unique(data.presses.radius_mm).size < 2 or not isinstance(law, FlatPunch):
        return ()
    alone = replace(data, gel=replace(data.gel, poisson_ratio=None, poisson_ratio_std=None))
    model = Model(replace(law, free_poisson_ratio=True), fitted.model.effects)
    try:
        found = fit(model, alone, tolerances=False, noise=fitted.noise, starts=fitted.values[None])
        likelihood = profile(found, "poisson_ratio")
    except ConvergenceError:
        return ()
    k, (low, high) = found.index("poisson_ratio"), likelihood.interval95
    std = (high - low) / Z95 if found.at_bound[k] else found.std("poisson_ratio")
    interval = (low, high)
    if high - low >= FLAT * np.ptp(likelihood.nodes):
        why = f"their likelihood is nearly flat from {low:.3g} to {high:.3g}"
        return (Route("radii", Estimate(None, None, interval, "1", why), used=False),)
    estimate = Estimate(likelihood.best, std, interval, "1")
    return (Route("radii", estimate, used=True, profile=likelihood),)


def of_fit(fitted: Fit) -> tuple[Route, ...]:
    """Return what is known of nu beforehand and nu by the radii without that; nothing unless there are both."""
    law = fitted.model.law
    bound = law.poisson_range if isinstance(law, FlatPunch) else None
    radii = of_radii(fitted)
    return (*of_prior(fitted.data.gel, bound=bound), *radii) if radii else ()


def of_beta(beta: Estimate) -> tuple[Route, ...]:
    """Return the published log law at the ends and the middle of beta's interval; nothing for beta <= 0."""
    if beta.value is None or beta.interval95 is None or not beta.interval95[0] > 0:
        return ()
    value, low, high = (poisson_from_beta(b) for b in (beta.value, *beta.interval95))
    note = "the published log law: a reproduction, no measurement of nu"
    return (Route("beta", Estimate(value, (high - low) / (2 * Z95), (low, high), "1", note), used=False),)


def within(nu: Estimate | None, bound: Pair | None) -> Estimate | None:
    """Return nu truncated at a lower bound that it does not contradict: mean and std of the truncated normal."""
    if nu is None or nu.value is None or not nu.std or bound is None:
        return nu
    from scipy.stats import truncnorm

    beyond = (bound[0] - nu.value) / nu.std
    if abs(beyond) > CONTRARY:
        return nu
    cut = truncnorm(beyond, np.inf, loc=nu.value, scale=nu.std)
    low, high = cut.ppf(TAILS95)
    return replace(nu, value=float(cut.mean()), std=float(cut.std()), interval95=(float(low), float(high)))


def narrowed(bound: Pair | None, bulge: Estimate | None) -> Pair | None:
    """Return the bound, cut from below by the interval of a rise that leaves nu open (at the end of its range)."""
    low, high = bound or OPEN_NU
    if bulge is None or bulge.value is not None or bulge.interval95 is None:
        return bound
    return (bulge.interval95[0], high) if low < bulge.interval95[0] < high else bound


def informed(data: Observations, bulge: Estimate | None, *, bound: Pair | None = SILICONE_NU) -> Observations:
    """Return the data with the pictures' nu combined with the gel's prior; a nu stated as exact stays.

    Where nothing is stated of nu, it is truncated at `bound`, None: not.
    """
    if data.gel.poisson_ratio_std == 0:
        return data
    known = (*of_bulge(bulge), *of_prior(data.gel, bulge=bulge, bound=bound))
    between = apart(known)
    if data.gel.poisson_ratio is None and between <= CONTRARY:
        known = of_bulge(within(bulge, bound))
    routes = [route for route in known if route.used and not route.is_bound]
    if not any(route.name == "bulge" for route in routes):
        return data
    values = np.array([route.poisson_ratio.value for route in routes])
    stds = np.array([route.poisson_ratio.std for route in routes])
    mean = float(np.average(values, weights=stds**-2.0))
    std = float(np.sum(stds**-2.0) ** -0.5) * max(apart(routes), 1.0)
    if between > CONTRARY:
        std = max(std, max(abs(mean - route.nearest(known[0])) for route in known) / REACH)
    gel = replace(data.gel, poisson_ratio=min(mean, NU_MAX), poisson_ratio_std=std)
    return replace(data, gel=gel)


def distance(one: Route, other: Route) -> float:
    """Return how many standard deviations two routes, one of them with a value, lie apart."""
    nu = np.linspace(one.nearest(other), other.nearest(one), STEPS)
    return float(np.sqrt(np.min(one.deviance(nu) + other.deviance(nu))))


def furthest(routes: Sequence[Route]) -> tuple[Route, ...]:
    """Return the two routes with the largest distance, of those used and the bound; () for fewer than two."""
    known = [r for r in routes if r.is_bound or (r.used and r.poisson_ratio.value is not None)]
    return max(combinations(known, 2), key=lambda pair: distance(*pair), default=())


def apart(routes: Sequence[Route]) -> float:
    """Return the largest distance, in std, between two of the routes that are used; 0 for fewer than two."""
    pair = furthest(routes)
    return distance(*pair) if pair else 0.0


def tightest(routes: Sequence[Route]) -> str:
    """Return the name of the used route with the smallest std; "prior" where there is none."""
    known = [route for route in routes if route.used and route.poisson_ratio.std is not None]
    return min(known, key=lambda route: route.poisson_ratio.std or 0.0).name if known else "prior"


def rivals(fitted: Fit, routes: Sequence[Route]) -> tuple[Rival, ...]:
    """Return the fits that E and nu have to hold where the radii contradict another route; else none.

    They are at each route's nu, and with another thickness at the nu of those that do not rest on the thickness.
    """
    radii = next((route for route in routes if route.profile is not None), None)
    if radii is None or apart(routes) <= CONTRARY:
        return ()
    model, found = fitted.model, list[Rival]()
    free = tuple(e.freed() for e in EFFECTS.values() if e.condition == THICKNESS and e.key not in model.keys)
    other = tuple(model + effect for effect in free)
    for route in (one for one in routes if one.is_bound or one.used):
        ends = route.poisson_ratio.interval95 or ()
        as_stated = (route.nearest(radii),) if route.is_bound else ends
        thicker = () if route is radii else other
        for one, nu in (*product((model,), as_stated), *product(thicker, ends)):
            gel = replace(fitted.data.gel, poisson_ratio=float(np.clip(nu, 0, NU_MAX)), poisson_ratio_std=0.0)
            with suppress(ConvergenceError):
                rival = fit(one, replace(fitted.data, gel=gel), tolerances=False, noise=fitted.noise)
                worse = 0.0 if one is model else rival.chi2 - fitted.chi2
                found.append(Rival(rival, min(Z95 / max(worse, TINY) ** 0.5, 1.0)))
    return tuple(found)


def in_words(routes: Sequence[Route]) -> list[str]:
    """Return assumptions: nu by each route, and the distance of those that were used."""
    said = [str(r) for r in routes if r.poisson_ratio.value is not None]
    lines = ["Poisson's ratio by route: " + "; ".join(said)] if said else []
    if sum(route.used for route in routes) > 1:
        between = f"{apart(routes):.1f} standard deviations apart"
        lines.append(f"the routes to Poisson's ratio that were used lie {between}")
    for r in (one for one in routes if one.poisson_ratio.value is None):
        if r.name != "prior":
            lines.append(f"not determined by {WORDS[r.name]}: {r.poisson_ratio.why}")
        elif r.used:
            lines.append(f"Poisson's ratio is held to {r.poisson_ratio.why}")
    return lines


def contradictions(routes: Sequence[Route]) -> tuple[list[str], list[str]]:
    """Return warnings and flags where routes contradict each other: both numbers and likely causes."""
    pair = furthest(routes)
    if not pair or (between := distance(*pair)) <= CONTRARY:
        return [], []
    below = any(route.is_bound for route in pair)
    exact = any(route.name == "prior" and route.poisson_ratio.std == 0 for route in routes)
    several = any(route.profile is not None for route in routes)
    widened = "it is taken as stated" if exact else "its interval is widened to reach to each"
    said = (
        f"the routes to Poisson's ratio contradict each other by {between:.1f} standard deviations "
        f"({pair[0]}; {pair[1]}): {widened}{', E over both and over another thickness' if several else ''}. "
        "Check the thickness, the radii and the zero of depth; a compressible layer or a gel that sticks to the "
        "punch has the same effect"
    )
    if below:
        said += ". If the gel is a foam, state poisson_ratio in recording.toml, or use --no-prior"
    return [said], [CONTRADICT, BELOW_BOUND] if below else [CONTRADICT]
