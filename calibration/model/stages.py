"""The stages of a model in their fixed order, its parameters, and the protocols of laws and effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from math import inf, nan
from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

import numpy as np

from tactilevision.errors import InputError
from tactilevision.records.measured import Bools, Floats, Pair

if TYPE_CHECKING:
    from calibration.inputs.observations import DepthSource, Observations


# One number that a fit may change: its unit, where it rests, how far it may go, and what it means.


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of a parameter beforehand: a normal distribution, and where that knowledge comes from."""

    mean: float
    std: float
    source: str

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.std) and self.std > 0):
            raise InputError(
                "a prior has a finite mean and a std above 0", where=self.source, value=(self.mean, self.std)
            )


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a law or an effect.

    `default` is where a fit starts; for an effect it is the value at which the effect vanishes, or, for a shape
    (a time constant, an angle), any place inside the bounds. `scale` is a typical size: the step of numerical
    derivatives and the unit of the optimiser. Equal bounds hold the parameter fixed.
    """

    name: str
    unit: str
    default: float
    bounds: Pair
    meaning: str
    scale: float
    prior: Prior | None = None

    def __post_init__(self) -> None:
        low, high = self.bounds
        if not low <= self.default <= high:
            raise InputError(
                "the default of a parameter lies within its bounds",
                where=self.name,
                value=(self.default, self.bounds),
            )
        if not (math.isfinite(self.scale) and self.scale > 0):
            raise InputError("the scale of a parameter lies above 0", where=self.name, value=self.scale)

    @property
    def fixed(self) -> bool:
        """True where the bounds leave no room."""
        return self.bounds[0] == self.bounds[1]


# The stages that every model passes in one fixed order, and the two protocols that fill them.
#
#     depth -> geometry -> (law) -> material -> history -> instrument
#
# depth        what was read as depth becomes the depth of the punch in the gel
# geometry     radius, thickness, and a factor on the stiffness (the surroundings)
# law          elastic force of the punch on that geometry
# material     the elastic force changes with strain, age, temperature
# history      the force depends on what happened before (relaxation, recovery, softening, pull-off)
# instrument   the force becomes what the force sensor reads
#
# Within a stage effects act in the order of the catalogue, private ones last. An effect at its defaults returns
# the state as it came.

STICKING, EDGE, THICKNESS = "sticking", "edge", "thickness"  # conditions that an effect may fit; else stated

NOT_READ = 0.0  # N: the normal force of presses held out, as if the gel did not pull; tangential forces stay


class Stage(IntEnum):
    """Where in the chain an effect acts."""

    DEPTH = 0
    GEOMETRY = 1
    MATERIAL = 2
    HISTORY = 3
    INSTRUMENT = 4


@dataclass(frozen=True, slots=True)
class State:
    """What travels through the stages; each array is (N,), one number a sample.

    `depth_mm` of the punch in the gel; `radius_mm` of the punch, `edge_mm` by which its edge is rounded and
    `sticking` from a gel that slides over that (0) to one that sticks (1); `thickness_mm` of the gel; `factor` on
    the stiffness; set by the law: `stiffness_N_per_mm` (force over depth as the depth goes to 0, of a sharp edge)
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


@runtime_checkable
class Law(Protocol):
    """A contact law: the elastic force of one shape of indenter on the gel."""

    @property
    def key(self) -> str:
        """The name in the catalogue."""

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """What is fitted; may depend on the indenters that occur."""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Fill `stiffness_N_per_mm` and `force_N`."""


@runtime_checkable
class Effect(Protocol):
    """A physical or an instrument effect; see EffectBase for what each part says."""

    @property
    def key(self) -> str:
        """The name in the catalogue."""

    @property
    def stage(self) -> Stage:
        """Where it acts."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What is fitted."""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """The state with the effect of these values, in the order of `parameters`."""

    def missing(self, data: Observations) -> str:
        """Why these data cannot show the effect; empty where they can."""

    def starts(self, data: Observations) -> Floats:
        """Values (S, q) to begin a fit from, and to look for the effect with."""


@dataclass(frozen=True, slots=True)
class ManualCheck:
    """A direct look at an effect: what to do, its minutes, and the std with which it shows the first parameter.

    `std` is in the parameter's unit; NaN where it takes presses that the data themselves must be asked about.
    """

    action: str
    minutes: float
    std: float = nan


