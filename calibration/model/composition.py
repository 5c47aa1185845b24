"""Composition of a law and its effects: one function from parameters to the predicted force.

model = FlatPunch() + DepthZero() + Viscoelasticity(terms=2)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from calibration.inputs.observations import TYPICAL_ZERO_MM, Observations
from calibration.model.stages import Effect, Law, Parameter, Stage, State
from tactilevision.errors import InputError
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Floats

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
        return self._places(len(self.law.parameters(data)))

    def _places(self, start: int) -> dict[str, slice]:
        places = {"law": slice(0, start)}
        for effect in self.effects:
            places[effect.key] = slice(start, start + len(effect.parameters))
            start = places[effect.key].stop
        return places

    def slices_of(self, size: int) -> dict[str, slice]:
        """Return the slices for a vector of this many values, without data."""
        return self._places(size - sum(len(e.parameters) for e in self.effects))

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

    def state(self, values: Floats, data: Observations) -> State:
        """Return the state after the last stage."""
        if not any(e.reads_force for e in self.effects):
            return self._pass(values, data)
        first = self._pass(values, data)
        second = self._pass(values, data.with_force(first.force_N))
        return self._pass(values, data.with_force(_limit(data.normal_N, first.force_N, second.force_N)))

    def _pass(self, values: Floats, data: Observations) -> State:
        """Return the state after all stages, with the force in `data` for effects that read it."""
        places = self.slices_of(values.size)
        state = rest_state(data)
        stages = [(e.stage, e) for e in self.effects]
        for effect in (e for stage, e in stages if stage < Stage.MATERIAL):
            state = effect.apply(state, values[places[effect.key]], data)
        state = self.law.apply(state, values[places["law"]], data)
        for effect in (e for stage, e in stages if stage >= Stage.MATERIAL):
            state = effect.apply(state, values[places[effect.key]], data)
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
    """Base of laws: `+` with an effect makes a model."""

    def __add__(self: Any, effect: Effect) -> Model:
        return Model(self) + effect


def _limit(start: Floats, once: Floats, twice: Floats) -> Floats:
    """Return the fixed point of f from x, f(x), f(f(x)) by Aitken's step, exact for a linear f."""
    shrink = (once - start) - (twice - once)
    safe = np.abs(shrink) > TINY * (1 + np.abs(twice))
    ratio = np.where(safe, (twice - once) / np.where(safe, shrink, 1.0), 0.0)
    return np.asarray(np.where(np.abs(ratio) < 5, twice + ratio * (twice - once), twice))


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
