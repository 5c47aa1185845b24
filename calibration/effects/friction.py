"""The gel sticks to the face, wholly or in part, which raises the stiffness, and bends the curve.

    P -> P [1 + q (S(nu, a/h) + s1 eps + s2 eps^2)],    q from 0 (slides) to 1 (sticks), eps = w/h

S from the linear layer at the stated nu, .48 where none is; s1 and s2 from finite elements (mechanics.punch_fem:
neo-Hooke, nu .48, edge h/30, pad 5 h, no slip over no friction, w/h .017 to .2; the ratio within .0012, and its
start within .004 of S). Coulomb's mu = .3 lies within 5 % of no slip in all three. For a/h .4 to 1.2 and beyond as
at the ends. On one radius S is E. Vanishes at q = 0.
Source: calibration.laws.theory (Spence, Proc. R. Soc. A 305 (1968) 55).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws.theory import sticking_surplus
from calibration.model.stages import STICKING, EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

RATIOS = (0.4, 0.6, 0.85, 1.2)  # a/h of the finite elements behind LINES and CURVES
LINES = (0.093, 0.277, 0.526, 0.796)  # s1, per unit of w/h
CURVES = (2.81, 2.54, 2.31, 2.07)  # s2, per unit of (w/h)^2


@dataclass(frozen=True, slots=True)
class Friction(EffectBase):
    """One share of full sticking."""

    key = "friction"
    title = "the gel sticks to the punch"
    stage = Stage.MATERIAL
    seen_in = ("a",)
    confused_with = ("youngs_modulus", "beta")
    separated_by = ("lubricated presses", "other radii", "the height map beside the punch")
    source = "Spence, Proc. R. Soc. A 305 (1968) 55"
    order = 140
    largest = 1.0
    check = ManualCheck("wet the punch with soapy water and press again", 10.0, 0.15)
    condition = STICKING

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """q."""
        return (Parameter("share", "1", 0.0, (0.0, 1.0), "share of full sticking", 0.5),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        alike = np.unique(data.presses.radius_mm).size < 2 and np.unique(data.presses.lubricated == 1).size < 2
        return "needs punches of several radii, or lubricated presses beside dry ones" if alike else ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Raise the force of the dry presses."""
        nu = 0.48 if data.gel.poisson_ratio is None else data.gel.poisson_ratio
        dry = np.where(data.presses.lubricated == 1, 0.0, 1.0)[data.press]
        ratio = data.presses.radius_mm / data.gel.thickness_mm
        few, place = np.unique(ratio, return_inverse=True)
        surplus = np.array([sticking_surplus(nu, float(one)) for one in few])[place][data.press]
        strain = np.maximum(state.depth_mm, 0) / state.thickness_mm
        line, curve = (np.interp(ratio, RATIOS, part)[data.press] for part in (LINES, CURVES))
        share = values[0] * dry
        return replace(
            state,
            stiffness_N_per_mm=state.stiffness_N_per_mm * (1 + share * surplus),
            force_N=state.force_N * (1 + share * (surplus + line * strain + curve * strain**2)),
        )
