"""The picture's depth scale drifts: s_obs = (1 + d t/T) s, so w -> w/(1 + d t/T).

A lamp that warms, an exposure that creeps: t counts while the rig runs, T in all; a pause of more than an hour
counts as an hour. Vanishes at d = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.effects.in_picture import InPicture
from calibration.effects.photometric_gain import NOT_VISION
from calibration.inputs.conditions import running_share
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


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
    order = 230
    largest = 0.05
    check = ManualCheck("press the same gauge first and last, and on each day", 10.0, 0.01)
    depth_source = "vision"

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
        return _without_times(data)

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        return np.asarray(depth_mm * (1 + values[0] * running_share(data)))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the depth with time."""
        return replace(state, depth_mm=state.depth_mm / self.seen(np.ones(data.size), values, data))

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Certified depths show it where presses have times."""
        return _DriftInPicture(self)


@dataclass(frozen=True, slots=True)
class _DriftInPicture(InPicture):
    """The drift beside certified depths."""

    def missing(self, data: Observations) -> str:
        """What these depths would need."""
        return _without_times(data)


def _without_times(data: Observations) -> str:
    timed = np.isfinite(data.time_s).all() and np.ptp(data.time_s) > 0 and data.count >= 3
    return "" if timed else "needs times of several presses"
