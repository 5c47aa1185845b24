"""Compliance of the rig and of the gel's backing, where the depth is the travel of the stage.

    w -> w - C P

C is a compliance in mm/N, P the normal force in N: the gel's own depth is less than the stage's travel by C P.
Range: C up to .1 mm/N; vanishes at C = 0. With one punch it changes E alone to first order, so it is confused with
E and with a skin; a press on the bare backing, or the camera's depth next to the stage's, distinguishes it.
Source: definition of springs in series.
"""

from __future__ import annotations

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


class BackingCompliance(EffectBase):
    """One spring in series with the gel."""

    key = "backing_compliance"
    title = "the rig gives under load"
    stage = Stage.DEPTH
    seen_in = ("P", "a")
    confused_with = ("youngs_modulus", "skin")
    separated_by = ("a press on bare backing", "the stage against the camera")
    source = "definition"
    reads_force = True
    order = 90
    largest = 0.02
    check = ManualCheck("press on the bare backing", 10, 0.001)
    depth_source = "stage"
    parameters = (Parameter("compliance_mm_per_N", "mm/N", 0.0, (0, 0.1), "compliance of the rig", 0.01),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show the compliance; empty where they can."""
        if data.depth_source != "stage":
            return "the depth is not the stage's: the rig's compliance is not in it"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth less the rig's deflection."""
        return state.plus(depth_mm=-values[0] * data.normal_N)
