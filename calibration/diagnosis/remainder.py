"""What is left over, and whether it matters: what it may do to E, and to a force or a depth that is read.

What stands out of the residual is taken for a random function of what it follows,

    y = f + J a + D b + noise,    b ~ N(0, s^2),

D its steps, s the likeliest on a grid; a plain error is fitted instead. E may be off by the shift that it brings
and by the std that it adds; forces by D b beside what J takes of it. It matters where a 95 % interval then holds
in less than 90 %: where E is off by more than MATTERS std of its own, or, at one sample in ten, a force by more
than MATTERS std of one press's reading (its gain, its zero and its sample). It is described, never repaired.
Source: Kennedy, O'Hagan, J. R. Stat. Soc. B 63 (2001) 425 (a discrepancy as a random function).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.diagnosis.covariate_steps import covariate_steps
from calibration.diagnosis.refit import CANNOT_FIT, refit_with
from calibration.diagnosis.score_test import SCATTER, ScoreTest
from calibration.effects.instrument_errors import INSTRUMENT_ERRORS
from calibration.fit.absorbed import Absorbed
from calibration.fit.identifiability import identify
from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import bins, covariates
from calibration.inputs.denoised_depth import LOAD, branches
from calibration.laws.flat_punch import FlatPunch
from calibration.noise.heteroscedasticity import Scatter
from calibration.noise.model import Whitener
from calibration.repeats.at_denoised_depth import at_denoised_depth
from calibration.repeats.outlying_presses import STANDS_OUT, WANDERS
from tactilevision.records import Floats

MATTERS = 0.65  # std: a 95 % interval that is off by it, or wider noise by its root, holds in 90 %
WORST = 0.9  # quantile over the samples that a force's error is taken at
SIZES = np.geomspace(0.03, 30.0, 40)  # of s, over what one std of each step would show
MODULUS = "youngs_modulus_MPa"
WANDER_BINS = 6  # steps of what presses' zeros wander with


@dataclass(frozen=True, slots=True)
class Remainder:
    """What follows `key` and is left: its rms in N and mm of depth, its size over a reading's std, and by how much
    E may be off, relative, and over E's std.
    """

    key: str
    rms_N: float
    rms_mm: float
    over_reading: float
    E_off: float
    over_E: float

    @property
    def matters(self) -> bool:
        """Whether E, force or depth may be off by more than their intervals say."""
        return max(self.over_reading, self.over_E) > MATTERS

    @property
    def sentence(self) -> str:
        """In words."""
        size, off = 1e3 * self.rms_mm, 100 * abs(self.E_off)
        plain = next((error.words for error in INSTRUMENT_ERRORS if error.key == self.key), "")
        on = f"as of {plain}" if plain else f"over {self.key}"
        return f"what is left is worth {size:.2g} µm of depth ({on}); E moves by {off:.1g} %"

    def as_json(self) -> dict[str, Any]:
        """Its entry `left_over` in diagnosis.json."""
        return {
            "covariate": self.key,
            "rms_N": self.rms_N,
            "rms_mm": self.rms_mm,
            "over_std_of_a_reading": self.over_reading,
            "E_off": self.E_off,
            "over_std_of_E": self.over_E,
            "matters": self.matters,
        }


def remainder(fitted: Fit, left: ScoreTest, *, level: float) -> Remainder | None:
    """The largest of what stands out of a fit at this level, over what a reading and E are known to; else None."""
    keys = [s.key for s in (*left.covariates, *left.others) if s.p_adjusted <= level and s.key != STANDS_OUT]
    found = _all(at_denoised_depth(fitted), keys, _std_of_E(fitted)) if keys else []
    return max(found, key=lambda one: max(one.over_reading, one.over_E), default=None)


def _all(fitted: Fit, keys: Sequence[str], std_E: float) -> list[Remainder]:
    steps, plain = covariate_steps(fitted), {error.key: error for error in INSTRUMENT_ERRORS}
    found = []
    for key in keys:
        if key == SCATTER:
            found.append(_scattered(fitted))
        elif key in plain:
            try:
                one = refit_with(fitted, plain[key])
            except CANNOT_FIT:
                continue
            found.append(_sized(fitted, key, one.force_N - fitted.force_N, _off(fitted, one.values), std_E))
        else:
            table = steps[key] if key in steps else _zeros(fitted, key)
            found.append(_sized(fitted, key, *_random_function(fitted, table), std_E))
    return found


def _modulus(fitted: Fit) -> int | None:
    """Where E stands; None in a model of lengths."""
    return next((k for k, p in enumerate(fitted.parameters) if p.name == MODULUS), None)


def _std_of_E(fitted: Fit) -> float:
    """Relative, a quarter of the 95 % interval as it is stated; inf where there is no E."""
    if _modulus(fitted) is None:
        return float("inf")
    flat = isinstance(fitted.model.law, FlatPunch)
    E = identify(fitted).youngs_modulus if flat else fitted.estimate(MODULUS)
    if E.value is None or E.interval95 is None:
        return float("inf")
    return (E.interval95[1] - E.interval95[0]) / 3.92 / E.value


def _off(fitted: Fit, values: Floats) -> float:
    """E of other values over that of the fit, less 1; an effect's parameters stand behind the law's."""
    at = _modulus(fitted)
    return 0.0 if at is None else float(values[at] / fitted.values[at] - 1)


def _sized(fitted: Fit, key: str, left_N: Floats, E_off: float, std_E: float) -> Remainder:
    about = fitted.about
    slope = np.maximum(np.abs(about.slope_N_per_mm), 1e-3 * np.max(np.abs(about.slope_N_per_mm)))
    touching = fitted.data.depth_mm > 0
    over = float(np.quantile(np.abs(left_N / _reading_std(fitted)), WORST))
    rms, mm = (float(np.sqrt(np.mean(one[touching] ** 2))) for one in (left_N, left_N / slope))
    return Remainder(key, rms, mm, over, E_off, abs(E_off) / std_E)


def _reading_std(fitted: Fit) -> Floats:
    """Std (N,) of one sample of one press, N."""
    noise, about = fitted.noise, fitted.about
    parts = (noise.gain * about.force_N, noise.zero_mm * about.slope_N_per_mm, noise.scale * about.base_N)
    return np.asarray(np.sqrt(sum(part**2 for part in parts)))


def _zeros(fitted: Fit, key: str) -> Floats:
    """Steps (N, k) of presses' zeros over what they wander with."""
    name = key.removeprefix(WANDERS).removesuffix(" of the force")
    along = next(c for c in covariates(fitted.data) if c.name == name)
    number = bins(along, WANDER_BINS)
    carried = np.ones(number.size) if key.endswith(" of the force") else fitted.about.slope_N_per_mm
    return np.asarray(np.eye(int(number.max()) + 1)[number] * carried[:, None])


