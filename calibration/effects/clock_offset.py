"""The clocks of depth and force differ: the force belongs to the depth a moment later, w(t) -> w(t + dt).

Within a press w is taken as straight between its samples and held before and after them. Seen wherever the depth
moves: more in fast presses, with opposite sign in unloading. Vanishes at dt = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class ClockOffset(EffectBase):
    """One shift in time."""

    key = "clock_offset"
    title = "the clocks of depth and force differ"
    stage = Stage.DEPTH
    seen_in = ("rate", "load/unload")
    confused_with = ("viscoelasticity",)
    separated_by = ("a hold", "fast and slow presses")
    source = "definition"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """dt."""
        return (
            Parameter(
                "offset_s", "s", 0.0, (-0.2, 0.2), "how much later the depth is that belongs to a force", 0.02
            ),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if not data.is_curves or not np.isfinite(data.time_s).all():
            return "needs depth and force over time within a press (curves)"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Read the depth at another time."""
        return replace(state, depth_mm=state.depth_mm + _moved(data, values[0]) - data.depth_mm)


def _moved(data: Observations, offset_s: float) -> Floats:
    """The depth read (N,) at t + offset, press by press."""
    ends = [*data.first[1:], data.size]
    parts = []
    for start, end in zip(data.first, ends, strict=True):
        time, depth = data.time_s[start:end], data.depth_mm[start:end]
        parts.append(np.interp(time + offset_s, time, depth) if end - start > 1 else depth)
    return np.concatenate(parts)
