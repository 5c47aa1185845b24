"""One colour saturates: slopes that turn towards its lamp are read too flat, those of the other sides are right.

    seen = w T(k s max(0, cos(phi - phi_0))),        T(x) = tanh(x)/x

s the slope beside a face at azimuth phi, phi_0 the side whose colour is full, k one over the steepest slope that
is read there. All sides alike is slope_saturation.py. Vanishes at k = 0. E rests on certified depths and does not
move; nu comes out too high, since gel that is read too flat seems to give way less.
Source: form by judgement (tanh is the simplest response with a ceiling).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.effects.support.in_picture import BesideFaces, InPicture, OfPicture
from calibration.effects.support.wall_ceiling import read_share
from calibration.inputs.observations import Observations
from calibration.model.parameters import Parameter
from calibration.model.stages import ManualCheck, Stage
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class ColourSaturation(OfPicture):
    """One ceiling, as its inverse, and its side."""

    key = "colour_saturation"
    title = "one colour saturates"
    stage = Stage.DEPTH
    seen_in = ("azimuth beside the face", "slope", "w")
    confused_with = ("slope_saturation", "lamp_fading")
    separated_by = ("a shorter exposure",)
    source = "form by judgement"
    threshold = True
    order = 270
    largest = 4.0
    check = ManualCheck("look at the histogram of each colour over a deep press: does one end at 255?", 2.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """k, phi_0."""
        return (
            Parameter("inverse_ceiling", "1", 0.0, (0.0, 12.0), "one over the largest slope read there", 1.5),
            Parameter("azimuth", "rad", 0.0, (-7.0, 7.0), "the side whose colour is full", 0.5),
        )

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[2.0, turn] for turn in np.deg2rad([-135, -90, -45, 0, 45, 90, 135, 180])])

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        slopes = data.slopes
        if slopes is None:
            return depth_mm
        towards = np.maximum(0.0, np.cos(np.deg2rad(slopes.azimuth_deg) - values[1]))
        return np.asarray(depth_mm * np.nan_to_num(read_share(values[0] * slopes.slope * towards), nan=1.0))

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Slopes beside faces show it."""
        return BesideFaces(self)
