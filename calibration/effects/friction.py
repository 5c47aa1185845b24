"""The gel sticks to the face, wholly or in part, which raises the stiffness by a share of the sticking surplus.

    K0 -> K0 [1 + q S(nu, a/h)],    q from 0 (slides) to 1 (sticks)

S from the linear layer at the stated nu, .48 where none is. On one radius it is E. Vanishes at q = 0.
Source: calibration.sticking (Spence, Proc. R. Soc. A 305 (1968) 55).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from calibration.sticking import sticking_surplus
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class Friction(EffectBase):
    """One share of full sticking."""

    key = "friction"
    title = "the gel sticks to the punch"
    stage = Stage.GEOMETRY
    seen_in = ("a",)
    confused_with = ("youngs_modulus", "beta")
    separated_by = ("lubricated presses", "other radii", "the height map beside the punch")
    source = "Spence, Proc. R. Soc. A 305 (1968) 55"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """q."""
        return (Parameter("share", "1", 0.0, (0.0, 1.0), "share of full sticking", 0.5),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        alike = np.unique(data.presses.radius_mm).size < 2 and np.unique(data.presses.lubricated == 1).size < 2
        return "needs punches of several radii, or lubricated presses beside dry ones" if alike else ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Raise the stiffness of the dry presses."""
        nu = 0.48 if data.gel.poisson_ratio is None else data.gel.poisson_ratio
        dry = np.where(data.presses.lubricated == 1, 0.0, 1.0)
        surplus = np.array([sticking_surplus(nu, a / data.gel.thickness_mm) for a in data.presses.radius_mm])
        return replace(state, factor=state.factor * (1 + values[0] * (dry * surplus)[data.press]))
