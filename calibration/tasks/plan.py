"""Plan the fewest presses that give E within a goal, by the uncertainty that a calibration of them would have.

    covariance = (J^T W^T W J + priors)^-1,    J = d force/d parameter at the guessed material
    least n with half width of 95 % (n) <= goal,    half width^2 about A^2 + B^2 / n

Presses without errors at the guess are fitted with the stated noise, by the law, tolerances, friction and edges of
`calibrate`; n repeats of a face are one press with std smaller by sqrt(n). Linear about the guess. A is shared by
all presses: nu, friction, edge, tolerances. Where A exceeds the goal, no number of presses reaches it, and
remedies are tried. Sets of heights are ranked by the information of their presses.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np

from calibration.fit.least_squares import Fit, fit, inverse_information
from calibration.fit.tolerances import with_tolerances
from calibration.inputs.checks import check
from calibration.inputs.gather import observe_points
from calibration.inputs.observations import (
    TYPICAL_FORCE_N,
    TYPICAL_GAIN,
    TYPICAL_ZERO_MM,
    Measured,
    Observations,
    Presses,
    Shared,
)
from calibration.laws.flat_punch import starting_modulus
from calibration.noise.model import STATED_DOF, Noise
from calibration.result.material import allow_for_edge, determine_material
from calibration.tasks.compare import base_model
from tactilevision.errors import InputError
from tactilevision.recording.model import Recording
from tactilevision.records.constants import KILO, MICRO, NU_NOMINAL
from tactilevision.records.measured import Bools, Estimate, Floats, Pair
from tactilevision.records.rig import Gel, Indenter, stated

USUAL_MODULUS_MPA = 0.2  # guess of E where none is given; soft silicone gels lie about it
USUAL_NU: Pair = (NU_NOMINAL, NU_NOMINAL)  # guess of Poisson's ratio where none is given


@dataclass(frozen=True, slots=True)
class PressNoise:
    """Standard deviations of one press: its depth (mm), its force (N), and its force relative to itself."""

    depth_std_mm: float = TYPICAL_ZERO_MM
    force_std_N: float = TYPICAL_FORCE_N
    gain: float = TYPICAL_GAIN


@dataclass(frozen=True, slots=True)
class Design:
    """Presses that could be made: `repeats` of each face, which is an indenter's `radius_mm` and `height_mm`.

    Tolerances, edges and nu with its std are known as stated for gel and indenters; `shared` are errors common to
    all depths. E and nu are ranges in which the material may lie: the worst case over their ends counts.
    """

    gel: Gel
    indenters: tuple[Indenter, ...]
    repeats: int = 3
    youngs_modulus_MPa: Pair = (USUAL_MODULUS_MPA, USUAL_MODULUS_MPA)
    poisson_ratio: Pair = USUAL_NU
    noise: PressNoise = field(default=PressNoise())
    lubricated: bool = False
    shared: Shared = field(default=Shared())

    def with_stated(
        self,
        faces: tuple[Indenter, ...],
        *,
        gel: Mapping[str, Any],
        each_face: Mapping[str, Any],
        noise: Mapping[str, Any],
        **own: Any,
    ) -> Design:
        """Return the design with these faces and what is stated, not None, of its parts and of itself.

        A gel of stated radius is a disc; one whose std of nu is stated has the middle of nu's range.
        """
        found = stated(self, indenters=tuple(stated(face, **each_face) for face in faces), **own)
        disc = {} if gel["radius_mm"] is None else {"shape": "disc"}
        known = {} if gel["poisson_ratio_std"] is None else {"poisson_ratio": sum(found.poisson_ratio) / 2}
        return replace(found, gel=stated(self.gel, **gel, **disc, **known), noise=stated(self.noise, **noise))

    @property
    def heights_mm(self) -> tuple[float, ...]:
        """The distinct step heights, ascending."""
        return tuple(sorted({float(one.height_mm or 0.0) for one in self.indenters}))

    @property
    def radii_mm(self) -> tuple[float, ...]:
        """The distinct radii, ascending."""
        return tuple(sorted({one.radius_mm for one in self.indenters}))

    @property
    def presses(self) -> int:
        """The number of presses."""
        return self.repeats * len(self.indenters)


@dataclass(frozen=True, slots=True)
class Margin:
    """`std` and `half_width` of the 95 % interval (the farther end) that a calibration would give.

    `std` is None where it would give no value; `half_width` is then half of the open interval.
    """

    std: float | None
    half_width: float

    def as_json(self) -> dict[str, Any]:
        """Return both numbers."""
        return {"std": self.std, "half_width_95": self.half_width}


@dataclass(frozen=True, slots=True)
class Forecast:
    """A design and the margins of c and E (relative) and of nu (1); nu and E have no std where nu stays open."""

    design: Design
    c: Margin
    youngs_modulus: Margin
    poisson_ratio: Margin

    @property
    def nu_is_open(self) -> bool:
        """Whether nothing in the design determines Poisson's ratio."""
        return self.poisson_ratio.std is None

    def as_json(self) -> dict[str, Any]:
        """Return one entry of plan.json."""
        return {
            "heights_mm": list(self.design.heights_mm),
            "radii_mm": list(self.design.radii_mm),
            "repeats": self.design.repeats,
            "presses": self.design.presses,
            "c_relative": self.c.as_json(),
            "youngs_modulus_relative": self.youngs_modulus.as_json(),
            "poisson_ratio": self.poisson_ratio.as_json(),
            "poisson_ratio_open": self.nu_is_open,
        }


