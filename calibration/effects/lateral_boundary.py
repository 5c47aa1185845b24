"""The gel ends near the punch, which changes its stiffness with the distance d from the edge.

    K0 -> K0 [1 + s exp(-(d - a)/lambda)]

s below 0 for a free edge, above for a held one; a layer forgets over a length lambda of about its thickness
(Saint-Venant). Even in the position, unlike a wedge. Vanishes at s = 0. Source: form by judgement; the decay of
end effects in a bonded layer: Horgan, Knowles, Adv. Appl. Mech. 23 (1983) 179.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

SAME_MM = 0.5  # distances from rim to edge nearer than this are one


@dataclass(frozen=True, slots=True)
class LateralBoundary(EffectBase):
    """One amplitude and one length."""

    key = "lateral_boundary"
    title = "the gel's edge is near"
    stage = Stage.GEOMETRY
    seen_in = ("x", "y", "azimuth")
    confused_with = ("youngs_modulus", "thickness_wedge")
    separated_by = ("presses at several places",)
    source = "Horgan, Knowles, Adv. Appl. Mech. 23 (1983) 179"
    order = 100
    largest = 0.3
    check = ManualCheck("press at +-6 mm in x and y", 10.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """s and lambda."""
        return (
            Parameter("strength", "1", 0.0, (-3.0, 3.0), "relative change of stiffness at the very edge", 0.5),
            Parameter("length_mm", "mm", 3.0, (0.5, 12.0), "length over which the edge is forgotten", 2.0),
        )

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same; the length is the gel's thickness where fewer than three distances cannot tell it."""
        strength, length = self.parameters
        if np.unique(np.round(_gap(data) / SAME_MM)).size >= 3:
            return strength, length
        held = float(np.clip(data.gel.thickness_mm, *length.bounds))
        return strength, replace(length, default=held, bounds=(held, held))

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if data.gel.shape == "unbounded":
            return "needs the gel's outline ([sensor.gel] shape)"
        gap = edge_distance(data)
        if not np.isfinite(gap).all() or np.ptp(gap) < 0.5:
            return "needs presses at several distances from the gel's edge (x_mm, y_mm)"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.3, 1.5], [-0.3, 1.5], [0.3, 3.0], [-0.3, 3.0], [0.3, 8.0], [-0.3, 8.0]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the stiffness by place."""
        factor = 1 + values[0] * np.exp(-_gap(data) / values[1])
        return replace(state, factor=state.factor * factor[data.press])


def _gap(data: Observations) -> Floats:
    """From the rim of each press's punch (M,) to the gel's nearest edge, mm; 0 where it reaches beyond."""
    return np.asarray(np.maximum(edge_distance(data) - data.presses.radius_mm, 0))


def edge_distance(data: Observations) -> Floats:
    """From the axis of each press (M,) to the gel's nearest edge, mm; NaN where a place was not recorded."""
    gel, presses = data.gel, data.presses
    if gel.shape == "rectangle" and gel.size_mm is not None:
        aside = gel.size_mm[0] / 2 - np.abs(presses.x_mm)
        return np.asarray(np.minimum(aside, gel.size_mm[1] / 2 - np.abs(presses.y_mm)))
    return np.asarray((gel.radius_mm or np.nan) - np.hypot(presses.x_mm, presses.y_mm))
