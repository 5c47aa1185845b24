"""Temperature dependence of the gel's modulus.

    E(T) = E0 [1 + alpha (T - Tref)],    Tref the mean of these data

alpha in 1/K: rubber elasticity alone gives 1/T, +.34 % per kelvin; ageing and swelling may reverse the sign.
Range: |alpha| up to .05/K; vanishes at alpha = 0. Confused with ageing; a thermometer, and days of like
temperature, distinguish it. Source: Treloar, The Physics of Rubber Elasticity (1975), ch. 2.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class Temperature(EffectBase):
    """One coefficient."""

    key = "temperature"
    title = "the gel feels the temperature"
    stage = Stage.MATERIAL
    seen_in = ("T",)
    confused_with = ("ageing",)
    separated_by = ("a thermometer, and days of like temperature",)
    source = "Treloar (1975), ch. 2"
    order = 210
    check = ManualCheck("write down the gel's temperature at each press", 1)
    parameters = (amplitude("per_K", "1/K", 0.05, "relative change of E for a kelvin", 0.005),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        if not np.isfinite(data.temperature_C).all() or np.ptp(data.temperature_C) < 0.5:
            return "needs a temperature that was recorded and varies (temperature_C)"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with force and stiffness scaled by temperature."""
        factor = 1 + values[0] * (data.temperature_C - np.mean(data.temperature_C))
        return state.times(force_N=factor, stiffness_N_per_mm=factor)
