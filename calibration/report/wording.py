"""Words for numbers and covariates: as many digits as the uncertainty allows, the unit, and the interval."""

from __future__ import annotations

import math

from calibration.diagnosis.covariates import IN_WORDS
from calibration.inputs.conditions import Repeatability
from tactilevision.records.constants import KILO, NONZERO
from tactilevision.records.measured import Estimate

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


def number(value: float | None, std: float | None = None) -> str:
    """Return a number to two digits of its std, in full where that is 0, or to four significant digits."""
    if value is None or not math.isfinite(value):
        return "–"
    if std == 0:
        return f"{value:.10g}"
    if std is None or not math.isfinite(std) or std < 0:
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{min(digits, 8)}f}"


def estimate(found: Estimate) -> str:
    """Return a value with its unit and its 95 % interval, or why there is none."""
    unit, span = "" if found.unit in ("", "1") else f" {found.unit}", ""
    if found.interval95 is not None:
        low, high = found.interval95
        fine = found.std or abs(high - low) / 4
        span = f"{number(low, fine)} to {number(high, fine)}{unit}"
    if found.value is None:
        why = found.why or "no reason recorded"
        return f"not determined by these data ({why})" + (f"; 95 %: {span}" if span else "")
    return f"{number(found.value, found.std)}{unit}" + (f" (95 %: {span})" if span else "")


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
