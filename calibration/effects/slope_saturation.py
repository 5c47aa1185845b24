"""Steep slopes saturate the camera: what is read is s tanh(w/s), so the true depth is s artanh(w/s).

Given by k = 1/s. A punch's wall steepens in proportion to its depth, so the slopes' law carries over to the
depth. Where slopes themselves were read beside the faces (SlopeCeiling), S tanh(s/S) is read of a slope s; walls
that look as steep as m w lose what such a ceiling takes beyond the method's own, the steepest slope S_0 that the
light was made from: T(m w hypot(1/S, 1/S_0))/T(m w/S_0), T(x) = tanh(x)/x. Vanishes at k = 0. Source: form by
judgement (tanh is the simplest response with a ceiling).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.effects.in_picture import InPicture
from calibration.effects.photometric_gain import NOT_VISION
from calibration.inputs.observations import Observations
from calibration.laws.reconstructed_depth import WALLS_PER_MM, WALLS_PER_MM_STD, of_walls, read_share
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Prior, Stage, State
from tactilevision.records.measured import Floats


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
    order = 240
    check = ManualCheck("press balls of two sizes: are the steep ones read too flat?", 10.0, 0.1)
    depth_source = "vision"

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

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """As a ceiling of slopes where these data have slopes beside faces."""
        return _SaturationInPicture(self if data is None or data.slopes is None else SlopeCeiling())


@dataclass(frozen=True, slots=True)
class SlopeCeiling(SlopeSaturation):
    """One ceiling of slopes, as its inverse, and how steep a face's walls look."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """1/S, m."""
        ceiling, walls = "one over the largest slope that can be read", "slope of a face's walls over its depth"
        usual = Prior(WALLS_PER_MM, WALLS_PER_MM_STD, "what pixels and blur leave of a wall")
        return (
            Parameter("inverse_ceiling", "1", 0.0, (0.0, 8.0), ceiling, 1.0),
            Parameter("walls_per_mm", "1/mm", usual.mean, (0.3, 4.0), walls, usual.std, usual),
        )

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[k, m] for k in (0.5, 1.5, 3.0) for m in (1.0, 2.0)])

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        k, m = values
        if k <= 0:
            return depth_mm
        slopes = data.slopes
        assert slopes is not None
        own = 1 / np.nanmedian(slopes.ball_slope)
        walls = of_walls(k / own, own * m * data.depth_mm)
        return np.asarray(depth_mm * np.where(np.isnan(slopes.slope), walls, read_share(k * slopes.slope)))


@dataclass(frozen=True, slots=True)
class _SaturationInPicture(InPicture):
    """Behind a punch's walls only slopes beside the face show more than the height map says of itself."""

    def missing(self, data: Observations) -> str:
        """What these depths would need."""
        std = data.reconstructed_std_mm
        stated = std is not None and np.isfinite(std).all() and (std > 0).all()
        if stated and data.slopes is None:
            return "behind a punch's walls the height map's own std covers it; balls would show it"
        return ""
