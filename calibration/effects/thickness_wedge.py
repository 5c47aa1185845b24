"""The gel is a wedge: h(x, y) = h + sx x + sy y, x and y from the pad's centre.

Odd in the position, unlike a near edge. Slopes are small: each press sees a layer of its own thickness.
Vanishes at sx = sy = 0. Source: the law's own h.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, told_starts, with_told
from tactilevision.records.measured import Bools, Floats

APART_MM = 1.0  # mm that places lie apart along an axis which tells a slope


@dataclass(frozen=True, slots=True)
class ThicknessWedge(EffectBase):
    """Two slopes of the thickness."""

    key = "thickness_wedge"
    title = "the gel is thicker on one side"
    stage = Stage.GEOMETRY
    seen_in = ("x", "y", "azimuth")
    confused_with = ("lateral_boundary",)
    separated_by = ("presses at opposite places",)
    source = "the law"
    order = 120
    check = ManualCheck("measure the gel's thickness at four places of its rim", 8.0, 0.003)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """sx and sy."""
        return (
            Parameter("slope_x", "mm/mm", 0.0, (-0.2, 0.2), "thickness gained along x", 0.01),
            Parameter("slope_y", "mm/mm", 0.0, (-0.2, 0.2), "thickness gained along y", 0.01),
        )

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same; across a line of places the slope is 0."""
        return with_told(self.parameters, _along(data))

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if not _along(data).any():
            return "needs presses at several places (x_mm, y_mm)"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        starts = np.array([[0.01, 0.0], [-0.01, 0.0], [0.0, 0.01], [0.0, -0.01], [0.01, 0.01], [0.01, -0.01],
                           [-0.01, 0.01], [-0.01, -0.01]])  # fmt: skip
        return told_starts(starts, _along(data))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Thickness by place."""
        gain = data.presses.x_mm * values[0] + data.presses.y_mm * values[1]
        thickness = np.maximum(state.thickness_mm + gain[data.press], 0.1 * data.gel.thickness_mm)
        return replace(state, thickness_mm=thickness)


def _along(data: Observations) -> Bools:
    """Along which of x and y places lie apart (2,)."""
    place = np.column_stack([data.presses.x_mm, data.presses.y_mm])
    return np.asarray(np.isfinite(place).all() & (np.ptp(place, axis=0) >= APART_MM))
