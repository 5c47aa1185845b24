"""Force that grows with the punch's travel, as of a cable, a spring or a guide parallel to the gel.

    P -> P + k (w - w_1),    w_1 the depth at which a press begins

It is also read in air. On one radius without air it is absorbed by E. Range: |k| up to 2 N/mm; vanishes at k = 0.
Source: definition.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class ForceTravel(EffectBase):
    """One stiffness parallel to the gel."""

    key = "force_travel"
    title = "a force grows with the punch's travel: a cable, a spring or a guide next to the gel"
    stage = Stage.INSTRUMENT
    seen_in = ("w", "a")
    confused_with = ("thickness", "force_bias")
    separated_by = ("travel in air", "other radii")
    source = "definition"
    order = 34
    largest = 0.5
    check = ManualCheck("move the punch through the same travel in air: does the force change?", 3, 0.005)
    parameters = (amplitude("stiffness_N_per_mm", "N/mm", 2.0, "force per travel", 0.05),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force of the travel."""
        begin = np.minimum(data.depth_mm[data.first], 0.0)[data.press]
        return state.plus(force_N=values[0] * (data.depth_mm - begin))
