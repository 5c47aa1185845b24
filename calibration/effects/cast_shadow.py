"""Cast shadows: slopes next to a face that a lamp does not reach are read too steep, more so for deep presses.

    seen = w (1 + (A w/s) D),    D = (r w - b - d)/W, clipped to [0, 1]

d is the distance from the punch's edge and s the gel's own slope there. Gel in shadow appears tilted away from the
face by A w, since a deeper face hides it from more of a lamp. A shadow ends at r w - b from the edge: r is the
cotangent of the lamp's elevation, b is shortened by the wall's own width and the rise of the gel next to it, W is
the soft end. Lamps around the pad shade all sides. Faces keep the height map's own std.

nu read from that gel is too low by up to .04, and E too high by 5 to 20 %; certified depths do not change. Added,
the effect is not fitted: rings that a wall may shade are excluded (`treat`). Range: A up to 2/mm, r .8 to 6, b up
to 1 mm; vanishes at A = 0. Confused with slope saturation and a gain of the depth; presses of several depths, or
rings further from the faces, distinguish it. Source: geometry of a strip lamp; one tilt and one reach for all
sides, and A w, by judgement.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.effects.in_picture import OfPicture
from calibration.inputs.observations import Observations
from calibration.model.stages import ManualCheck, Parameter, Prior, Stage
from tactilevision.records.measured import Floats

REACH = Prior(2.7, 0.7, "lamps 15 to 35 degrees high")  # cotangent of a lamp's elevation
TOE = Prior(0.35, 0.15, "walls of rendered presses")  # mm by which walls and the gel next to them shorten a shadow
SOFT_MM = 0.3  # mm over which a strip's shadow ends, and over which a ring's slope is taken


class CastShadow(OfPicture):
    """One tilt and one reach for all sides."""

    key = "cast_shadow"
    title = "lamps cast shadows next to the faces"
    stage = Stage.DEPTH
    seen_in = ("w", "slope")
    confused_with = ("slope_saturation", "photometric_gain")
    separated_by = ("presses of several depths", "rings farther from the faces")
    source = "geometry"
    threshold = True
    order = 250
    largest = 0.6
    check = ManualCheck("look at a deep press: is the gel next to the face dark away from a lamp?", 2)
    treatment = "outside_shadow_zone"
    parameters = (
        Parameter("tilt_per_mm", "1/mm", 0.0, (0, 2), "slope that gel in shadow seems to have, over w", 0.1),
        Parameter("reach", "1", REACH.mean, (0.8, 6), "length of a shadow over the depth", REACH.std, REACH),
        Parameter("toe_mm", "mm", TOE.mean, (0, 1), "by how much walls shorten it", TOE.std, TOE),
    )
    start_values = tuple((0.1, reach, TOE.mean) for reach in (2, 2.5, 3.2, 4))

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        slopes = data.slopes
        if slopes is None:
            return depth_mm
        tilt, reach, toe = values
        dark = np.clip((reach * data.depth_mm - toe - np.nan_to_num(slopes.from_mm)) / SOFT_MM, 0, 1)
        seen: Floats = depth_mm * (1 + tilt * np.nan_to_num(data.depth_mm / slopes.slope) * dark)
        return seen

    def treat(self, data: Observations) -> Observations:
        """Return the data without the falls that begin within the reach of a low lamp's shadow, r w - b."""
        presses = zip(data.presses.recording.tolist(), data.presses.label, data.depth_mm, strict=True)
        end_mm = {(number, label): (REACH.mean + 2 * REACH.std) * w - TOE.mean for number, label, w in presses}
        falls = tuple(f for f in data.falls if f.from_mm >= end_mm.get((f.recording, f.press), np.inf))
        return replace(data, falls=falls)
