"""Hysteresis of the force reading: it differs on the way back by a constant.

    P -> P + b    in unloading

As of a force sensor that was loaded, or of friction in the punch's guide. Range: |b| up to 1 N; vanishes at b = 0.
Source: definition.
"""

from __future__ import annotations

from calibration.inputs.denoised_depth import unloading
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class ForceHysteresis(EffectBase):
    """One force in unloading."""

    key = "force_hysteresis"
    title = "the force reads differently on the way back: hysteresis of the sensor, or friction in the guide"
    stage = Stage.INSTRUMENT
    seen_in = ("load/unload",)
    confused_with = ("backlash", "viscoelasticity", "mullins")
    separated_by = ("steps down and up with waits", "several depths")
    source = "definition"
    order = 33
    largest = 0.2
    check = ManualCheck("go down and up in steps, and wait at each: do the two ways meet?", 5)
    parameters = (amplitude("size_N", "N", 1.0, "force added on the way back", 0.02),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return "" if unloading(data).any() else "needs unloading"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force of the way back."""
        return state.plus(force_N=values[0] * unloading(data))
