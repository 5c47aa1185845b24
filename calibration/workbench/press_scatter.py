"""Why a press stays off the last model: low or high as a whole, a shifted zero, or neither."""

from __future__ import annotations

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.inputs.observations import press_names
from tactilevision.records.constants import KILO, TINY
from tactilevision.records.measured import Floats

OFF = 1.3  # rms of a press over that of all, beyond which it is explained
MOST = 0.7  # share of a press's mean square that a gain or a zero has to explain
USUAL = 2.0  # std of gains or zeros that count as their scatter
COURSE = "neither a gain nor a zero: look at the course of its residual"


def why_off(fitted: Fit) -> dict[str, str]:
    """Return a phrase for each press that is off by more than most, by its name."""
    data, noise, names, found = fitted.data, fitted.noise, press_names(fitted.data), {}
    for number, rows in enumerate(data.spans):
        left = fitted.residual_N[rows]
        if np.mean(left**2) <= (OFF * fitted.rms_error_N) ** 2:
            continue
        gain, by_gain = _along(fitted.force_N[rows], left)
        zero, by_zero = _along(fitted.about.slope_N_per_mm[rows], left)
        if max(by_gain, by_zero) < MOST:
            found[names[number]] = COURSE
        elif by_gain >= by_zero:
            size, usual = f"{100 * abs(gain):.1f} %", noise.gain
            beside = _beside(abs(gain), usual, "gains", f"{100 * usual:.1f} %")
            found[names[number]] = f"{size} {'low' if gain < 0 else 'high'} as a whole: {beside}"
        else:
            beside = _beside(abs(zero), noise.zero_mm, "zeros", f"{KILO * noise.zero_mm:.0f} µm")
            found[names[number]] = f"its zero is off by {KILO * abs(zero):.0f} µm: {beside}"
    return found


def _along(direction: Floats, left: Floats) -> tuple[float, float]:
    """Return the size of a direction (n,) in the residual (n,), and the share of its squares that it explains."""
    size = float(direction @ left / max(float(direction @ direction), TINY))
    return size, 1 - float(np.sum((left - size * direction) ** 2)) / max(float(left @ left), TINY)


def _beside(size: float, usual: float, what: str, words: str) -> str:
    return f"{'within' if size <= USUAL * usual else 'beyond'} the scatter of {what} ({words})"