def _random_function(fitted: Fit, steps: Floats) -> tuple[Floats, float]:
    """What it leaves (N,), N, beside what the fit takes of it; and by how much E may be off, relative."""
    free = fitted.free & ~fitted.at_bound
    absorbed, count = Absorbed(fitted, free), fitted.data.size
    white = absorbed.white
    share = absorbed.inverse @ absorbed.rows[:count].T @ white(steps)
    beside = white(steps) - absorbed.rows[:count] @ share
    scale = 1 / np.maximum(np.linalg.norm(beside, axis=0), 1e-12)
    left, length, right = np.linalg.svd(beside * scale, full_matrices=False)
    seen = left.T @ white(fitted.residual_N)
    grown = 1 + np.outer(SIZES, length) ** 2
    size = SIZES[int(np.argmin(np.sum(np.log(grown) + seen**2 / grown, axis=1)))]
    shrunk = (size * length) ** 2 / (1 + (size * length) ** 2)
    b = scale * (right.T @ (shrunk * seen / np.maximum(length, 1e-12)))
    spread = scale[:, None] * (right.T * (size**2 * (1 - shrunk))) @ right * scale
    left_N = (steps - fitted.jacobian[:, free] @ share) @ b
    at = _modulus(fitted)
    if at is None or not free[at]:
        return left_N, 0.0
    row = share[absorbed.row_of(at)]
    off = np.sqrt(float(row @ b) ** 2 + max(float(row @ spread @ row), 0.0))
    return left_N, float(off) / float(fitted.values[at])


def _scattered(fitted: Fit) -> Remainder:
    """Loading's own scatter beyond the rest's: it moves no mean."""
    scatter = Scatter(fitted.data)
    white = Whitener(fitted.data, fitted.noise, fitted.about).apply(fitted.residual_N)
    beyond = np.sqrt(max(float(np.mean(scatter.differences(white))), 0.0))
    loading = branches(fitted.data) == LOAD
    left = np.where(loading, beyond * fitted.noise.scale * fitted.about.base_N, 0.0)
    return _sized(fitted, SCATTER, left, 0.0, float("inf"))
