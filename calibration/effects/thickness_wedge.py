"""Wedge-shaped gel: the thickness varies linearly over the pad.

    h(x, y) = h + sx x + sy y

x and y are measured from the pad's centre, sx and sy are slopes in mm/mm. Each press sees a layer of its own
thickness, which holds for small slopes; the thickness stays above a tenth of h. It is odd in the position, unlike
a near edge. Range: |sx|, |sy| up to .2; vanishes at sx = sy = 0. Confused with the lateral boundary; presses at
opposite places distinguish it. Source: the law's own h.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import AxesEffect, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Bools, Floats

MIN_RANGE_MM = 1.0  # range of places along an axis that determines a slope


class ThicknessWedge(AxesEffect):
    """Two slopes of the thickness."""

    key = "thickness_wedge"
    title = "the gel is thicker on one side"
    stage = Stage.GEOMETRY
    seen_in = ("x", "y", "azimuth")
    confused_with = ("lateral_boundary",)
    separated_by = ("presses at opposite places",)
    source = "the law"
    order = 120
    check = ManualCheck("measure the gel's thickness at four places of its rim", 8, 0.003)
    parameters = tuple(
        amplitude(f"slope_{axis}", "mm/mm", 0.2, f"thickness gained along {axis}", 0.01) for axis in "xy"
    )
    signs = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show a wedge; empty where they can."""
        return "" if self.varies(data).any() else "needs presses at several places (x_mm, y_mm)"

    def varies(self, data: Observations) -> Bools:
        """Return along which of x and y (2,) the places differ enough."""
        place = np.column_stack([data.presses.x_mm, data.presses.y_mm])
        return np.asarray(np.isfinite(place).all() & (np.ptp(place, axis=0) >= MIN_RANGE_MM))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the thickness of each press's place."""
        gain = data.presses.x_mm * values[0] + data.presses.y_mm * values[1]
        thickness = np.maximum(state.thickness_mm + gain[data.press], 0.1 * data.gel.thickness_mm)
        return replace(state, thickness_mm=thickness)
