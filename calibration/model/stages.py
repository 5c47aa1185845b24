"""Stages of a model in their fixed order, its parameters, and the protocols of laws and effects.

    depth -> geometry -> (law) -> material -> history -> instrument

    depth        the depth as read becomes the depth of the punch in the gel
    geometry     radius, thickness, and a factor on the stiffness (the surroundings)
    law          elastic force of the punch on that geometry
    material     the elastic force changes with strain, age, temperature
    history      the force depends on earlier loading (relaxation, recovery, softening, pull-off)
    instrument   the force becomes the reading of the force sensor

Within a stage effects act in the order of the catalogue, private ones last. An effect at its defaults returns the
state unchanged.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, replace
from enum import IntEnum
from math import inf, nan
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np

from tactilevision.errors import InputError
from tactilevision.records.measured import Bools, Floats, Pair

if TYPE_CHECKING:
    from calibration.inputs.observations import DepthSource, Observations

STICKING, EDGE, THICKNESS = "sticking", "edge", "thickness"  # conditions of the rig that an effect may fit

NOT_READ = 0.0  # N: normal force put for held-out presses, as if nothing pulled; tangential forces stay


@dataclass(frozen=True, slots=True)
class Prior:
    """Normal prior of a parameter: mean, standard deviation, and where the knowledge comes from."""

    mean: float
    std: float
    source: str

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.std) and self.std > 0):
            raise InputError(
                "a prior needs a finite mean and a standard deviation above 0",
                where=self.source,
                value=(self.mean, self.std),
            )


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a law or an effect.

    `default` is where a fit starts; for an effect it is the value at which the effect vanishes or, for a shape
    (a time constant, an angle), any place inside the bounds. `scale` is a typical size: the step of numerical
    derivatives and the unit of the optimiser. Equal bounds hold the parameter fixed. Raises InputError for a
    default outside the bounds and a scale that is not above 0.
    """

    name: str
    unit: str
    default: float
    bounds: Pair
    meaning: str
    scale: float
    prior: Prior | None = None

    def __post_init__(self) -> None:
        low, high = map(float, self.bounds)
        object.__setattr__(self, "bounds", (low, high))  # numbers may be written as integers
        for name in ("default", "scale"):
            object.__setattr__(self, name, float(getattr(self, name)))
        if not low <= self.default <= high:
            raise InputError(
                "a parameter's default lies outside its bounds", where=self.name, value=(self.default, self.bounds)
            )
        if not (math.isfinite(self.scale) and self.scale > 0):
            raise InputError("a parameter's scale must lie above 0", where=self.name, value=self.scale)

    @property
    def fixed(self) -> bool:
        """True where both bounds are equal."""
        return self.bounds[0] == self.bounds[1]

    def held_at(self, value: float) -> Parameter:
        """Return the parameter fixed at a value."""
        return replace(self, default=value, bounds=(value, value))


def amplitude(name: str, unit: str, limit: float, meaning: str, scale: float) -> Parameter:
    """Return a parameter that may have either sign, within `limit` of 0, where its effect vanishes."""
    return Parameter(name, unit, 0.0, (-limit, limit), meaning, scale)


class Stage(IntEnum):
    """Stage of a model in which an effect acts."""

    DEPTH = 0
    GEOMETRY = 1
    MATERIAL = 2
    HISTORY = 3
    INSTRUMENT = 4


@dataclass(frozen=True, slots=True)
class State:
    """What passes through the stages; each array is (N,), one number a sample.

    `depth_mm` of the punch in the gel; `radius_mm` of the punch, `edge_mm` the radius of its rounded edge and
    `sticking` from a gel that slides over that (0) to one that sticks (1); `thickness_mm` of the gel; `factor` on
    the stiffness. The law sets `stiffness_N_per_mm` (force over depth as the depth tends to 0, of a sharp edge)
    and `force_N`.
    """

    depth_mm: Floats
    radius_mm: Floats
    edge_mm: Floats
    thickness_mm: Floats
    factor: Floats
    stiffness_N_per_mm: Floats
    force_N: Floats
    sticking: float = 0.0

    def plus(self, **changes: Floats) -> State:
        """Return the state with `changes`, (N,) or one number each, added to the arrays of these names."""
        return replace(self, **{name: getattr(self, name) + change for name, change in changes.items()})

    def times(self, **factors: Floats) -> State:
        """Return the state with the arrays of these names multiplied by `factors`, (N,) or one number each."""
        return replace(self, **{name: getattr(self, name) * factor for name, factor in factors.items()})


