"""Stiffening at large strain beyond the bracket of the contact law.

    P -> P + K0 w (gamma (w/h)^2 + gamma_2 (w/h)^4)

The next terms of the series whose first is beta: the strain energies of Yeoh and Gent add a force that grows with
the square of the strain w/h; a gel near the end of its chains needs the second term. Range, dimensionless:
gamma from -60 to 120, gamma_2 up to 1000 either way; vanishes where both are 0. Confused with relaxation and a
rounded edge; slow and fast presses, or several radii, distinguish it. Sources: Yeoh, Rubber Chem. Technol. 66
(1993) 754; Gent, ibid. 69 (1996) 59.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True)
class Stiffening(EffectBase):
    """One coefficient, or two (`terms`)."""

    terms: int = 1

    key = "stiffening"
    title = "the gel stiffens with strain"
    stage = Stage.MATERIAL
    seen_in = ("w/h",)
    confused_with = ("viscoelasticity", "edge_fillet")
    separated_by = ("slow and fast presses", "several radii")
    source = "Yeoh, Rubber Chem. Technol. 66 (1993) 754"
    order = 190
    instead_of_beta = 4

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficient of each term."""
        second = Parameter("gamma_2", "1", 0.0, (-1000, 1000), "coefficient of (w/h)^4", 40)
        return (Parameter("gamma", "1", 0.0, (-60, 120), "coefficient of (w/h)^2", 4), second)[: self.terms]

    def richer(self) -> Stiffening | None:
        """Return the effect with the second term; None where it has it."""
        return Stiffening(2) if self.terms == 1 else None

    def richer_starts(self, values: Floats) -> Floats:
        """Return this coefficient with none of the second."""
        return np.array([[*values, 0.0]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the next terms."""
        square = (np.maximum(state.depth_mm, 0) / state.thickness_mm) ** 2
        added = sum(coefficient * square ** (k + 1) for k, coefficient in enumerate(values))
        return state.plus(force_N=state.stiffness_N_per_mm * state.depth_mm * added)
