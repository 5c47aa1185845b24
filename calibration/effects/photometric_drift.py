"""The picture's depth scale drifts: s_obs = (1 + d t/T) s, so w -> w/(1 + d t/T), T the whole time of the data.

A lamp that warms, an exposure that creeps. Vanishes at d = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class PhotometricDrift(EffectBase):
    """One drift over the whole of the data."""

    key = "photometric_drift"
    title = "the height map drifts with time"
    stage = Stage.DEPTH
    seen_in = ("time", "order")
    confused_with = ("ageing", "mullins")
    separated_by = ("a gauge or a ball at the beginning and the end",)
    source = "definition"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """d."""
        return (
            Parameter("drift", "1", 0.0, (-0.3, 0.3), "relative change of the depth from first to last", 0.03),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if data.depth_source != "vision":
            return "the depth does not come from the picture"
        if not np.isfinite(data.time_s).all() or np.ptp(data.time_s) <= 0 or data.count < 3:
            return "needs times of several presses"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the depth with time."""
        share = data.time_s - data.time_s.min()
        return replace(state, depth_mm=state.depth_mm / (1 + values[0] * share / share.max()))
