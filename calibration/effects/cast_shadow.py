"""Lamps cast shadows beside a face: slopes there are read too steep, the farther out the deeper it stands.

    seen = w (1 + (A w/s) D),    D = (r w - b - d)/W, from 0 to 1        d: from the edge to the place

Gel that a lamp does not reach looks tilted away from the face, whatever its own slope s is: by A w, since a deeper
face hides it from more of a lamp, and from more lamps. A shadow ends r w - b beside the edge: r the cotangent of
the lamp's elevation, b what the wall's own width and the gel that stands up beside it take off, W its soft end.
Lamps round the pad shade all sides. What is read there grows faster than w; beyond, and for gentle presses, it is
right. Faces are left to what the height map says of itself. Vanishes at A = 0.

What it does: nu, read from that gel, comes out too low by up to .04, and E too high by 5 to 20 %. Certified depths
know nothing of light. Added, it is no number to be fitted: rings that a wall may shade are not used (`treat`).
Source: geometry of a strip lamp; one tilt and one reach for all sides, and A w, by judgement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.effects.in_picture import BesideFaces, InPicture, OfPicture
from calibration.inputs.observations import Observations
from calibration.model.stages import ManualCheck, Parameter, Prior, Stage
from tactilevision.records.measured import Floats

REACH = 2.7  # cotangent of a lamp's elevation: of 20 degrees
REACH_STD = 0.7  # of it: 15 to 35 degrees lie within two
TOE_MM = 0.35  # mm by which walls and the gel beside them shorten a shadow: rendered presses
TOE_STD_MM = 0.15  # mm, std of it: by judgement
SOFT_MM = 0.3  # mm over which a strip's shadow ends, and over which a ring's slope is taken


@dataclass(frozen=True, slots=True)
class CastShadow(OfPicture):
    """One tilt and one reach for all sides."""

    key = "cast_shadow"
    title = "lamps cast shadows beside the faces"
    stage = Stage.DEPTH
    seen_in = ("w", "slope")
    confused_with = ("slope_saturation", "photometric_gain")
    separated_by = ("presses of several depths", "rings farther from the faces")
    source = "geometry"
    threshold = True
    order = 250
    largest = 0.6
    check = ManualCheck("look at a deep press: is the gel beside the face dark away from a lamp?", 2.0)
    treatment = "outside_shadow_zone"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A, r, b."""
        usual = Prior(REACH, REACH_STD, "lamps 15 to 35 degrees high")
        toe = Prior(TOE_MM, TOE_STD_MM, "walls of rendered presses")
        return (
            Parameter(
                "tilt_per_mm", "1/mm", 0.0, (0.0, 2.0), "slope that gel in shadow seems to have, over w", 0.1
            ),
            Parameter("reach", "1", REACH, (0.8, 6.0), "length of a shadow over the depth", REACH_STD, usual),
            Parameter("toe_mm", "mm", TOE_MM, (0.0, 1.0), "by how much walls shorten it", TOE_STD_MM, toe),
        )

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.1, reach, TOE_MM] for reach in (2.0, 2.5, 3.2, 4.0)])

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        slopes = data.slopes
        if slopes is None:
            return depth_mm
        tilt, reach, toe = values
        dark = np.clip((reach * data.depth_mm - toe - slopes.from_mm) / SOFT_MM, 0.0, 1.0)
        return np.asarray(depth_mm * (1 + np.nan_to_num(tilt * data.depth_mm * dark / slopes.slope)))

    def treat(self, data: Observations) -> Observations:
        """Return the data without the falls that begin within the reach of a low lamp's shadow, r w - b."""
        depth_mm = {
            (int(number), label): depth
            for number, label, depth in zip(data.presses.recording, data.presses.label, data.depth_mm, strict=True)
        }
        end_mm = {press: (REACH + 2 * REACH_STD) * depth - TOE_MM for press, depth in depth_mm.items()}
        return replace(
            data, falls=tuple(f for f in data.falls if f.from_mm >= end_mm.get((f.recording, f.press), np.inf))
        )

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Slopes beside faces show it."""
        return BesideFaces(self)
