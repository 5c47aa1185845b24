"""Lateral boundary: the gel's edge near the punch changes its stiffness.

    K0 -> K0 [1 + s exp(-(d - a)/lambda)]

d is the distance from the punch's axis to the gel's edge, a its radius, lambda the decay length in mm, about the
thickness (Saint-Venant); s is below 0 for a free edge and above 0 for a held one. It is even in the position,
unlike a wedge. Range: |s| up to 3, lambda .5 to 12 mm; vanishes at s = 0. With fewer than three distances lambda
is held at the thickness. Confused with E and a wedge-shaped gel; presses at several places distinguish it. Source:
form by judgement; decay of end effects in a bonded layer: Horgan, Knowles, Adv. Appl. Mech. 23 (1983) 179.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats

SAME_MM = 0.5  # distances from the edge nearer than this count as one


class LateralBoundary(EffectBase):
    """One amplitude and one decay length."""

    key = "lateral_boundary"
    title = "the gel's edge is near"
    stage = Stage.GEOMETRY
    seen_in = ("x", "y", "azimuth")
    confused_with = ("youngs_modulus", "thickness_wedge")
    separated_by = ("presses at several places",)
    source = "Horgan, Knowles, Adv. Appl. Mech. 23 (1983) 179"
    order = 100
    largest = 0.3
    check = ManualCheck("press at +-6 mm in x and y", 10)
    parameters = (
        amplitude("strength", "1", 3, "relative change of stiffness at the very edge", 0.5),
        Parameter("length_mm", "mm", 3, (0.5, 12), "length over which the edge is forgotten", 2.0),
    )
    start_values = tuple((sign * 0.3, length) for length in (1.5, 3, 8) for sign in (1, -1))

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters; the length is fixed at the gel's thickness for fewer than three distances."""
        strength, length = self.parameters
        if np.unique(np.round(_gap(data) / SAME_MM)).size >= 3:
            return strength, length
        return strength, length.held_at(float(np.clip(data.gel.thickness_mm, *length.bounds)))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show the boundary; empty where they can."""
        if data.gel.shape == "unbounded":
            return "needs the gel's outline ([sensor.gel] shape)"
        gap = edge_distance(data)
        if not np.isfinite(gap).all() or np.ptp(gap) < SAME_MM:
            return "needs presses at several distances from the gel's edge (x_mm, y_mm)"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the stiffness scaled by place."""
        factor = 1 + values[0] * np.exp(-_gap(data) / values[1])
        return state.times(factor=factor[data.press])


def _gap(data: Observations) -> Floats:
    """Return the distance from each punch's rim (M,) to the gel's nearest edge, mm; 0 where it reaches beyond."""
    return np.asarray(np.maximum(edge_distance(data) - data.presses.radius_mm, 0))


def edge_distance(data: Observations) -> Floats:
    """Return the distance from each punch's axis (M,) to the gel's nearest edge, mm; NaN for an unknown place."""
    gel, presses = data.gel, data.presses
    if gel.shape == "rectangle" and gel.size_mm is not None:
        width, height = gel.size_mm
        return np.asarray(np.minimum(width / 2 - np.abs(presses.x_mm), height / 2 - np.abs(presses.y_mm)))
    return np.asarray((gel.radius_mm or np.nan) - np.hypot(presses.x_mm, presses.y_mm))
