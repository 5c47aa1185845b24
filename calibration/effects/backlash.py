"""Backlash: the depth reads differently on the way back by the lost motion of the drive.

    w -> w + d    in unloading

Range: |d| up to .2 mm; vanishes at d = 0. Source: definition.
"""

from __future__ import annotations

from calibration.inputs.denoised_depth import unloading
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class Backlash(EffectBase):
    """One length in unloading."""

    key = "backlash"
    title = "the drive has backlash: the depth reads differently on the way back"
    stage = Stage.DEPTH
    seen_in = ("load/unload",)
    confused_with = ("clock_offset", "force_hysteresis", "viscoelasticity")
    separated_by = ("a dial gauge on the punch", "steps down and up with waits")
    source = "definition"
    order = 61
    acts_on = "punch"
    largest = 0.1
    check = ManualCheck("go down and up past a dial gauge: do both ways read the same?", 5, 0.002)
    parameters = (amplitude("size_mm", "mm", 0.2, "lost motion on the way back", 0.01),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return "" if unloading(data).any() else "needs unloading"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth of the way back."""
        return state.plus(depth_mm=values[0] * unloading(data))