@lru_cache(maxsize=64)  # a plan asks for some designs again
def forecast(design: Design) -> Forecast:
    """Return the worst margins of a design over its ranges of E and nu. Raises InputError if impossible."""
    check_design(design)
    places = sorted(set(product(design.youngs_modulus_MPa, design.poisson_ratio)))
    rows = [_margins(design, modulus, nu) for modulus, nu in places]
    c, modulus, nu = (
        max(column, key=lambda m: (m.std is None, m.half_width)) for column in zip(*rows, strict=True)
    )
    return Forecast(design, c, modulus, nu)


def forecast_fit(design: Design, modulus_MPa: float, *, poisson_ratio: float) -> Fit:
    """Return the fit to presses without errors for a gel of this E (MPa) and nu."""
    data = forecast_data(design, modulus_MPa, poisson_ratio=poisson_ratio)
    model = base_model(data)
    check(data)
    free = sum(not p.fixed and p.prior is None for p in model.parameters(data))
    noise = Noise(1.0, dof=max(design.presses - free, 0) + STATED_DOF)
    start = with_tolerances(model, data).defaults(data)
    start[:2] = modulus_MPa, poisson_ratio
    return fit(model, data, noise=noise, starts=start)


def forecast_data(design: Design, modulus_MPa: float, *, poisson_ratio: float) -> Observations:
    """Return one sample (N,) a face: depth (mm) and the law's force (N), with the noise of its repeats' mean."""
    faces, count, root = design.indenters, len(design.indenters), np.sqrt(design.repeats)
    unknown, order, noise = np.full(count, np.nan), np.arange(float(count)), design.noise
    presses = Presses(
        label=tuple(f"press {k + 1}" for k in range(count)),
        recording=np.zeros(count, dtype=np.int64),
        indenter=np.arange(count),
        radius_mm=np.array([one.radius_mm for one in faces]),
        **dict.fromkeys(("x_mm", "y_mm", "rest_s", "speed_mm_s", "hold_s", "temperature_C"), unknown),
        lubricated=np.full(count, 1.0 if design.lubricated else np.nan),
        day=np.zeros(count),
        order=order,
    )
    data = Observations(
        gel=design.gel,
        indenters=faces,
        presses=presses,
        press=np.arange(count),
        time_s=60 * order,
        depth_mm=np.array([one.height_mm for one in faces], dtype=float),
        force_N=np.ones((count, 3)),
        phase=np.full(count, "load"),
        temperature_C=unknown,
        depth_std_mm=np.full(count, noise.depth_std_mm / root),
        force_std_N=np.full(count, noise.force_std_N / root),
        depth_source="gauge",
        shared=design.shared,
    )
    model = base_model(data)
    truth = model.defaults(data)
    truth[:2] = modulus_MPa, poisson_ratio
    force = model.predict(truth, data)
    return replace(data.with_force(force), force_std_N=np.hypot(noise.force_std_N, noise.gain * force) / root)


