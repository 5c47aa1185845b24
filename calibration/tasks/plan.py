"""Plan the fewest presses that give E within a goal.

    least n with half width of 95 % (n) <= goal,    half width^2 about A^2 + B^2 / n

A is shared by all presses: nu, friction, edge, tolerances. Where A exceeds the goal, no number of presses reaches
it, and remedies are tried. Sets of heights are ranked by the information of their presses. Assumptions:
forecast.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from calibration.fit.least_squares import Fit, inverse_information
from calibration.inputs.gather import observe_points
from calibration.inputs.observations import TYPICAL_FORCE_N, TYPICAL_ZERO_MM, Measured
from calibration.laws.flat_punch import starting_modulus
from calibration.tasks.forecast import Design, Forecast, PressNoise, check_design, forecast, forecast_fit
from tactilevision.errors import InputError
from tactilevision.recording.model import Recording
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Indenter

MAX_REPEATS = 1000  # repeats of a face, taken as unlimited
MAX_HEIGHTS = 8  # heights offered up to which every set of them is tried: 247 sets
MAX_TRIED = 3  # sets of heights that are forecast in full
NU_STDS = (0.01, 0.005, 0.003, 0.002, 0.001)  # std of nu that a remedy may ask for, the easiest first
SMALLER_RADIUS = 0.6  # of the smallest radius: a second radius that the remedy offers


@dataclass(frozen=True, slots=True)
class Goal:
    """Half widths of 95 % to reach: of E and c relative, of nu in units of nu; None is no goal."""

    youngs_modulus: float | None = 0.03
    poisson_ratio: float | None = None
    c: float | None = None

    def reached(self, found: Forecast) -> bool:
        """Return whether a forecast has every value within its goal."""
        pairs = (
            (self.youngs_modulus, found.youngs_modulus),
            (self.poisson_ratio, found.poisson_ratio),
            (self.c, found.c),
        )
        return all(
            margin.std is not None and margin.half_width <= goal for goal, margin in pairs if goal is not None
        )


@dataclass(frozen=True, slots=True)
class Remedy:
    """A change of the design: its margins with any number of presses, and the least presses where they suffice."""

    action: str
    limit: Forecast
    least: Forecast | None

    def as_json(self) -> dict[str, Any]:
        """Return one entry of remedies."""
        least = None if self.least is None else self.least.as_json()
        return {"action": self.action, "limit": self.limit.as_json(), "least": least}


@dataclass(frozen=True, slots=True)
class Plan:
    """The design `as_given`, its `limit` with MAX_REPEATS, and the least presses that reach the goal.

    `all_heights` is the least with every height offered, `fewest` that of the best set of them; both None where no
    number of presses reaches the goal: `remedies` then says what would.
    """

    goal: Goal
    as_given: Forecast
    limit: Forecast
    all_heights: Forecast | None
    fewest: Forecast | None
    remedies: tuple[Remedy, ...]
    assumptions: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the content of plan.json."""
        goal = self.goal
        return {
            "goal_half_width_95": {
                "youngs_modulus_relative": goal.youngs_modulus,
                "poisson_ratio": goal.poisson_ratio,
                "c_relative": goal.c,
            },
            "reached": self.fewest is not None,
            "as_given": self.as_given.as_json(),
            "limit": self.limit.as_json(),
            "all_heights": None if self.all_heights is None else self.all_heights.as_json(),
            "fewest": None if self.fewest is None else self.fewest.as_json(),
            "remedies": [remedy.as_json() for remedy in self.remedies],
            "assumptions": list(self.assumptions),
        }


def design_of(recording: Recording) -> Design:
    """Return the design that a recording states: gel, faces, noise, and the size of E that its points show.

    Raises InputError where it states no gel.
    """
    gel = recording.sensor.gel
    if gel is None:
        remedy = "Add [sensor.gel] to recording.toml."
        raise InputError("the recording states no gel", where=recording.path, remedy=remedy)
    faces = tuple(one for one in recording.indenters.values() if one.shape == "flat_cylinder")
    force = recording.force_std_N
    noise = PressNoise(recording.depth_std_mm or TYPICAL_ZERO_MM, force[2] if force else TYPICAL_FORCE_N)
    wet = bool(recording.presses) and all(press.lubricated == 1 for press in recording.presses)
    design = Design(gel, faces, noise=noise, lubricated=wet)
    if recording.presses and faces:
        design = replace(design, repeats=max(round(len(recording.presses) / len(recording.indenters)), 1))
    if gel.poisson_ratio is not None:
        design = replace(design, poisson_ratio=(gel.poisson_ratio, gel.poisson_ratio))
    if not recording.points:
        return design
    data = observe_points(Measured(recording, recording.points))
    modulus = starting_modulus(data)
    return replace(design, youngs_modulus_MPa=(modulus, modulus), shared=data.shared)


