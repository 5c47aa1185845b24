"""A cone on a bonded layer: P = E F(w; nu, angle, h) (1 + beta w/h), Sneddon's 2/pi E* tan(angle) w^2 for large h.

`half_angle_deg` of the indenter is between its axis and its side; InputError where it is not stated. A tip that is
rounded over more than a small part of the depth is a ball's, not a cone's. Equation, range and sources:
round_body.py.
"""

from __future__ import annotations

from dataclasses import dataclass

from calibration.inputs.observations import Observations
from calibration.laws.round_body import apply_round, round_parameters
from calibration.model.composition import Composable
from calibration.model.parameters import Parameter
from calibration.model.stages import State
from tactilevision.errors import InputError
from tactilevision.mechanics.round_contact import Cone as ConeBody
from tactilevision.records import Floats, Indenter


@dataclass(frozen=True, slots=True)
class Cone(Composable):
    """The law for indenters of shape "cone"."""

    shape = "cone"

    @property
    def key(self) -> str:
        """The name in the catalogue."""
        return "cone"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """E, nu, beta."""
        return round_parameters(data, _body)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Force, and its slope over depth."""
        return apply_round(state, values, data=data, body_of=_body)


def _body(indenter: Indenter) -> ConeBody:
    if indenter.half_angle_deg is None:
        raise InputError(
            "a cone needs its angle",
            where=f"[indenter.{indenter.name}]",
            remedy="State half_angle_deg, between its axis and its side.",
        )
    return ConeBody(indenter.half_angle_deg)
