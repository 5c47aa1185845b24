"""The force sensor's zero is off: what is read is P + b.

b in N, in air too. On one radius it cannot be told from a depth zero while P is linear in w; air fixes it.
Vanishes at b = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class ForceBias(EffectBase):
    """One force added to every reading."""

    key = "force_bias"
    title = "the force sensor reads a constant too much"
    stage = Stage.INSTRUMENT
    seen_in = ("constant", "1/w")
    confused_with = ("depth_zero",)
    separated_by = ("other radii", "samples in air")
    source = "definition"
    order = 30
    largest = 0.05
    check = ManualCheck("read the force sensor with the punch in air, before and after each press", 3.0, 0.004)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """b."""
        return (Parameter("offset_N", "N", 0.0, (-0.5, 0.5), "force read in air", 0.02),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add the bias."""
        return replace(state, force_N=state.force_N + values[0])
