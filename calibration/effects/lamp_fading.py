"""One lamp fades while the rig runs: slopes of the sides that it lights are read ever less, the others' ever more.

    seen = w (1 + (c cos phi + s sin phi) t/T)        phi: azimuth beside the face

t counts while the rig runs, T in all (photometric_drift.py, which is the part that all sides share). Lamps that
fade alike, and a tint of the whole picture, are taken off by the light of the untouched gel. Vanishes at
c = s = 0. E rests on certified depths and does not move; nu is read from all sides, so that it moves by the part
that they share. Source: first order of a gain that differs by side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.effects.in_picture import BesideFaces, InPicture, OfPicture
from calibration.inputs.conditions import running_share
from calibration.inputs.observations import Observations
from calibration.model.stages import ManualCheck, Parameter, Stage
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class LampFading(OfPicture):
    """One direction and rate."""

    key = "lamp_fading"
    title = "one lamp fades"
    stage = Stage.DEPTH
    seen_in = ("azimuth beside the face", "time", "order")
    confused_with = ("photometric_drift",)
    separated_by = ("pictures of the untouched gel at the beginning and the end",)
    source = "first order"
    order = 260
    largest = 0.3
    check = ManualCheck("press the same gauge first and last: do opposite sides read alike?", 10.0, 0.02)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """c, s."""
        return tuple(
            Parameter(name, "1", 0.0, (-0.6, 0.6), f"change of what is read towards {side}, first to last", 0.05)
            for name, side in (("along_x", "the right"), ("along_y", "the bottom"))
        )

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.05, 0.0], [-0.05, 0.0], [0.0, 0.05], [0.0, -0.05]])

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths."""
        slopes = data.slopes
        if slopes is None:
            return depth_mm
        angle = np.deg2rad(np.nan_to_num(slopes.azimuth_deg))
        side = values[0] * np.cos(angle) + values[1] * np.sin(angle)
        share = np.where(np.isnan(slopes.azimuth_deg), 0.0, side * running_share(data))
        return np.asarray(depth_mm * (1 + share))

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Slopes beside faces show it, where presses have times."""
        return BesideFaces(self, needs_times=True)