def faces_of(design: Design, radii: tuple[float, ...], heights: tuple[float, ...]) -> tuple[Indenter, ...]:
    """Return a face for each radius and height in mm, else as the design has it; its own where neither is given.

    Raises InputError where there is none.
    """
    stated = {one.radius_mm: one for one in design.indenters}
    faces = tuple(one for one in design.indenters if one.height_mm is not None)
    if radii or heights:
        heights = heights or tuple(sorted({one.height_mm for one in faces if one.height_mm is not None}))
        faces = tuple(
            replace(stated.get(a, Indenter("")), name=f"radius {a:g} height {h:g}", radius_mm=a, height_mm=h)
            for a in radii or sorted(stated)
            for h in heights
        )
    if not faces:
        remedy = "Give both in mm: --heights .2,.4"
        raise InputError("radii and step heights are needed", where="--radius, --heights", remedy=remedy)
    return faces


def plan(design: Design, *, goal: Goal | None = None) -> Plan:
    """Return the fewest presses of `design` that reach `goal` (default: E within 3 %), or remedies.

    Raises InputError for a design that cannot be pressed and for a goal that is not above 0.
    """
    goal = Goal() if goal is None else goal
    _check_goal(goal)
    check_design(design)
    given, limit = forecast(design), _at(design, MAX_REPEATS)
    whole = least_repeats(design, goal) if goal.reached(limit) else None
    fewest = None if whole is None else fewest_presses(whole, goal)
    remedies = () if whole is not None else tuple(_remedies(design, goal))
    return Plan(goal, given, limit, whole, fewest, remedies, tuple(_assumptions(design)))


def least_repeats(design: Design, goal: Goal, *, most: int = MAX_REPEATS) -> Forecast | None:
    """Return the forecast with the fewest repeats that reach the goal; None where `most` do not."""
    low, high, best = 0, 1, _at(design, 1)
    while not goal.reached(best):
        if high >= most:
            return None
        low, high = high, min(2 * high, most)
        best = _at(design, high)
    while high - low > 1:
        middle = (low + high) // 2
        found = _at(design, middle)
        if goal.reached(found):
            high, best = middle, found
        else:
            low = middle
    return best


def fewest_presses(whole: Forecast, goal: Goal) -> Forecast:
    """Return the set of heights, two at least of each radius, that reaches the goal with the fewest presses.

    Sets are ranked by the presses that give the std of E (and of nu, where it has a goal) of all heights; the best
    are forecast in full.
    """
    design, count = whole.design, 1 if goal.poisson_ratio is None else 2
    fitted = forecast_fit(
        replace(design, repeats=1), design.youngs_modulus_MPa[0], poisson_ratio=design.poisson_ratio[0]
    )
    wanted = _stds(fitted, np.ones(len(design.indenters), dtype=bool), design.repeats)[:count]
    best = whole
    for _, heights in sorted(_promising(fitted, design, wanted))[:MAX_TRIED]:
        chosen = replace(design, indenters=_of_heights(design, heights))
        most = (best.design.presses - 1) // len(chosen.indenters)
        found = least_repeats(chosen, goal, most=most) if most >= 1 else None
        best = best if found is None else found
    return best


