"""Drift of the force sensor's gain with the rig's working time.

    P -> P (1 + g s/S)

s is the working time so far, S that of the whole recording, g the relative change from first to last. Range: |g|
up to .5; vanishes at g = 0. A gel that warms or wears during the recording has the same form. Source: definition.
"""

from __future__ import annotations

from calibration.inputs.conditions import missing_times, running_share
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class GainDrift(EffectBase):
    """One relative change over the working time."""

    key = "gain_drift"
    title = "the force drifts in proportion while the rig works: the sensor's gain, or a gel that warms or wears"
    stage = Stage.INSTRUMENT
    seen_in = ("order",)
    confused_with = ("temperature", "ageing", "mullins")
    separated_by = ("a dead weight before and after", "the first press repeated after the last")
    source = "definition"
    order = 41
    largest = 0.1
    check = ManualCheck("read a dead weight before the first press and after the last", 5, 0.005)
    parameters = (amplitude("gain", "1", 0.5, "change of the force from the first press to the last", 0.03),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_times(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force scaled."""
        return state.times(force_N=1 + values[0] * running_share(data))
