"""Residual that no effect explains: its size and its effect on E."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from calibration.diagnosis.covariates import OTHER_BINS, covariate_steps, indicators, press_terms
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.score_test import SCATTER, Scored, ScoreTest
from calibration.diagnosis.sensitivity import Absorbed
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.identifiability import identify
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import STANDS_OUT, WANDERS
from calibration.fit.repeats import LEVEL
from calibration.inputs.conditions import covariates
from calibration.inputs.denoised_depth import LOAD, branches, nominal_depth
from calibration.laws.flat_punch import FlatPunch
from calibration.noise.model import Scatter
from tactilevision.records.constants import KILO, TINY, Z95
from tactilevision.records.measured import Floats

# Whether a significant residual matters: its effect on E, and on a force or a depth that is read.
#
# The residual is a random function of the covariate that it depends on,
#
#     y = f + J a + D b + noise,    b ~ N(0, s^2),
#
# D its steps, s the likeliest on a grid. E may be off by the shift that it
# brings and by the std that it adds; forces by D b less the part that J absorbs. It matters where E is off by more
# than MATTERS std of its own, or, at one sample in ten, a force by more than MATTERS std of one press's reading
# (its gain, its zero and its sample). It is described, never corrected.
# Source: Kennedy, O'Hagan, J. R. Stat. Soc. B 63 (2001) 425 (a discrepancy as a random function).

MATTERS = 0.65  # std: a 95 % interval off by so much covers 90 %
WORST = 0.9  # quantile over the samples of a force's error
SIZES = np.geomspace(0.03, 30, 40)  # of s, over what one std of each step would show
MODULUS = "youngs_modulus_MPa"


@dataclass(frozen=True, slots=True)
class Remainder:
    """A significant residual over a covariate: its rms in N and in mm of depth, and over a reading's std.

    `E_off` is the relative error of E that it may bring, `over_std_of_E` this over E's std.
    """

    covariate: str
    rms_N: float
    rms_mm: float
    over_std_of_a_reading: float
    E_off: float
    over_std_of_E: float

    @property
    def matters(self) -> bool:
        """Whether E, force or depth may be off by more than their intervals."""
        return max(self.over_std_of_a_reading, self.over_std_of_E) > MATTERS

    @property
    def sentence(self) -> str:
        """A warning in words."""
        size, off = KILO * self.rms_mm, 100 * abs(self.E_off)
        return f"the residual amounts to {size:.2g} µm of depth (over {self.covariate}); E moves by {off:.1g} %"

    def as_json(self) -> dict[str, Any]:
        """Its entry `left_over` in diagnosis.json."""
        return asdict(self) | {"matters": self.matters}


def remainder(fitted: Fit, left: ScoreTest, *, level: float) -> Remainder | None:
    """Return the largest residual, over E's or a reading's std, that is significant at this level; else None."""
    found = remainders(fitted, left, level=level)
    return max(found, key=lambda one: max(one.over_std_of_a_reading, one.over_std_of_E), default=None)


def remainders(fitted: Fit, left: ScoreTest, *, level: float) -> list[Remainder]:
    """Return the residual over each covariate that is significant at this level."""
    keys = [s.key for s in (*left.covariates, *left.others) if s.p_adjusted <= level and s.key != STANDS_OUT]
    return _all(at_denoised_depth(fitted), keys, _std_of_E(fitted)) if keys else []


def _all(fitted: Fit, keys: Sequence[str], std_E: float) -> list[Remainder]:
    steps, found = press_terms(fitted) | covariate_steps(fitted), []
    for key in keys:
        if key == SCATTER:
            found.append(_scattered(fitted))
        else:
            table = steps[key] if key in steps else _zeros(fitted, key)
            found.append(_sized(fitted, key, *_random_function(fitted, table), std_E))
    return found


def _modulus(fitted: Fit) -> int | None:
    """Return the index of E; None in a model of lengths."""
    return next((k for k, p in enumerate(fitted.parameters) if p.name == MODULUS), None)


def _std_of_E(fitted: Fit) -> float:
    """Return the relative std by the stated 95 % interval; inf where there is no E."""
    if _modulus(fitted) is None:
        return float("inf")
    flat = isinstance(fitted.model.law, FlatPunch)
    E = identify(fitted).youngs_modulus if flat else fitted.estimate(MODULUS)
    if E.value is None or E.interval95 is None:
        return float("inf")
    return (E.interval95[1] - E.interval95[0]) / (2 * Z95) / E.value


def _sized(fitted: Fit, key: str, left_N: Floats, E_off: float, std_E: float) -> Remainder:
    about = fitted.about
    slope = np.maximum(np.abs(about.slope_N_per_mm), 1e-3 * np.max(np.abs(about.slope_N_per_mm)))
    touching = fitted.data.depth_mm > 0
    over = float(np.quantile(np.abs(left_N / fitted.noise.std_N(about)), WORST))
    rms, mm = (float(np.sqrt(np.mean(one[touching] ** 2))) for one in (left_N, left_N / slope))
    return Remainder(key, rms, mm, over, E_off, abs(E_off) / std_E)


def _zeros(fitted: Fit, key: str) -> Floats:
    """Return steps (N, k) of presses' zeros over the covariate that they depend on."""
    name = key.removeprefix(WANDERS).removesuffix(" of the force")
    along = next(c for c in covariates(fitted.data) if c.name == name)
    steps = indicators(along, OTHER_BINS)
    return steps if key.endswith(" of the force") else steps * fitted.about.slope_N_per_mm[:, None]


