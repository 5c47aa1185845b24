"""The gel's modulus changes with temperature.

    E(T) = E0 [1 + alpha (T - Tref)],    Tref the mean of these data

Rubber elasticity alone gives alpha = 1/T, +.34 % a kelvin; ageing and swelling may turn the sign. Vanishes at
alpha = 0. Source: Treloar, The Physics of Rubber Elasticity (1975), ch. 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
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
    check = ManualCheck("write down the gel's temperature at each press", 1.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """alpha."""
        return (Parameter("per_K", "1/K", 0.0, (-0.05, 0.05), "relative change of E for a kelvin", 0.005),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if not np.isfinite(data.temperature_C).all() or np.ptp(data.temperature_C) < 0.5:
            return "needs a temperature that was recorded and varies (temperature_C)"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale by temperature."""
        factor = 1 + values[0] * (data.temperature_C - np.mean(data.temperature_C))
        return replace(state, force_N=state.force_N * factor, stiffness_N_per_mm=state.stiffness_N_per_mm * factor)
