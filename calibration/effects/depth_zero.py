"""Offset of the depth's zero, common to all presses.

    w -> w + w0

w0 in mm is the true depth less the depth read. Range: |w0| up to .1 mm, any contact law; vanishes at w0 = 0. On
one radius it is confused with a force bias while P is linear in w, and with a tilt or a rounded edge; other radii
or samples in air before contact distinguish it. Source: definition.
"""

from __future__ import annotations

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Stage, State, amplitude
from tactilevision.records.measured import Floats


class DepthZero(EffectBase):
    """One shift of the depth."""

    key = "depth_zero"
    title = "the zero of the depth is off"
    stage = Stage.DEPTH
    threshold = True
    seen_in = ("1/w", "w")
    confused_with = ("force_bias", "tilt", "edge_fillet")
    separated_by = ("other radii", "samples in air before contact")
    source = "definition"
    order = 10
    largest = 0.05
    instead_of_beta = 3
    parameters = (amplitude("offset_mm", "mm", 0.1, "true depth less the depth read", 0.02),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth shifted."""
        return state.plus(depth_mm=values[0])
