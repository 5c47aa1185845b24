"""Stiffening at large strain beyond the bracket of the contact law.

    P -> P + K0 w gamma (w/h)^2

The next term of the series whose first is beta: the strain energies of Yeoh and Gent add a force that grows with
the square of the strain w/h. gamma is dimensionless. Range: gamma from -60 to 120; vanishes at gamma = 0. Confused
with relaxation and a rounded edge; slow and fast presses, or several radii, distinguish it. Sources: Yeoh, Rubber
Chem. Technol. 66 (1993) 754; Gent, ibid. 69 (1996) 59.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Floats


class Stiffening(EffectBase):
    """One coefficient."""

    key = "stiffening"
    title = "the gel stiffens with strain"
    stage = Stage.MATERIAL
    seen_in = ("w/h",)
    confused_with = ("viscoelasticity", "edge_fillet")
    separated_by = ("slow and fast presses", "several radii")
    source = "Yeoh, Rubber Chem. Technol. 66 (1993) 754"
    order = 190
    instead_of_beta = 4
    parameters = (Parameter("gamma", "1", 0.0, (-60, 120), "coefficient of (w/h)^2", 4),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the next term."""
        strain = np.maximum(state.depth_mm, 0) / state.thickness_mm
        added = state.stiffness_N_per_mm * state.depth_mm * values[0] * strain**2
        return state.plus(force_N=added)
