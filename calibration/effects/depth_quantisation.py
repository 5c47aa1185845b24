"""Quantisation of the depth: it is read in coarse steps.

    w -> w - s (w - w_c),    w_c the course of the depths in time, a polynomial of each ramp

s is 1 where the course is right; the steps of plateaus have no course and stay. Range: s up to 1.5, steps above
.004 mm; vanishes at s = 0. Source: definition.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


class DepthQuantisation(EffectBase):
    """The share of the rounding that is corrected."""

    key = "depth_quantisation"
    title = "the depth is read in coarse steps"
    stage = Stage.DEPTH
    seen_in = ("w",)
    confused_with = ("screw_error", "slip_stick")
    separated_by = ("a depth that is read more finely",)
    source = "definition"
    order = 5
    acts_on = "punch"
    check = ManualCheck("read the depth with more digits, or from an encoder", 10)
    parameters = (Parameter("share", "1", 0.0, (0, 1.5), "share of the rounding that is corrected", 0.5),)
    start_values = ((1.0,),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return "" if np.any(data.rounded_mm) else "the depths are not read in steps above .004 mm"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth nearer to its course."""
        return state.plus(depth_mm=-values[0] * data.rounded_mm)
