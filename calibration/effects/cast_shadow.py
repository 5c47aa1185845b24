"""Lamps cast shadows beside a face: slopes there are read too steep, the farther out the deeper it stands.

    seen = w (1 + A max(0, 1 - d/(r w)))        d: from the edge to the place

r w is how far a lamp's shadow reaches beside a wall of height w: r the cotangent of its elevation, A how much too
steep gel is read at the foot of the wall. Three lamps round the pad shade all sides, one another's in part. What is
read within r w of the edge grows faster than w; beyond, and for gentle presses, it is right. Faces are left to what
the height map says of itself. Vanishes at A = 0.

What it does: nu, read from that gel, comes out too low by up to .04, and E too high by 5 to 20 %. Certified depths
know nothing of light. Added, it is no number to be fitted: the frames are read again with the shadows undone.
Source: geometry of a strip lamp; the linear fall by judgement (lamps of one elevation, a penumbra).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.effects.support.in_picture import BesideFaces, InPicture, OfPicture
from calibration.inputs.observations import Observations
from calibration.model.parameters import Parameter, Prior
from calibration.model.stages import ManualCheck
from tactilevision.records import Floats

REACH, REACH_STD = 2.5, 0.7  # cotangent of 22 degrees; 15 to 35 degrees lie within two std


@dataclass(frozen=True, slots=True)
class CastShadow(OfPicture):
    """One strength and one reach for all sides."""

    key = "cast_shadow"
    title = "lamps cast shadows beside the faces"
    seen_in = ("w", "slope")
    confused_with = ("slope_saturation", "photometric_gain")
    separated_by = ("presses of several depths", "pictures of balls, which tell the lamps' places")
    source = "geometry"
    threshold = True
    order = 250
    largest = 2.0
    check = ManualCheck("look at a deep press: is the gel beside the face dark away from a lamp?", 2.0)
    treatment = "undo_shadows"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A, r."""
        usual = Prior(REACH, REACH_STD, "lamps 15 to 35 degrees high")
        return (
            Parameter("excess", "1", 0.0, (0.0, 4.0), "how much too steep gel is read at the wall's foot", 0.3),
            Parameter("reach", "1", REACH, (0.8, 6.0), "length of a shadow over the depth", REACH_STD, usual),
        )

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.3, 1.8], [0.3, 2.5], [0.3, 3.5], [1.0, 2.5]])

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        slopes = data.slopes
        if slopes is None:
            return depth_mm
        excess, reach = values
        beside = np.nan_to_num(slopes.from_mm, nan=np.inf)
        dark = np.maximum(0.0, 1 - beside / np.maximum(reach * data.depth_mm, 1e-9))
        return np.asarray(depth_mm * (1 + excess * dark))

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Slopes beside faces show it."""
        return BesideFaces(self)