def _random_function(fitted: Fit, steps: Floats) -> tuple[Floats, float]:
    """Return the random function (N,), N, less the part that the fit absorbs, and the relative error of E."""
    free = fitted.free & ~fitted.at_bound
    absorbed, count = Absorbed(fitted, free), fitted.data.size
    white = absorbed.white
    share = absorbed.inverse @ absorbed.rows[:count].T @ white(steps)
    beside = white(steps) - absorbed.rows[:count] @ share
    scale = 1 / np.maximum(np.linalg.norm(beside, axis=0), TINY)
    left, length, right = np.linalg.svd(beside * scale, full_matrices=False)
    seen = left.T @ white(fitted.residual_N)
    grown = 1 + np.outer(SIZES, length) ** 2
    size = SIZES[int(np.argmin(np.sum(np.log(grown) + seen**2 / grown, axis=1)))]
    shrunk = (size * length) ** 2 / (1 + (size * length) ** 2)
    b = scale * (right.T @ (shrunk * seen / np.maximum(length, TINY)))
    spread = scale[:, None] * (right.T * (size**2 * (1 - shrunk))) @ right * scale
    left_N = (steps - fitted.jacobian[:, free] @ share) @ b
    at = _modulus(fitted)
    if at is None or not free[at]:
        return left_N, 0.0
    row = share[absorbed.row_of(at)]
    off = np.sqrt(float(row @ b) ** 2 + max(float(row @ spread @ row), 0.0))
    return left_N, float(off) / float(fitted.values[at])


def _scattered(fitted: Fit) -> Remainder:
    """Return the excess scatter of loading, which moves no mean."""
    scatter = Scatter(fitted.data)
    white = fitted.whitener.apply(fitted.residual_N)
    beyond = np.sqrt(max(float(np.mean(scatter.differences(white))), 0.0))
    loading = branches(fitted.data) == LOAD
    left = np.where(loading, beyond * fitted.noise.scale * fitted.about.base_N, 0.0)
    return _sized(fitted, SCATTER, left, 0.0, float("inf"))


# Description of an unexplained residual: its size, the depth over which it varies, the covariates it depends on.
#
# The mean residual in bins of depth is a Gaussian process, covariance s^2 exp(-(w - w')^2/(2 l^2)), plus the bins'
# own errors times k, since presses scatter by more than their samples; s, l and k are the likeliest on a grid. An
# l at the grid's finest is not resolved: NaN. Source: Rasmussen, Williams, Gaussian Processes for Machine Learning
# (2006), eq. 2.30.

BINS = 40  # bins of depth
MIN_COUNT = 6  # filled bins; fewer give no length
WIDER = (1, 2, 4, 8)  # values of k tried


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Rms size in N of the residual's part that depends on depth, and the depth in mm over which it varies.

    `length_mm` is NaN where nothing varies; `covariates` are those it depends on, the most significant first.
    """

    rms_N: float
    length_mm: float
    covariates: tuple[str, ...]


def describe(fitted: Fit, scored: tuple[Scored, ...]) -> Unexplained:
    """Return the description of a fit's residual."""
    size, length = _process(*_binned(fitted))
    return Unexplained(size, length, tuple(s.key for s in scored if s.p_adjusted < LEVEL))


def nearest(searched: Searched) -> tuple[str, float] | None:
    """Return the effects that explain most of an unexplained misfit, and their share of it."""
    if searched.steps:
        return "+".join(step.best.effect.key for step in searched.steps), searched.explained
    start, candidates = searched.start, searched.rounds[-1].candidates
    beyond = start.chi2 - start.dof
    if not candidates or beyond <= 0:
        return None
    share = (start.chi2 - candidates[0].chi2) / beyond
    return candidates[0].effect.key, float(np.clip(share, 0.0, 1.0))


def _binned(fitted: Fit) -> tuple[Floats, Floats, Floats]:
    """Return depth, mean residual and its error in bins of depth with three samples or more."""
    depth, residual = nominal_depth(fitted.data), fitted.residual_N
    edges = np.linspace(max(float(depth.min()), 0.0), float(depth.max()), BINS + 1)
    number = np.clip(np.digitize(depth, edges) - 1, 0, BINS - 1)
    rows = [np.flatnonzero(number == k) for k in range(BINS)]
    rows = [row for row in rows if row.size >= 3 and depth[row].max() > 0]
    mean = np.array([residual[row].mean() for row in rows])
    error = np.array([residual[row].std(ddof=1) / np.sqrt(row.size) for row in rows])
    return np.array([depth[row].mean() for row in rows]), mean, np.maximum(error, TINY)


def _process(depth_mm: Floats, mean_N: Floats, error_N: Floats) -> tuple[float, float]:
    if depth_mm.size < MIN_COUNT:
        return 0.0, float("nan")
    span = float(np.ptp(depth_mm))
    apart = np.subtract.outer(depth_mm, depth_mm)
    own = np.diag(error_N**2)
    best = (min(_minus_2_log_likelihood(k**2 * own, mean_N) for k in WIDER), 0.0, float("nan"))
    lengths = np.geomspace(span / 40, span, 20)
    for length, size, k in product(lengths, float(np.std(mean_N)) * np.geomspace(0.1, 3, 12), WIDER):
        covariance = size**2 * np.exp(-((apart / length) ** 2) / 2) + k**2 * own
        best = min(best, (_minus_2_log_likelihood(covariance, mean_N), float(size), float(length)))
    return best[1], best[2] if best[2] > lengths[0] else float("nan")


def _minus_2_log_likelihood(covariance: Floats, values: Floats) -> float:
    """Return -2 log likelihood."""
    volume = float(np.linalg.slogdet(covariance)[1])
    return float(values @ np.linalg.solve(covariance, values)) + volume
