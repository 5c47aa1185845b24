"""Steep slopes saturate the camera: what is read is s tanh(w/s), so the true depth is s artanh(w/s).

Given by k = 1/s. A punch's wall steepens in proportion to its depth, so the slopes' law carries over to the
depth. Vanishes at k = 0. Source: form by judgement (tanh is the simplest response with a ceiling).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats

NOT_VISION = "the depth does not come from the picture"


@dataclass(frozen=True, slots=True)
class SlopeSaturation(EffectBase):
    """One ceiling, as its inverse."""

    key = "slope_saturation"
    title = "steep slopes are read too flat"
    stage = Stage.DEPTH
    seen_in = ("w",)
    confused_with = ("stiffening", "depth_zero")
    separated_by = ("a gauge at several depths",)
    source = "form by judgement"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """k."""
        return (
            Parameter(
                "inverse_ceiling_per_mm",
                "1/mm",
                0.0,
                (0.0, 1.5),
                "one over the largest depth that can be read",
                0.3,
            ),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if data.depth_source != "vision":
            return NOT_VISION
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.2], [0.5], [0.9]])

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        k = values[0]
        return np.asarray(np.tanh(k * depth_mm) / k if k > 0 else depth_mm)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Undo the ceiling."""
        k = values[0]
        if k <= 0:
            return state
        return replace(state, depth_mm=np.arctanh(np.clip(k * state.depth_mm, -0.999, 0.999)) / k)
