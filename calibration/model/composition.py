"""Composition of a law and its effects: one function from parameters to the predicted force.

model = FlatPunch() + DepthZero() + Viscoelasticity(terms=2)
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, ClassVar, cast

import numpy as np

from calibration.inputs.observations import TYPICAL_ZERO_MM, Observations
from calibration.model.dual import Dual, moves, value_of
from calibration.model.stages import Effect, EffectBase, Law, Parameter, Stage, State
from tactilevision.errors import InputError
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Floats

ROOT = 6e-6  # cube root of the machine epsilon: relative step of central differences
KEPT = 8  # data sets whose initial state is cached: a fit begins from it at every step


@dataclass(frozen=True, slots=True)
class Model:
    """A contact law and the effects on it. `+` adds one; the order of adding does not matter."""

    law: Law
    effects: tuple[Effect, ...] = field(default=())

    def __post_init__(self) -> None:
        keys = [effect.key for effect in self.effects]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if twice:
            raise InputError("a model has an effect twice", where="Model", value=", ".join(twice))
        object.__setattr__(self, "effects", tuple(sorted(self.effects, key=_place)))

    def __add__(self, effect: Effect) -> Model:
        return Model(self.law, (*self.effects, effect))

    def without(self, key: str) -> Model:
        """Return the model without one effect."""
        return Model(self.law, tuple(e for e in self.effects if e.key != key))

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the effects, in the order in which they act."""
        return tuple(effect.key for effect in self.effects)

    @property
    def name(self) -> str:
        """The law's key and the effects', joined by +."""
        return " + ".join((self.law.key, *self.keys))

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """Return all parameters in the order of `predict`: the law's, then each effect's as `key.name`."""
        effects = [replace(p, name=f"{e.key}.{p.name}") for e in self.effects for p in e.parameters_on(data)]
        return (*self.law.parameters(data), *effects)

    def slices(self, data: Observations) -> dict[str, slice]:
        """Return the slice of each part in the vector of parameters: "law", then the effects' keys."""
        return self.slices_of(len(self.law.parameters(data)) + sum(len(e.parameters) for e in self.effects))

    def slices_of(self, size: int) -> dict[str, slice]:
        """Return the slices for a vector of this many values, without data."""
        return _places(self.effects, size)

    def defaults(self, data: Observations) -> Floats:
        """Return the default of each parameter, with every effect off."""
        return np.array([p.default for p in self.parameters(data)])

    def predict(self, values: Floats, data: Observations) -> Floats:
        """Return the predicted normal force (N,), N; `values` in the order of `parameters`."""
        return self.state(values, data).force_N

    def modulus(self, values: Floats) -> float:
        """Return E in MPa at these values (p,): the law's first parameter, times what effects change of E."""
        places = self.slices_of(values.size)
        return float(values[0] * np.prod([e.of_modulus(values[places[e.key]]) for e in self.effects]))

    def linear(self, values: Floats, data: Observations, *, free: Bools | None = None) -> tuple[Floats, Floats]:
        """Return the force (N,) and d force/d parameter (N, p), by the chain rule; 0 for those not `free`."""
        free = np.ones(values.size, dtype=bool) if free is None else free
        table = np.zeros((data.size, values.size))
        with np.errstate(all="ignore"):  # slopes of a branch that is not chosen may be NaN
            force: Any = self.state(cast(Any, Dual(values, np.eye(values.size)[free])), data).force_N
        if moves(force):
            table[:, free] = force.whole.T
        return value_of(force), table

    def state(self, values: Floats, data: Observations) -> State:
        """Return the state after the last stage."""
        if not any(e.reads_force for e in self.effects):
            return self._pass(values, data)
        first = self._pass(values, data)
        second = self._pass(values, data.with_force(first.force_N))
        return self._pass(values, data.with_force(_limit(data.normal_N, first.force_N, second.force_N)))

    def _pass(self, values: Floats, data: Observations) -> State:
        """Return the state after all stages, with the force in `data` for effects that read it."""
        places = self.slices_of(len(values))
        state = rest_state(data)
        before = sum(e.stage < Stage.MATERIAL for e in self.effects)
        parts: list[Law | Effect] = [*self.effects[:before], self.law, *self.effects[before:]]
        for part in parts:
            own = values[places["law" if part is self.law else part.key]]
            state = _moved(part, state, own, data) if moves(values) else part.apply(state, own, data)
        return state

    def slope(self, values: Floats, data: Observations) -> Floats:
        """Return d force / d depth as read (N,), N/mm, by central differences over the scatter of presses' zeros.

        With a smaller step samples near the kink at the touch would have the whole slope or none from one step of
        a fit to the next, and the fit would not converge.
        """
        step = 4 * TYPICAL_ZERO_MM
        high, low = (self.predict(values, data.shifted(side * step)) for side in (0.5, -0.5))
        return (high - low) / step