class EffectBase:
    """What an effect has in common with the others; a new one need give `key`, `stage`, `parameters`, `apply`.

    Everything that is known of an effect stands here, and no other file knows its key.

    `title` in words; `seen_in` the covariates against which its residual shows; of an effect of the gel, by the
    names of `covariates`, it also bounds what its form may be off by (`form_errors`); `confused_with` keys of
    effects that look alike; `separated_by` what tells them apart; `source` of the equation; `threshold` where it
    acts only beyond or below some depth, so that no small amplitude stands for it; `same_over` covariates over
    which it has to have one size, where what looks like it has several; `reads_force` where it depends on the
    normal force itself: the model hands it the force that it predicts, for the measured one's noise would pass for
    the effect; `asks_readings` where it takes from what was read which way a sample went: of presses held out it
    finds NOT_READ when it is confirmed.

    `order` among the effects of a stage: lower acts first, private ones last. `largest`: the size of the first
    parameter that no rig exceeds, from where the effect vanishes, a judgement; None: its bounds. `typical`: its
    size where nothing shows how large; None: the parameter's scale. `check`: what a person can do about it.
    `depth_source`: the one kind of depth that it belongs to; None: any. `condition`: what it fits of the rig that
    is otherwise stated or supposed ("sticking", "edge", "thickness"). `instead_of_beta`: its rank, from 1, among
    what a beta that theory does not allow may be instead; 0: it is none. `treatment`: what `treat(data)` does
    to the observations once the effect is added ("outside_shadow_zone"); "": there is none, and it is fitted.
    """

    key: ClassVar[str] = ""
    title: ClassVar[str] = ""
    stage: ClassVar[Stage]
    seen_in: ClassVar[tuple[str, ...]] = ()
    confused_with: ClassVar[tuple[str, ...]] = ()
    separated_by: ClassVar[tuple[str, ...]] = ()
    source: ClassVar[str] = ""
    threshold: ClassVar[bool] = False
    same_over: ClassVar[tuple[str, ...]] = ()
    reads_force: ClassVar[bool] = False
    asks_readings: ClassVar[bool] = False
    order: ClassVar[float] = inf
    largest: ClassVar[float | None] = None
    typical: ClassVar[float | None] = None
    check: ClassVar[ManualCheck | None] = None
    depth_source: ClassVar[DepthSource | None] = None
    condition: ClassVar[str] = ""
    instead_of_beta: ClassVar[int] = 0
    treatment: ClassVar[str] = ""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What is fitted."""
        raise NotImplementedError(f"{type(self).__name__} states no parameters")

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same, with what is known of them beforehand on these data; nothing, unless said otherwise."""
        return self.parameters

    def missing(self, data: Observations) -> str:
        """Any data show it, unless said otherwise."""
        return ""

    def starts(self, data: Observations) -> Floats:
        """Half a typical size on either side of the default, inside the bounds, in the first parameter."""
        table = self.parameters
        first = table[0]
        rest = [p.default for p in table[1:]]
        sides = [np.clip(first.default + s * first.scale / 2, *first.bounds) for s in (1.0, -1.0)]
        kept = [side for side in dict.fromkeys(sides) if side != first.default]
        return np.array([[side, *rest] for side in kept])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """The state with the effect of these values."""
        raise NotImplementedError(f"{type(self).__name__} does nothing")

    def absent(self, data: Observations) -> bool:
        """Whether these data hold nothing of it: their depth comes from elsewhere, unless said otherwise."""
        return self.depth_source not in (None, data.depth_source)

    def to_be_expected(self, data: Observations) -> bool:
        """Whether any rig of which nothing is stated has some of it (`typical`); no, unless said otherwise."""
        return False

    def supposed(self, data: Observations) -> Observations:
        """The same with what most rigs have, where it is not stated and the effect could not act without it."""
        return data

    def freed(self) -> Effect:
        """The effect without what is stated or judged of its size beforehand."""
        return self

    def richer(self) -> Effect | None:
        """The effect with more terms; None where there is none, or enough."""
        return None

    def richer_starts(self, values: Floats) -> Floats:
        """Values (S, q) to begin a fit of `richer()` from, about these (p,) of its own."""
        return values[None]

    def in_picture(self, data: Observations | None = None) -> Effect | None:
        """The effect as the picture's depth shows it, on these data; None where a picture knows nothing of it."""
        return None


# Two parameters, one an axis: an axis along which nothing varies tells nothing of its own, which is then 0.


def with_told(parameters: Sequence[Parameter], told: Bools) -> tuple[Parameter, ...]:
    """The parameters, held at 0 in their unit where their axis is not `told` (p,)."""
    pairs = zip(parameters, told, strict=True)
    return tuple(p if seen else replace(p, bounds=(0.0, 0.0)) for p, seen in pairs)


def told_starts(starts: Floats, told: Bools) -> Floats:
    """Those of the starts (s, p), in their unit, that leave axes alone that are not `told` (p,)."""
    return np.asarray(starts[~(starts[:, ~told] != 0).any(axis=1)])