def check_design(design: Design) -> None:
    """Raise InputError, with one sentence, for a design that cannot be pressed."""
    gel, noise, faces = design.gel, design.noise, design.indenters
    _check_numbers(
        "above 0",
        {
            "gel thickness": [gel.thickness_mm],
            "repeats": [design.repeats],
            "E": design.youngs_modulus_MPa,
            "Poisson's ratio": design.poisson_ratio,
            "the noise of depth": [noise.depth_std_mm],
            "the noise of force": [noise.force_std_N],
            "radius": [one.radius_mm for one in faces],
            "step height": [np.nan if one.height_mm is None else one.height_mm for one in faces],
        },
    )
    _check_numbers(
        "0 or more",
        {
            "the relative noise of force": [noise.gain],
            "the standard deviation of the thickness": [gel.thickness_std_mm],
            "the standard deviation of nu": [gel.poisson_ratio_std or 0.0],
            "the standard deviation of a radius": [one.radius_std_mm for one in faces],
            "the standard deviation of a height": [one.height_std_mm for one in faces],
            "the radius of an edge": [one.edge_radius_mm or 0.0 for one in faces],
        },
    )
    if not max(design.poisson_ratio) < 0.5:
        raise InputError("Poisson's ratio lies in (0, 0.5)", where="plan", value=max(design.poisson_ratio))
    for radius in design.radii_mm:
        heights = {one.height_mm for one in design.indenters if one.radius_mm == radius}
        if len(heights) < 2:
            raise InputError(
                "a radius needs two step heights at least, to distinguish stiffness from curvature",
                where=f"radius {radius:g} mm",
                value=sorted(h for h in heights if h is not None),
                remedy="Give a second height, about twice the first.",
            )
    if not design.indenters:
        raise InputError("there is nothing to press", where="plan", remedy="Give radii and step heights.")
    if design.heights_mm[-1] >= design.gel.thickness_mm:
        raise InputError(
            "a step height reaches through the gel",
            where="plan",
            value=design.heights_mm[-1],
            remedy=f"The gel is {design.gel.thickness_mm:g} mm thick; heights are in mm.",
        )


def _check_numbers(what: str, numbers: Mapping[str, Sequence[float]]) -> None:
    """Raise InputError where one of the named numbers is not finite, not above 0 or below 0."""
    for name, values in numbers.items():
        for value in values:
            if not np.isfinite(value) or value < 0 or (value == 0 and what == "above 0"):
                raise InputError(f"{name} must be {what}", where="plan", value=value)


def _margins(design: Design, modulus: float, nu: float) -> tuple[Margin, Margin, Margin]:
    found = allow_for_edge(determine_material(forecast_fit(design, modulus, poisson_ratio=nu)))
    return _margin(found.c), _margin(found.youngs_modulus), _margin(found.poisson_ratio, relative=False)


def _margin(found: Estimate, *, relative: bool = True) -> Margin:
    low, high = found.interval95 or (-np.inf, np.inf)
    centre = (low + high) / 2 if found.value is None else found.value
    size = abs(centre) if relative else 1.0
    std = None if found.value is None or found.std is None else found.std / size
    return Margin(std, max(high - centre, centre - low) / size)


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
        margins = {name: getattr(found, name) for name in self.wanted}
        return all(one.std is not None and one.half_width <= self.wanted[name] for name, one in margins.items())

    @property
    def wanted(self) -> dict[str, float]:
        """The half widths to reach, by their names in a forecast."""
        return {name: goal for name, goal in asdict(self).items() if goal is not None}


