"""The punch stands askew by theta: until its whole face touches, less of it presses.

    w_up = a theta f(w/(a theta), a/h)    for -a theta < w < 2 a theta,    w_up = w beyond,

w = w_read - t a theta the depth of the face's centre: t is 1 where the depth counts from the first touch of the
lower edge, as a stage's does, and 0 where it counts from the gel's own base; of other depths nobody says which. f
is the exact contact without tension of a rigid flat face on a bonded layer, from the table of
tactilevision.mechanics.tilted_punch. The whole face lies on from w = 2 a theta: its pressure
(w + 2 theta x)/sqrt(a^2 - r^2) is then nowhere negative. Below -a theta nothing presses, and what clings to the
face is drawn by all of w. Vanishes at theta = 0.
Source: Johnson, Contact Mechanics (1985), secs. 3.8 and 5.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.mechanics.tilted_punch import upright
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class Tilt(EffectBase):
    """One angle for all presses; acts only at small depth."""

    key = "tilt"
    title = "the punch stands askew"
    stage = Stage.DEPTH
    seen_in = ("w", "azimuth", "Fx", "Fy")
    confused_with = ("depth_zero", "edge_fillet")
    separated_by = ("growth of the footprint", "turning the punch by 180 degrees")
    source = "Johnson, Contact Mechanics (1985)"
    threshold = True
    order = 70
    largest = 0.02
    check = ManualCheck("turn the punch by 180 degrees and press again", 5.0, 0.003)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """theta, t."""
        counts = "0: depth of the centre; 1: since the first touch"
        return (
            Parameter("angle_rad", "rad", 0.0, (0.0, 0.1), "angle between the face and the gel", 0.01),
            Parameter("from_touch", "1", 0.0, (0.0, 1.0), counts, 0.3),
        )

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same; a stage's depth counts from the first touch."""
        angle, touch = self.parameters
        return (angle, replace(touch, default=1.0, bounds=(1.0, 1.0)) if data.depth_source == "stage" else touch)

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        counts = (1.0,) if data.depth_source == "stage" else (0.0, 1.0)
        return np.array([[angle, touch] for angle in (0.002, 0.005, 0.01, 0.02, 0.04) for touch in counts])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Weaken the first touch."""
        if values[0] <= 0:
            return state
        reach = data.radius_mm * values[0]
        depth = state.depth_mm - reach * (1.0 if data.depth_source == "stage" else values[1])
        found = depth.copy()
        for radius in np.unique(data.presses.radius_mm):
            mine = data.radius_mm == radius
            x = depth[mine] / reach[mine]
            found[mine] = reach[mine] * np.where(x < -1, x, upright(x, float(radius / data.gel.thickness_mm)))
        return replace(state, depth_mm=found)
