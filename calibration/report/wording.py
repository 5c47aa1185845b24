"""Words for numbers and covariates: as many digits as the uncertainty allows, the unit, and the interval."""

from __future__ import annotations

import math

from calibration.diagnosis.covariates import IN_WORDS
from calibration.inputs.conditions import Repeatability
from tactilevision.records.constants import KILO, NONZERO
from tactilevision.records.display import estimate as estimate, number as number

MATERIAL = {
    "youngs_modulus": "Young's modulus E",
    "poisson_ratio": "Poisson's ratio ν",
    "c": "stiffness c",
    "beta": "slope β",
}


def in_words(key: str) -> str:
    """Return the name of an effect, or of what it is confused with, in words."""
    return {"youngs_modulus": "Young's modulus", "beta": "the slope β"}.get(key) or key.replace("_", " ")


def covariate(name: str) -> str:
    """Return a covariate in words."""
    return IN_WORDS.get(name, name)


def fit_error(held_out_N: float, rms_N: float) -> str:
    """Return the rms error on held-out presses; where there were too few of them, on those fitted."""
    if math.isfinite(held_out_N):
        return f"error on held-out presses {KILO * held_out_N:.1f} mN"
    return f"error on fitted presses {KILO * rms_N:.1f} mN"


def repeatability(repeats: Repeatability | None, unit: str = "mN") -> str:
    """Return the scatter of true repeats in words."""
    if repeats is None:
        return "no press is repeated"
    low, high = (KILO * end for end in repeats.interval95)
    return f"repeated presses scatter by {KILO * repeats.std:.1f} {unit} ({low:.1f} to {high:.1f})"


def p_value(p: float) -> str:
    """Return a p-value to two digits; one that underflows is given as a bound."""
    return "< 1e-300" if p < NONZERO else f"{p:.2g}"
