"""Offset between the clocks of force and depth.

    w(t) -> w(t - dt),    dt = F/T clock minus camera clock

A force stamped t on the F/T clock belongs to the depth at t - dt of the camera's clock. Within a press the depth
is piecewise linear in time, with the corners between its phases, and constant before and after. The error grows
with the rate and changes sign in unloading; one dt holds for all samples, which stick-slip and relaxation do not
share. Range: |dt| up to .2 s; vanishes at dt = 0. Confused with relaxation; a hold, or fast and slow presses,
distinguish it. Source: definition.
"""

from __future__ import annotations

from dataclasses import replace

from calibration.inputs.conditions import missing_course
from calibration.inputs.denoised_depth import denoised_depth
from calibration.inputs.depth_path import depth_at, rate_at
from calibration.inputs.observations import Observations
from calibration.model.dual import chained, moves, value_of
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


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
    check = ManualCheck("tap the sensor ten times: which moves first, picture or force?", 3, 0.005)
    parameters = (amplitude("offset_s", "s", 0.2, "F/T clock minus camera clock, left in the data", 0.02),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show the offset; empty where they can."""
        return missing_course(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth of another time."""
        return state if values[0] == 0 else state.plus(depth_mm=later_by(-values[0], data))


def later_by(delay_s: Floats, data: Observations) -> Floats:
    """Return the depth, mm, after a delay of one number or (N,) less the depth now, (N,)."""
    smooth = replace(data, depth_mm=denoised_depth(data))  # else the readings' noise enters twice
    after = value_of(delay_s)
    gained = depth_at(smooth, after) - smooth.depth_mm
    return chained(gained, [(rate_at(smooth, after), delay_s)]) if moves(delay_s) else gained
