"""Friction at the punch's face: a gel that sticks is stiffer than one that slides, and its curve bends more.

    P -> P [1 + q (S(nu, a/h) + s1 eps + s2 eps^2)],    eps = w/h

q goes from 0 (no friction) to 1 (no slip). S is the surplus stiffness of the linear bonded layer at the stated nu
(.48 where none is stated; Spence). s1 and s2 interpolate finite elements (mechanics.punch_fem: neo-Hookean, nu
.48, edge h/30, pad 5 h, no slip over no friction, w/h .017 to .2), which they reproduce within .0012. Coulomb
friction of .3 lies within 5 % of no slip. Range: a/h from .4 to 1.2, at the ends' values beyond; vanishes at q =
0. On one radius it is confused with E and beta; lubricated presses, other radii, or the height map next to the
punch distinguish it. Source: Spence, Proc. R. Soc. A 305 (1968) 55.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws.theory import nominal_nu, sticking_surplus
from calibration.model.stages import STICKING, EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

RATIOS = (0.4, 0.6, 0.85, 1.2)  # a/h of the finite elements behind LINEAR and QUADRATIC
LINEAR = (0.093, 0.277, 0.526, 0.796)  # s1, per unit of w/h
QUADRATIC = (2.81, 2.54, 2.31, 2.07)  # s2, per unit of (w/h)^2


class Friction(EffectBase):
    """One share of full sticking."""

    key = "friction"
    title = "the gel sticks to the punch"
    acts_on = "punch"
    stage = Stage.MATERIAL
    seen_in = ("a",)
    confused_with = ("youngs_modulus", "beta")
    separated_by = ("lubricated presses", "other radii", "the height map next to the punch")
    source = "Spence, Proc. R. Soc. A 305 (1968) 55"
    order = 140
    largest = 1.0
    check = ManualCheck("wet the punch with soapy water and press again", 10, 0.15)
    condition = STICKING
    parameters = (Parameter("share", "1", 0.0, (0, 1), "share of full sticking", 0.5),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show friction; empty where they can."""
        presses = data.presses
        if np.unique(presses.radius_mm).size < 2 and np.unique(presses.lubricated == 1).size < 2:
            return "needs punches of several radii, or both lubricated and dry presses"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force of dry presses raised."""
        nu, share = nominal_nu(data.gel), values[0] * (data.presses.lubricated != 1)[data.press]
        ratios, place = np.unique(data.presses.radius_mm / data.gel.thickness_mm, return_inverse=True)
        columns = np.array(
            [
                [sticking_surplus(nu, float(r)) for r in ratios],
                np.interp(ratios, RATIOS, LINEAR),
                np.interp(ratios, RATIOS, QUADRATIC),
            ]
        )
        surplus, linear, quadratic = columns[:, place[data.press]]
        strain = np.maximum(state.depth_mm, 0) / state.thickness_mm
        return state.times(
            stiffness_N_per_mm=1 + share * surplus,
            force_N=1 + share * (surplus + linear * strain + quadratic * strain**2),
        )
