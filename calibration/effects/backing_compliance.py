"""The rig and the gel's backing give: where the depth is the stage's, the gel's own is less by C P.

    w -> w - C P

Vanishes at C = 0. Nothing but E changes to first order on one punch. Source: definition of a series spring.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
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
    check = ManualCheck("press on the bare backing", 10.0, 0.001)
    depth_source = "stage"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """C."""
        return (Parameter("compliance_mm_per_N", "mm/N", 0.0, (0.0, 0.1), "give of the rig", 0.01),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        return (
            ""
            if data.depth_source == "stage"
            else "the depth does not come from the stage: the rig's give is not in it"
        )

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Take the give off the depth."""
        return replace(state, depth_mm=state.depth_mm - values[0] * data.normal_N)
