"""Saturation of steep slopes: the reconstructed depth is s tanh(w/s), so w -> s artanh(w/s).

    seen = s tanh(w/s),    k = 1/s

s is the largest depth that can be read: the wall of a punch steepens in proportion to its depth, so the law of the
slopes carries over to the depth. Where slopes next to the faces were read (SlopeCeiling), S tanh(g/S) is read of a
slope g. A wall of slope m w then loses what this ceiling takes beyond the method's own, the steepest slope S_0 in
its calibration: its depth is read times T(m w hypot(1/S, 1/S_0)) / T(m w/S_0) with T(x) = tanh(x)/x. Range: k up
to 1.5/mm, 1/S up to 8; vanishes at k = 0. Confused with stiffening and a depth zero; a gauge at several depths
distinguishes it. Source: form by judgement (tanh is the simplest response with a ceiling).
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from calibration.effects.in_picture import InPicture, Pictured
from calibration.inputs.observations import Observations
from calibration.laws.reconstructed_depth import WALLS_PER_MM, WALLS_PER_MM_STD, read_share, wall_share
from calibration.model.stages import ManualCheck, Parameter, Prior, Stage, State
from tactilevision.records.measured import Floats

HIGHEST = 0.999  # of the ceiling: a depth nearer to it counts as this one
WALL_PRIOR = Prior(WALLS_PER_MM, WALLS_PER_MM_STD, "what pixels and blur leave of a wall")


class SlopeSaturation(Pictured):
    """One ceiling, as its inverse."""

    key = "slope_saturation"
    title = "steep slopes are read too flat"
    stage = Stage.DEPTH
    seen_in = ("w",)
    confused_with = ("stiffening", "depth_zero")
    separated_by = ("a gauge at several depths",)
    source = "form by judgement"
    order = 240
    check = ManualCheck("press balls of two sizes: are the steep ones read too flat?", 10, 0.1)
    depth_source = "vision"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "inverse_ceiling_per_mm", "1/mm", 0.0, (0, 1.5), "one over the largest depth that can be read", 0.3
        ),
    )
    start_values: ClassVar[tuple[tuple[float, ...], ...]] = ((0.2,), (0.5,), (0.9,))

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        k = values[0]
        seen: Floats = np.tanh(k * depth_mm) / k if k > 0 else depth_mm
        return seen

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth corrected for the ceiling."""
        k = values[0]
        if k <= 0:
            return state
        return replace(state, depth_mm=np.arctanh(np.clip(k * state.depth_mm, -HIGHEST, HIGHEST)) / k)

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Return the effect in the picture: a ceiling of slopes where these data have slopes next to faces."""
        return InPicture(self if data is None or data.slopes is None else SlopeCeiling())

    def unseen(self, data: Observations) -> str:
        """Return why these depths cannot show saturation: of a punch only slopes next to its face do."""
        std = data.reconstructed_std_mm
        stated = std is not None and np.isfinite(std).all() and (std > 0).all()
        if stated and data.slopes is None:
            return "behind a punch's walls the height map's own std covers it; balls would show it"
        return ""


class SlopeCeiling(SlopeSaturation):
    """One ceiling of slopes, as its inverse, and how steep a face's walls appear."""

    parameters = (
        Parameter("inverse_ceiling", "1", 0.0, (0, 8), "one over the largest slope that can be read", 1.0),
        Parameter("walls_per_mm", "1/mm", WALLS_PER_MM, (0.3, 4), "slope of a face's walls over its depth",
                  WALLS_PER_MM_STD, WALL_PRIOR),
    )  # fmt: skip
    start_values = tuple((k, m) for k in (0.5, 1.5, 3) for m in (1, 2))

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        k, m = values
        if k <= 0:
            return depth_mm
        slopes = data.slopes
        assert slopes is not None
        own = 1 / np.nanmedian(slopes.ball_slope)
        walls = wall_share(k / own, own * m * data.depth_mm)
        seen: Floats = depth_mm * np.where(np.isnan(slopes.slope), walls, read_share(k * slopes.slope))
        return seen
