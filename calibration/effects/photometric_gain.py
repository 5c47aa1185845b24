"""The picture's depth is too large by a factor: s_obs = (1 + g) s, so w -> w/(1 + g).

From forces alone it is E and beta exactly; a certified depth beside the reconstructed one shows it. Vanishes at
g = 0. Source: definition.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.effects.in_picture import InPicture
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

NOT_VISION = "the depth does not come from the picture"


@dataclass(frozen=True, slots=True)
class PhotometricGain(EffectBase):
    """One factor on the depth."""

    key = "photometric_gain"
    title = "the height map is off by a factor"
    stage = Stage.DEPTH
    seen_in = ("certified against reconstructed depth",)
    confused_with = ("youngs_modulus", "beta")
    separated_by = ("a gauge or a ball in each recording",)
    source = "definition"
    order = 220
    largest = 0.05
    check = ManualCheck("press a gauge or a ball of known depth beside the camera's own reading", 10.0, 0.01)
    depth_source = "vision"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """g."""
        return (Parameter("gain", "1", 0.0, (-0.5, 0.5), "relative error of the depth", 0.03),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if data.depth_source != "vision":
            return NOT_VISION
        return "a factor on the depth is E and beta exactly; a gauge beside the picture would show it"

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        return np.asarray(depth_mm * (1 + values[0]))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the depth."""
        return replace(state, depth_mm=state.depth_mm / (1 + values[0]))

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Any certified depth shows it."""
        return InPicture(self)
