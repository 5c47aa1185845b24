"""A stiffer coating of thickness t raises the stiffness, the more the smaller the punch.

    E_eff/E = 1 + (S/t) I0(t/a),    S = (E_skin/E - 1) t,
    I0(x) = (2/pi) arctan x + [(1 - 2 nu) x ln(1 + 1/x^2) - x/(1 + x^2)] / (2 pi (1 - nu))

First order in the mismatch, at nu = 1/2 for the weight. Only S shows while t << a. Vanishes at S = 0. Source:
Gao, Chiu, Lee, Int. J. Solids Struct. 29 (1992) 2471, eq. 28.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class Skin(EffectBase):
    """An excess and a thickness."""

    key = "skin"
    title = "the gel carries a stiffer skin"
    stage = Stage.GEOMETRY
    seen_in = ("a",)
    confused_with = ("thickness",)
    separated_by = ("many radii",)
    source = "Gao, Chiu, Lee, Int. J. Solids Struct. 29 (1992) 2471"
    order = 130

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """S and t."""
        return (
            Parameter("excess_mm", "mm", 0.0, (0.0, 1.0), "excess of modulus times thickness", 0.1),
            Parameter("thickness_mm", "mm", 0.02, (0.002, 0.2), "thickness of the skin", 0.02),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        few = np.unique(data.presses.radius_mm).size < 2
        return "needs punches of several radii" if few else ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.05, 0.01], [0.2, 0.03]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Raise the stiffness."""
        return replace(
            state, factor=state.factor * (1 + values[0] / values[1] * weight(values[1] / state.radius_mm))
        )


def weight(ratio: Floats, poisson_ratio: float = 0.5) -> Floats:
    """Gao's I0 at ratio (N,) = t/a: from 0 for no skin to 1 for a thick one."""
    log = (1 - 2 * poisson_ratio) * ratio * np.log1p(ratio**-2.0)
    tail = (log - ratio / (1 + ratio**2)) / (2 * np.pi * (1 - poisson_ratio))
    return np.asarray(2 / np.pi * np.arctan(ratio) + tail)
