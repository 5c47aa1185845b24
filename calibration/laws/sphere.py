"""A ball on a bonded layer: P = E F(w; nu, R, h) (1 + beta w/h), Hertz' 4/3 E* sqrt(R) w^1.5 where h is large.

Equation, range and sources: round_body.py.
"""

from __future__ import annotations

from dataclasses import dataclass

from calibration.inputs.observations import Observations
from calibration.laws.round_body import apply_round, round_parameters
from calibration.model.composition import Composable
from calibration.model.parameters import Parameter
from calibration.model.stages import State
from tactilevision.mechanics.round_contact import Ball
from tactilevision.records import Floats, Indenter


@dataclass(frozen=True, slots=True)
class Sphere(Composable):
    """The law for indenters of shape "sphere"; `radius_mm` is the ball's."""

    shape = "sphere"

    @property
    def key(self) -> str:
        """The name in the catalogue."""
        return "sphere"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """E, nu, beta."""
        return round_parameters(data, _body)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Force, and its slope over depth."""
        return apply_round(state, values, data=data, body_of=_body)


def _body(indenter: Indenter) -> Ball:
    return Ball(indenter.radius_mm)
