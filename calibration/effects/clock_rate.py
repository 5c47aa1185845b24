"""Rate by which the clocks of force and depth differ.

    w(t) -> w(t - r s),    s the working time so far

The offset of the clocks grows with the time since the recording began; a pause counts up to an hour. Range: |r| up
to .005, and offsets up to 1 s; vanishes at r = 0. Source: definition.
"""

from __future__ import annotations

from calibration.effects.clock_offset import later_by
from calibration.inputs.conditions import missing_course, missing_times, running_s
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class ClockRate(EffectBase):
    """One relative difference of the clocks' rates."""

    key = "clock_rate"
    title = "the clocks of depth and force run at different rates"
    stage = Stage.DEPTH
    seen_in = ("load/unload", "order")
    confused_with = ("clock_offset", "viscoelasticity")
    separated_by = ("a tap at the beginning and at the end",)
    source = "definition"
    order = 63
    largest = 0.002
    check = ManualCheck("tap the sensor at the beginning and at the end: by how much do the clocks differ?", 3)
    parameters = (amplitude("rate", "1", 0.005, "rate of the F/T clock over the other's, less 1", 2e-4),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_course(data) or missing_times(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth of another time."""
        return state if values[0] == 0 else state.plus(depth_mm=later_by(-values[0] * running_s(data), data))
