"""Depths that are read in coarse steps, and the part of a reading that the step has taken from its course."""

from __future__ import annotations

import numpy as np

from calibration.inputs.denoised_depth import denoised_depth
from calibration.inputs.observations import TYPICAL_ZERO_MM, Observations
from tactilevision.records.measured import Floats

EVEN = 1e-3  # of a step: nearer to a multiple of it a depth lies on it
OFTEN = 4  # samples of one depth, on average, from which steps are looked for


def step_mm(depth_mm: Floats) -> float:
    """Return the step of which all depths (N,) are multiples but for one offset; 0 where it is below .004 mm."""
    places = np.unique(depth_mm)
    if places.size < 2 or places.size * OFTEN > depth_mm.size:
        return 0.0
    gaps = np.diff(places)
    step = float(np.min(gaps))
    even = np.abs(gaps / step - np.round(gaps / step)).max() < EVEN
    return step if even and step > TYPICAL_ZERO_MM else 0.0


def rounding_mm(data: Observations) -> Floats | float:
    """Return the depths (N,) as read less their course in time, mm; 0 where they are not read in steps."""
    if not data.is_timed or not step_mm(data.depth_mm):
        return 0.0
    return np.asarray(data.depth_mm - denoised_depth(data))
