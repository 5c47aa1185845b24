"""Bias of the force sensor: a constant force is added to every reading.

    P -> P + b

b in N is also read in air. Range: |b| up to 5 N; vanishes at b = 0. On one radius it is confused with a depth
zero while P is linear in w; other radii or samples in air distinguish it. Source: definition.
"""

from __future__ import annotations

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


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
    check = ManualCheck("read the force sensor with the punch in air, before and after each press", 3, 0.004)
    parameters = (amplitude("offset_N", "N", 5.0, "force read in air", 0.02),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the bias."""
        return state.plus(force_N=values[0])