class Composable:
    """Base of laws: `+` with an effect makes a model. `analytic` and `reads_force` as of effects."""

    __slots__ = ()
    analytic: ClassVar[bool] = True
    reads_force: ClassVar[bool] = False

    def __add__(self: Any, effect: Effect) -> Model:
        return Model(self) + effect


@lru_cache(maxsize=64)  # a fit asks at every step
def _places(effects: tuple[Effect, ...], size: int) -> dict[str, slice]:
    counts = [len(effect.parameters) for effect in effects]
    ends = np.cumsum([size - sum(counts), *counts]).tolist()
    pairs = zip(effects, ends, ends[1:], strict=False)
    return {"law": slice(0, ends[0])} | {effect.key: slice(start, end) for effect, start, end in pairs}


def _moved(part: Any, state: State, own: Any, data: Observations) -> State:
    """Return the state of Duals after a law or an effect, by differences where its own form takes no Duals.

    So, too, after one that returns the state unchanged at the end of its range.
    """
    if moves(data.force_N) and not part.reads_force:
        data = replace(data, force_N=value_of(data.force_N))
    if part.analytic:
        after: State = part.apply(state, own, data)
        if after is not state or not any(moves(one) for one in own):
            return after
    return _differenced(part, state, own, data)


def _differenced(part: Any, state: State, own: Any, data: Observations) -> State:
    names = [field.name for field in fields(State)]
    plain = {name: value_of(getattr(state, name)) for name in names}
    table = part.parameters if isinstance(part, EffectBase) else part.parameters(data)
    low, high = np.array([p.bounds for p in table]).T
    size = np.maximum(np.abs(own.value), [p.scale for p in table])
    after = part.apply(State(**plain), own.value, data)
    slopes = {name: np.zeros((len(own.slopes), data.size)) for name in names}
    for k, way in enumerate(own.slopes):
        along = {name: one.whole[k] for name in names if isinstance(one := getattr(state, name), Dual)}
        shares = [np.max(np.abs(one)) / max(np.max(np.abs(plain[name])), TINY) for name, one in along.items()]
        if not (share := max(np.max(np.abs(way) / size, initial=0.0), *shares, 0.0)):
            continue
        ends = [own.value + side * ROOT / share * way for side in (-1, 1)]
        steps = [
            side * ROOT / share * bool(((low <= end) & (end <= high)).all())
            for side, end in zip((-1, 1), ends, strict=True)
        ]
        moved = [State(**plain | {n: plain[n] + step * one for n, one in along.items()}) for step in steps]
        sides = [part.apply(one, own.value + step * way, data) for one, step in zip(moved, steps, strict=True)]
        for name in names:
            slopes[name][k] = (getattr(sides[1], name) - getattr(sides[0], name)) / (steps[1] - steps[0])
    whole: dict[str, Any] = {name: Dual(getattr(after, name), slopes[name]) for name in names}
    return State(**{name: one if one.slopes.any() else one.value for name, one in whole.items()})


def _limit(start: Floats, once: Floats, twice: Floats) -> Floats:
    """Return the fixed point of f from x, f(x), f(f(x)) by Aitken's step, exact for a linear f."""
    shrink = (once - start) - (twice - once)
    safe = np.abs(shrink) > TINY * (1 + np.abs(twice))
    ratio = np.where(safe, (twice - once) / np.where(safe, shrink, 1.0), 0.0)
    limit: Floats = np.where(np.abs(ratio) < 5, twice + ratio * (twice - once), twice)
    return limit


@lru_cache(maxsize=KEPT)
def rest_state(data: Observations) -> State:
    """Return the state before the first stage, as read or stated; cached."""
    ones, zeros = np.ones(data.size), np.zeros(data.size)
    thickness = np.full(data.size, data.gel.thickness_mm)
    for array in (ones, zeros, thickness):
        array.setflags(write=False)
    sticking = float(not data.lubricated)  # silicone grips a dry edge
    return State(
        data.depth_mm + data.off_mm, data.radius_mm, data.edge_mm, thickness, ones, zeros, zeros, sticking
    )


def _place(effect: Effect) -> tuple[int, float, str]:
    return int(effect.stage), effect.order, effect.key
