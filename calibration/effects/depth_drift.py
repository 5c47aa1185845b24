"""Drift of the depth's zero with the rig's working time, as of a gel that swells or a stage that warms up.

    w -> w + d (1 - exp(-s/(k S))) / (1 - exp(-1/k))

s is the working time so far, S that of the whole recording, d in mm the drift from first to last, k the share of S
after which it settles. A swelling gel also gets thicker and softer by some tenths of d/h, which is neglected.
Range: |d| up to .2 mm, k .1 to 20; vanishes at d = 0. Source: definition.
"""

from __future__ import annotations

from calibration.inputs.conditions import missing_times, settling_share
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats


class DepthDrift(EffectBase):
    """Size and settling time of the drift."""

    key = "depth_drift"
    title = "the zero of the depth drifts while the rig works: the gel swells, or the stage warms up"
    stage = Stage.DEPTH
    seen_in = ("order", "1/w")
    confused_with = ("depth_zero", "force_drift", "gain_drift")
    separated_by = ("the first touch repeated after the last press",)
    source = "definition"
    order = 11
    largest = 0.05
    check = ManualCheck("find the first touch again after the last press: is it at the same depth?", 3, 0.005)
    parameters = (
        amplitude("size_mm", "mm", 0.2, "drift from the first press to the last", 0.01),
        Parameter("settles", "1", 1.0, (0.1, 20), "share of the working time after which it settles", 1.0),
    )
    start_values = tuple((sign * 0.01, share) for share in (0.5, 10) for sign in (1, -1))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_times(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the drift."""
        return state.plus(depth_mm=values[0] * settling_share(data, values[1]))