@dataclass(frozen=True, slots=True)
class Remedy:
    """A change of the design: its margins with any number of presses, and the least presses where they suffice."""

    action: str
    limit: Forecast
    least: Forecast | None

    def as_json(self) -> dict[str, Any]:
        """Return one entry of remedies."""
        return {"action": self.action, "limit": self.limit.as_json(), "least": self.least and self.least.as_json()}


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
            "all_heights": self.all_heights and self.all_heights.as_json(),
            "fewest": self.fewest and self.fewest.as_json(),
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
    _check_numbers("above 0", {"a goal": list(goal.wanted.values())})
    if not goal.wanted:
        raise InputError("there is no goal", where="plan", remedy="Ask for E, nu or c within something.")
    given, limit = forecast(design), _at(design, MAX_REPEATS)
    whole = least_repeats(design, goal) if goal.reached(limit) else None
    fewest = None if whole is None else fewest_presses(whole, goal)
    remedies = () if whole is not None else tuple(_remedies(design, goal))
    return Plan(goal, given, limit, whole, fewest, remedies, tuple(_assumptions(design)))


def least_repeats(design: Design, goal: Goal, *, most: int = MAX_REPEATS) -> Forecast | None:
    """Return the forecast with the fewest repeats that reach the goal; None where `most` do not."""
    least = 1 + bisect_left(range(1, most + 1), True, key=lambda count: goal.reached(_at(design, count)))
    return _at(design, least) if least <= most else None


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
                if (_stds(fitted, rows, repeats)[: wanted.size] <= wanted * (1 + MICRO)).all():
                    yield repeats * int(rows.sum()), chosen
                    break


def _stds(fitted: Fit, rows: Bools, repeats: int) -> Floats:
    """Return the std (2,) of E (MPa) and nu from these faces (N,), each pressed `repeats` times."""
    free = fitted.free
    table = np.sqrt(repeats) * (fitted.jacobian / fitted.about.base_N[:, None])[np.ix_(rows, free)]
    covariance = inverse_information(np.vstack([table, np.diag(fitted.prior_weight[free])]))
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
            more = (replace(i, name=f"{i.name} second", radius_mm=radius) for i in base.indenters)
            wider = replace(base, indenters=(*base.indenters, *more))
            yield _remedy(f"add a second radius, {radius:g} mm{also}", wider, goal)
        yield from _known_nu(base, goal, also)
    if exact := _exact(slippery):
        yield _remedy("lubricate, state edge_radius_mm, and measure heights and sizes exactly", exact, goal)


def _known_nu(base: Design, goal: Goal, also: str) -> Iterator[Remedy]:
    """Yield the largest std of nu that reaches the goal, or the smallest where none does."""
    gel, centre = base.gel, float(np.mean(base.poisson_ratio))
    known = np.inf if gel.poisson_ratio is None or gel.poisson_ratio_std is None else gel.poisson_ratio_std
    found = None
    for std in (one for one in NU_STDS if one < known):
        sharper = replace(base, gel=replace(gel, poisson_ratio=centre, poisson_ratio_std=std))
        found = _remedy(
            f"know nu with a std of {std:g} (the rise beside the punch, or a prior){also}", sharper, goal
        )
        if found.least is not None:
            break
    if found is not None:
        yield found


def _exact(design: Design) -> Design | None:
    """Return the design without tolerances; None where it has none."""
    sharp = tuple(replace(i, height_std_mm=0.0, radius_std_mm=0.0) for i in design.indenters)
    exact = replace(design, indenters=sharp, gel=replace(design.gel, thickness_std_mm=0.0))
    return None if exact == design else exact


def _remedy(action: str, design: Design, goal: Goal) -> Remedy:
    limit = _at(design, MAX_REPEATS)
    return Remedy(action, limit, least_repeats(design, goal) if goal.reached(limit) else None)


def _assumptions(design: Design) -> Iterator[str]:
    noise, gel = design.noise, design.gel
    yield (
        f"one press is off by {KILO * noise.depth_std_mm:.3g} um in depth, {KILO * noise.force_std_N:.3g} mN and "
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
