"""From which force on a reading pulls: so far below the forces of air no reading lies by chance."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calibration.inputs.denoised_depth import drawn_off
from calibration.inputs.observations import Observations
from calibration.inputs.press_noise import TYPICAL_FORCE_N
from tactilevision.robust import mad_std

MIN_AIR = 5  # samples of air on the way in: fewer do not tell how forces scatter there
PULL_SIGMA = 4.0  # std of them: a force that lies farther below is none of air
KEPT = 8  # data sets of which it is kept: a fit asks at every step


@lru_cache(maxsize=KEPT)
def pull_level_N(data: Observations) -> float:
    """The force, N, below which a reading pulls; NaN where too little air was read on the way in."""
    air = data.normal_N[~drawn_off(data) & (data.depth_mm < 0)]
    if air.size < MIN_AIR:
        return float("nan")
    return float(np.median(air) - PULL_SIGMA * max(mad_std(air), TYPICAL_FORCE_N))