def _promising(fitted: Fit, design: Design, wanted: Floats) -> Iterator[tuple[int, tuple[float, ...]]]:
    """Yield (presses, heights) of each set of heights, by its information alone."""
    heights = design.heights_mm
    sizes = range(2, len(heights)) if len(heights) <= MAX_HEIGHTS else (2,)
    for size in sizes:
        for chosen in combinations(heights, size):
            rows = np.array([one.height_mm in chosen for one in design.indenters])
            if any(sum(i.radius_mm == r for i in _of_heights(design, chosen)) < 2 for r in design.radii_mm):
                continue
            for repeats in range(1, 1 + design.presses // int(rows.sum())):
                if (_stds(fitted, rows, repeats)[: wanted.size] <= wanted * (1 + 1e-6)).all():
                    yield repeats * int(rows.sum()), chosen
                    break


def _stds(fitted: Fit, rows: Bools, repeats: int) -> Floats:
    """Return the std (2,) of E (MPa) and nu from these faces (N,), each pressed `repeats` times."""
    free = fitted.free
    table = np.sqrt(repeats) * (fitted.jacobian / fitted.about.base_N[:, None])[np.ix_(rows, free)]
    known = np.array([0.0 if p.prior is None else 1 / p.prior.std for p in fitted.parameters])[free]
    covariance = inverse_information(np.vstack([table, np.diag(known)]))
    both = np.zeros(free.size)
    both[free] = np.sqrt(np.diag(covariance))
    return both[:2]


def _of_heights(design: Design, heights: tuple[float, ...]) -> tuple[Indenter, ...]:
    return tuple(one for one in design.indenters if one.height_mm in heights)


def _at(design: Design, repeats: int) -> Forecast:
    return forecast(replace(design, repeats=repeats))


def _remedies(design: Design, goal: Goal) -> Iterator[Remedy]:
    """Yield each change of the design alone, then with a lubricated, stated edge."""
    slippery = replace(
        design,
        lubricated=True,
        indenters=tuple(replace(i, edge_radius_mm=i.edge_radius_mm or 0.0) for i in design.indenters),
    )
    dry = slippery != design
    if dry:
        yield _remedy("lubricate, and state edge_radius_mm", slippery, goal)
    for base, also in ((design, ""), *(((slippery, ", lubricate, and state edge_radius_mm"),) if dry else ())):
        if len(design.radii_mm) == 1:
            radius = SMALLER_RADIUS * design.radii_mm[0]
            yield _remedy(f"add a second radius, {radius:g} mm{also}", _with_radius(base, radius), goal)
        yield from _known_nu(base, goal, also)
    if exact := _exact(slippery):
        yield _remedy("lubricate, state edge_radius_mm, and measure heights and sizes exactly", exact, goal)


def _known_nu(base: Design, goal: Goal, also: str) -> Iterator[Remedy]:
    """Yield the largest std of nu that reaches the goal, or the smallest where none does."""
    gel, centre = base.gel, float(np.mean(base.poisson_ratio))
    known = gel.poisson_ratio_std if gel.poisson_ratio is not None else None
    found = None
    for std in NU_STDS:
        if known is not None and std >= known:
            continue
        sharper = replace(base, gel=replace(gel, poisson_ratio=centre, poisson_ratio_std=std))
        found = _remedy(
            f"know nu with a std of {std:g} (the rise beside the punch, or a prior){also}", sharper, goal
        )
        if found.least is not None:
            break
    if found is not None:
        yield found


def _with_radius(design: Design, radius: float) -> Design:
    more = tuple(replace(i, name=f"{i.name} second", radius_mm=radius) for i in design.indenters)
    return replace(design, indenters=(*design.indenters, *more))


def _exact(design: Design) -> Design | None:
    """Return the design without tolerances; None where it has none."""
    sharp = tuple(replace(i, height_std_mm=0.0, radius_std_mm=0.0) for i in design.indenters)
    exact = replace(design, indenters=sharp, gel=replace(design.gel, thickness_std_mm=0.0))
    return None if exact == design else exact


def _remedy(action: str, design: Design, goal: Goal) -> Remedy:
    limit = _at(design, MAX_REPEATS)
    return Remedy(action, limit, least_repeats(design, goal) if goal.reached(limit) else None)


def _check_goal(goal: Goal) -> None:
    goals = [one for one in (goal.youngs_modulus, goal.poisson_ratio, goal.c) if one is not None]
    for one in goals:
        if not (np.isfinite(one) and one > 0):
            raise InputError("a goal must be above 0", where="plan", value=one)
    if not goals:
        raise InputError("there is no goal", where="plan", remedy="Ask for E, nu or c within something.")


def _assumptions(design: Design) -> Iterator[str]:
    noise, gel = design.noise, design.gel
    yield (
        f"one press is off by {1e3 * noise.depth_std_mm:.3g} um in depth, {1e3 * noise.force_std_N:.3g} mN and "
        f"{100 * noise.gain:.3g} % in force (std), each press anew"
    )
    moduli, ratios = (
        " to ".join(dict.fromkeys(f"{value:.3g}" for value in ends))
        for ends in (design.youngs_modulus_MPa, design.poisson_ratio)
    )
    yield f"the gel has E of about {moduli} MPa and nu of about {ratios}; of a range, the worse end counts"
    if not gel.thickness_std_mm:
        yield f"the thickness, {gel.thickness_mm:g} mm, is exact; 1 % of it would be about 1 % of E"
    if not all(one.height_std_mm for one in design.indenters):
        yield "the step heights are exact where no std is stated; such errors do not fall with repeats"
    yield "the law holds: an effect that it lacks shows in a diagnosis, not here"
    yield "every press is accepted; where some are rejected, make more"
