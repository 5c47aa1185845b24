"""The force sensor's scale is off: what is read is (1 + g) P.

It is E exactly: no press can show it, only a dead weight. Vanishes at g = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class ForceGain(EffectBase):
    """One factor on every reading."""

    key = "force_gain"
    title = "the force sensor reads too large by a factor"
    stage = Stage.INSTRUMENT
    seen_in = ("P",)
    confused_with = ("youngs_modulus",)
    separated_by = ("a dead weight",)
    source = "definition"
    order = 40
    largest = 0.02
    check = ManualCheck("put a dead weight on the force sensor", 5.0, 0.003)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """g."""
        return (Parameter("gain", "1", 0.0, (-0.2, 0.2), "relative error of the force", 0.02),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        return "a factor on the force is E exactly; a dead weight would show it"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the force."""
        return replace(state, force_N=state.force_N * (1 + values[0]))
