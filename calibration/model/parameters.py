"""One number that a fit may change: its unit, where it rests, how far it may go, and what it means."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tactilevision.errors import InputError
from tactilevision.records import Pair


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
