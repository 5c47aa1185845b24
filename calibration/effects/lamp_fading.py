"""Fading of one lamp: slopes of the sides that it lights are read ever flatter, the others' ever steeper.

    seen = w (1 + (c cos phi + s sin phi) t/T)

phi is the azimuth about the face, t the rig's running time and T its total; c and s are dimensionless. Fading that
all lamps share, and a tint of the whole picture, are corrected by the light of the untouched gel; the part common
to all sides is photometric_drift. E rests on certified depths and does not change; nu is read from all sides and
changes by their common part. Range: |c|, |s| up to .6; vanishes at c = s = 0. Confused with photometric_drift;
pictures of the untouched gel at the beginning and the end distinguish it.
Source: first order of a gain that depends on the side.
"""

from __future__ import annotations

import numpy as np

from calibration.effects.in_picture import OfPicture
from calibration.inputs.conditions import missing_times, running_share
from calibration.inputs.observations import Observations
from calibration.model.stages import AxesEffect, ManualCheck, Stage, amplitude
from tactilevision.records.measured import Floats

SCALE = 0.05  # typical change of what is read on a side


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
    check = ManualCheck("press the same gauge first and last: do opposite sides read alike?", 10, 0.02)
    parameters = tuple(
        amplitude(name, "1", 0.6, f"change of what is read towards {side}, first to last", SCALE)
        for name, side in (("along_x", "the right"), ("along_y", "the bottom"))
    )
    start_values = tuple((SCALE * x, SCALE * y) for x, y in AxesEffect.signs)

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        slopes = data.slopes
        if slopes is None:
            return depth_mm
        angle = np.deg2rad(np.nan_to_num(slopes.azimuth_deg))
        side = values[0] * np.cos(angle) + values[1] * np.sin(angle)
        share = np.where(np.isnan(slopes.azimuth_deg), 0.0, side * running_share(data))
        seen: Floats = depth_mm * (1 + share)
        return seen

    def unseen(self, data: Observations) -> str:
        """Return why these depths cannot show the effect; empty where they can."""
        return super().unseen(data) or missing_times(data)
