"""The picture's depth scale drifts: s_obs = (1 + d t/T) s, so w -> w/(1 + d t/T).

A lamp that warms, an exposure that creeps: t counts while the rig runs, T in all; a pause of more than an hour
counts as an hour. Vanishes at d = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.effects.photometric_gain import NOT_VISION
from calibration.inputs.observations import Observations
from calibration.model.parameters import Parameter
from calibration.model.stages import EffectBase, Stage, State
from tactilevision.records import Floats

PAUSE_S = 3600.0  # s, what a longer pause counts as: the rig does not work meanwhile


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
            return NOT_VISION
        if not np.isfinite(data.time_s).all() or np.ptp(data.time_s) <= 0 or data.count < 3:
            return "needs times of several presses"
        return ""

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        return np.asarray(depth_mm * (1 + values[0] * running_share(data)))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the depth with time."""
        return replace(state, depth_mm=state.depth_mm / self.seen(np.ones(data.size), values, data))


def running_share(data: Observations) -> Floats:
    """How much of the rig's running time has passed at each sample (N,), 0 to 1."""
    order = np.argsort(data.time_s, kind="stable")
    passed = np.cumsum(np.minimum(np.diff(data.time_s[order], prepend=data.time_s[order[0]]), PAUSE_S))
    share = np.empty(data.size)
    share[order] = passed / passed[-1]
    return share
