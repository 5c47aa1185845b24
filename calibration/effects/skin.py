"""Skin: a stiffer coating raises the stiffness, the more the smaller the punch.

    E_eff/E = 1 + (S/t) I0(t/a),    S = (E_skin/E - 1) t,
    I0(x) = (2/pi) arctan x + [(1 - 2 nu) x ln(1 + 1/x^2) - x/(1 + x^2)] / (2 pi (1 - nu))

t is the thickness of the coating and S its excess of modulus times thickness, both in mm; a is the punch's radius.
First order in the mismatch, with the weight I0 at nu = 1/2; for t << a only S is determined. Range: S up to 1 mm,
t .002 to .2 mm; vanishes at S = 0. Confused with the gel's thickness; many radii distinguish it.
Source: Gao, Chiu, Lee, Int. J. Solids Struct. 29 (1992) 2471, eq. 28.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Floats


class Skin(EffectBase):
    """An excess and a thickness."""

    key = "skin"
    title = "the gel carries a stiffer skin"
    acts_on = "punch"
    stage = Stage.GEOMETRY
    seen_in = ("a",)
    confused_with = ("thickness",)
    separated_by = ("many radii",)
    source = "Gao, Chiu, Lee, Int. J. Solids Struct. 29 (1992) 2471"
    order = 130
    parameters = (
        Parameter("excess_mm", "mm", 0.0, (0, 1), "excess of modulus times thickness", 0.1),
        Parameter("thickness_mm", "mm", 0.02, (0.002, 0.2), "thickness of the skin", 0.02),
    )
    start_values = ((0.05, 0.01), (0.2, 0.03))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show a skin; empty where they can."""
        return "needs punches of several radii" if np.unique(data.presses.radius_mm).size < 2 else ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the stiffness raised."""
        surplus = values[0] / values[1] * weight(values[1] / state.radius_mm)
        return state.times(factor=1 + surplus)


def weight(ratio: Floats, poisson_ratio: float = 0.5) -> Floats:
    """Return Gao's I0 at ratio (N,) = t/a: from 0 for no skin to 1 for a thick one."""
    log = (1 - 2 * poisson_ratio) * ratio * np.log1p(ratio**-2.0)
    tail = (log - ratio / (1 + ratio**2)) / (2 * np.pi * (1 - poisson_ratio))
    share: Floats = 2 / np.pi * np.arctan(ratio) + tail
    return share
