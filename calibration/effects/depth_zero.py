"""The depth's zero is off: what was read as w is w + w0.

    w -> w + w0

Any law of force against depth; w0 in mm, above 0 where the true depth is larger. On one radius it cannot be told
from a force bias while P is linear in w. Vanishes at w0 = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class DepthZero(EffectBase):
    """One shift of the depth, common to all presses."""

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

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """w0."""
        return (Parameter("offset_mm", "mm", 0.0, (-0.1, 0.1), "true depth less the depth read", 0.02),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Shift the depth."""
        return replace(state, depth_mm=state.depth_mm + values[0])
