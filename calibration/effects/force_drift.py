"""Drift of the force sensor's zero with the rig's working time, as of a sensor that warms up.

    P -> P + b (1 - exp(-s/(k S))) / (1 - exp(-1/k))

s is the working time so far (pauses count up to an hour), S that of the whole recording, b in N the drift from
first to last, k the share of S after which it settles; a large k is an even drift. Range: |b| up to 1 N, k .1 to
20; vanishes at b = 0. A zero that is read in air before each press removes it. Source: definition.
"""

from __future__ import annotations

from calibration.inputs.conditions import missing_times, settling_share
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats


class ForceDrift(EffectBase):
    """Size and settling time of the drift."""

    key = "force_drift"
    title = "the force sensor's zero drifts while the rig works, as it warms up"
    stage = Stage.INSTRUMENT
    seen_in = ("order", "t")
    confused_with = ("force_bias", "temperature")
    separated_by = ("readings in air before and after each press", "the first press repeated after the last")
    source = "definition"
    order = 31
    largest = 0.2
    check = ManualCheck("read the force sensor in air before the first press and after the last", 3, 0.004)
    parameters = (
        amplitude("size_N", "N", 1.0, "drift from the first press to the last", 0.02),
        Parameter("settles", "1", 1.0, (0.1, 20), "share of the working time after which it settles", 1.0),
    )
    start_values = tuple((sign * 0.01, share) for share in (0.15, 0.5, 10) for sign in (1, -1))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_times(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the drift."""
        return state.plus(force_N=values[0] * settling_share(data, values[1]))
