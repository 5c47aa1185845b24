"""The clocks of force and depth differ by dt = F/T clock minus camera clock: w(t) -> w(t - dt).

What is stamped t on the F/T clock happened at t - dt of the camera's: the depth of that moment belongs to it.
Within a press the depth goes straight through each phase, corners included, and stands still before and after.
Seen wherever the depth moves: more in fast presses, with opposite sign in unloading, and of one size everywhere,
which a contact that slips or a gel that relaxes is not. Vanishes at dt = 0.
Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.denoised_depth import denoised_depth
from calibration.inputs.depth_path import depth_at
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class ClockOffset(EffectBase):
    """One shift in time."""

    key = "clock_offset"
    title = "the clocks of depth and force differ"
    stage = Stage.DEPTH
    seen_in = ("log rate", "load/unload")
    confused_with = ("viscoelasticity",)
    separated_by = ("a hold", "fast and slow presses")
    source = "definition"
    same_over = ("load/unload", "log rate", "order")
    order = 60
    largest = 0.1
    check = ManualCheck("tap the sensor ten times: which moves first, picture or force?", 3.0, 0.005)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """dt."""
        return (
            Parameter("offset_s", "s", 0.0, (-0.2, 0.2), "F/T clock minus camera clock, left in the data", 0.02),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if not data.is_curves or not np.isfinite(data.time_s).all():
            return "needs depth and force over time within a press (curves)"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Read the depth at another time."""
        if values[0] == 0:
            return state
        steady = replace(data, depth_mm=denoised_depth(data))  # differences of readings are of their noise
        return replace(state, depth_mm=state.depth_mm + depth_at(steady, -values[0]) - steady.depth_mm)
