"""The punch stands askew by theta: until its whole face touches, less of it presses.

    w_eff = 2 a theta [(w + a theta)/(3 a theta)]^(3/2)    for -a theta < w < 2 a theta,    w_eff = w beyond,

w the depth of the face's centre; where the depth comes from the stage it counts from the first touch instead, and
w = w_read - a theta. The whole face of a rigid flat punch is in contact with a half-space when the pressure
(w + 2 theta x)/sqrt(a^2 - r^2) is nowhere negative, w >= 2 a theta, and the force is then that of the upright
punch. Below, the power is the only one that starts from the first touch and joins there in value and slope.
Vanishes at theta = 0. Source: Johnson, Contact Mechanics (1985), secs. 3.8 and 5.1 (pressure under a tilted
punch).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


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

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """theta."""
        return (Parameter("angle_rad", "rad", 0.0, (0.0, 0.1), "angle between the face and the gel", 0.01),)

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.002], [0.005], [0.01], [0.02], [0.04]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Weaken the first touch."""
        reach = data.radius_mm * values[0]
        depth = state.depth_mm - (reach if data.depth_source == "stage" else 0.0)
        safe = np.maximum(reach, 1e-12)
        toe = 2 * safe * (np.clip(depth + safe, 0, 3 * safe) / (3 * safe)) ** 1.5
        return replace(state, depth_mm=np.where(depth < 2 * reach, toe, depth))
