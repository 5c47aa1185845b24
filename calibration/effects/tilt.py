"""Tilt of the punch by theta: until its whole face touches, less of it presses.

    w_eff = a theta f(w/(a theta), a/h)    for -a theta < w < 2 a theta,    w_eff = w beyond,
    w = w_read - t a theta

w is the depth of the face's centre. t is 1 where the depth counts from the first touch of the lower edge, and 0
where it counts from the undeformed surface; a stage may be set to either, so t is fitted. f is the exact contact
without tension of a rigid flat face on a bonded layer, tabulated in tactilevision.mechanics.tilted_punch; from
w = 2 a theta on the whole face is in contact, since its pressure (w + 2 theta x)/sqrt(a^2 - r^2) is nowhere
negative. Below -a theta nothing presses, and adhesion acts on all of w.

Range: theta up to .1 rad; vanishes at theta = 0. It acts only at small depth and is confused with a depth zero and
a rounded edge; the growth of the contact area, or turning the punch by 180 degrees, distinguishes it. Source:
Johnson, Contact Mechanics (1985), secs. 3.8 and 5.1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.dual import chained, moves, value_of
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.mechanics.tilted_punch import upright
from tactilevision.records.measured import Floats


class Tilt(EffectBase):
    """One angle for all presses."""

    key = "tilt"
    title = "the punch is tilted"
    acts_on = "punch"
    stage = Stage.DEPTH
    seen_in = ("w", "azimuth", "Fx", "Fy")
    confused_with = ("depth_zero", "edge_fillet")
    separated_by = ("growth of the footprint", "turning the punch by 180 degrees")
    source = "Johnson, Contact Mechanics (1985)"
    threshold = True
    order = 70
    largest = 0.02
    check = ManualCheck("turn the punch by 180 degrees and press again", 5, 0.003)
    parameters = (
        Parameter("angle_rad", "rad", 0.0, (0, 0.1), "angle between the face and the gel", 0.01),
        Parameter("from_touch", "1", 0.0, (0, 1), "0: depth of the centre; 1: since the first touch", 0.3),
    )

    start_values = tuple((angle, touch) for angle in (0.002, 0.005, 0.01, 0.02, 0.04) for touch in (0.0, 1.0))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth of an upright punch of the same force."""
        if values[0] <= 0:
            return state
        reach = data.radius_mm * values[0]
        centre = (state.depth_mm - reach * values[1]) / reach
        return replace(state, depth_mm=reach * _upright(centre, data))


def _upright(centre: Floats, data: Observations) -> Floats:
    """Return the depth (N,) of an upright punch over a theta, at the centre's depth (N,) over a theta."""
    x, (effective, rate) = value_of(centre), np.empty((2, data.size))
    for radius in np.unique(data.presses.radius_mm):
        mine = data.radius_mm == radius
        ratio = float(radius / data.gel.thickness_mm)
        effective[mine] = np.where(x[mine] < -1, x[mine], upright(x[mine], ratio))
        rate[mine] = np.where(x[mine] < -1, 1.0, upright(x[mine], ratio, rate=True)) if moves(centre) else 0.0
    return chained(effective, [(rate, centre)]) if moves(centre) else effective