@runtime_checkable
class Law(Protocol):
    """Contact law: the elastic force of one shape of indenter on the gel."""

    @property
    def key(self) -> str:
        """Name in the catalogue."""

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the fitted parameters; they may depend on the indenters of `data`."""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with `stiffness_N_per_mm` and `force_N`; with Duals given, Duals (`analytic`)."""


@dataclass(frozen=True, slots=True)
class ManualCheck:
    """Direct check of an effect by a person: what to do, minutes, and its std of the first parameter.

    `std` is in the parameter's unit; NaN where the check takes more presses, which are then fitted.
    """

    action: str
    minutes: float
    std: float = nan


class EffectBase:
    """Base of effects; a new one needs `key`, `stage`, `parameters` and `apply`.

    Everything known of an effect stands in its class; no other file knows its key.

    `title`: a short sentence. `seen_in`: covariates against which its residual shows; for an effect of the gel the
    names of `covariates` also bound the error of its form (`form_errors`). `confused_with`: keys of effects that
    look alike. `separated_by`: what distinguishes them. `source` of the equation. `threshold`: it acts only beyond
    or below some depth, so a small amplitude does not represent it. `same_over`: covariates over which its
    parameters are constants of the material or of the rig, where those of an imitation vary; it is not identified
    unless they are (`covariates`). `reads_force`: it depends on the normal force; the model passes it the
    predicted force, since the measured one carries noise. `asks_readings`: it takes from the readings which branch
    a sample is on; confirmed on held-out presses, it is given NOT_READ.

    `order` among the effects of a stage: lower acts first. `largest`: size of the first parameter that no rig
    exceeds, from where the effect vanishes (a judgement); None: its bounds. `typical`: its size where the data do
    not show it; None: the parameter's scale. `check`: what a person can do. `depth_source`: the one kind of depth
    that it applies to; None: any. `condition`: the condition of the rig that it fits ("sticking", "edge",
    "thickness"), which is otherwise stated or assumed. `acts_on`: "punch" for a form that is a punch's, over its
    depth, "resultant" for an error of forces that were computed from pictures; "": either. `instead_of_beta`: its
    rank, from 1, among the explanations of a beta outside theory; 0: none. `treatment`: what `treat(data)` does to
    the observations once the effect is added ("outside_shadow_zone"); "": it is fitted. `start_values`: fixed
    starts of a fit, a row each. `std_at_known_E`: the prior's std of a factor on E where E is known; None: none.
    `searched`: number of forms n that its starts search, which costs 2 ln n of chi^2 beyond 2 a parameter.
    `analytic`: `apply` also takes the Duals of model/dual; otherwise its stage is differentiated by differences.
    """

    analytic: ClassVar[bool] = True
    key: ClassVar[str] = ""
    title: ClassVar[str] = ""
    stage: ClassVar[Stage]
    seen_in: ClassVar[tuple[str, ...]] = ()
    confused_with: ClassVar[tuple[str, ...]] = ()
    separated_by: ClassVar[tuple[str, ...]] = ()
    source: ClassVar[str] = ""
    threshold: ClassVar[bool] = False
    searched: ClassVar[int] = 1
    same_over: ClassVar[tuple[str, ...]] = ()
    reads_force: ClassVar[bool] = False
    asks_readings: ClassVar[bool] = False
    order: ClassVar[float] = inf
    largest: ClassVar[float | None] = None
    typical: ClassVar[float | None] = None
    check: ClassVar[ManualCheck | None] = None
    depth_source: ClassVar[DepthSource | None] = None
    condition: ClassVar[str] = ""
    acts_on: ClassVar[Literal["", "punch", "resultant"]] = ""
    instead_of_beta: ClassVar[int] = 0
    treatment: ClassVar[str] = ""
    start_values: ClassVar[tuple[tuple[float, ...], ...]] = ()
    std_at_known_E: ClassVar[float | None] = None

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and vars(other) == vars(self)

    def __hash__(self) -> int:
        return hash(type(self))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Fitted parameters; the effect vanishes at the default of the first."""
        raise NotImplementedError(f"{type(self).__name__} states no parameters")

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters with what is known of them on these data."""
        first, *others = self.parameters or (None,)
        if first is None or self.std_at_known_E is None or data.resultants is None:
            return self.parameters
        prior = Prior(first.default, self.std_at_known_E, f"{self.title}: a judgement")
        return (replace(first, prior=prior), *others)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show the effect; empty where they can."""
        return ""

    def unfit(self, data: Observations) -> str:
        """Return why its form does not suit the law of these data; empty where it does."""
        punch = self.acts_on == "punch" and data.resultants is not None
        return "the inverse step takes the shape of the contact from the picture" if punch else ""

    def starts(self, data: Observations) -> Floats:
        """Return values (S, q) to begin a fit from.

        Those of `start_values`; else half a scale on either side of the first parameter's default, in the bounds.
        """
        if self.start_values:
            return np.array(self.start_values, dtype=float)
        first, *others = self.parameters
        sides = [np.clip(first.default + s * first.scale / 2, *first.bounds) for s in (1.0, -1.0)]
        rest = [p.default for p in others]
        return np.array([[side, *rest] for side in dict.fromkeys(sides) if side != first.default])

    def of_modulus(self, values: Floats) -> float:
        """Return the factor on E that these values mean; 1 unless the effect is a change of E itself."""
        return 1.0

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the effect of these values."""
        raise NotImplementedError(f"{type(self).__name__} does nothing")

    def absent(self, data: Observations) -> bool:
        """Return whether these data cannot contain it: their depth has another source, or their law no punch."""
        return self.depth_source not in (None, data.depth_source) or bool(self.unfit(data))

    def to_be_expected(self, data: Observations) -> bool:
        """Return whether every rig has some of it (`typical`) unless stated otherwise."""
        return False

    def supposed(self, data: Observations) -> Observations:
        """Return the data with usual values of unstated conditions that the effect needs."""
        return data

    def freed(self) -> Effect:
        """Return the effect without a prior on its size."""
        if self.std_at_known_E is None:
            return self
        free = copy(self)
        vars(free)["std_at_known_E"] = None
        return free

    def richer(self) -> Effect | None:
        """Return the effect with one more term; None where there is none."""
        return None

    def richer_starts(self, values: Floats) -> Floats:
        """Return values (S, q) to begin a fit of `richer()` from, given these (p,) of its own."""
        return values[None]

    def in_picture(self, data: Observations | None = None) -> Effect | None:
        """Return the effect as it shows in the reconstructed depth; None where it does not."""
        return None


Effect = EffectBase  # as annotations name it


class AxesEffect(EffectBase):
    """An effect with one amplitude along x and one along y.

    Along an axis on which the data do not vary the amplitude is held at 0. Fits start at `signs` times the scale.
    """

    signs: ClassVar[tuple[tuple[int, int], ...]] = ((1, 0), (-1, 0), (0, 1), (0, -1))

    def varies(self, data: Observations) -> Bools:
        """Return along which of x and y (2,) these data vary."""
        raise NotImplementedError(f"{type(self).__name__} does not state what varies")

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters, fixed at 0 along an axis on which the data do not vary."""
        pairs = zip(self.parameters, self.varies(data), strict=True)
        return tuple(p if varies else replace(p, bounds=(0, 0)) for p, varies in pairs)

    def starts(self, data: Observations) -> Floats:
        """Return the starts (S, 2) that move only along axes on which the data vary."""
        signs = np.array(self.signs)
        kept = signs[~signs[:, ~self.varies(data)].any(axis=1)]
        return np.asarray(kept * [p.scale for p in self.parameters])
