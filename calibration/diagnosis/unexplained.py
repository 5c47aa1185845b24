"""Residual that no effect explains: its size, its effect on E, and instrument errors that fit it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from calibration.diagnosis.covariates import covariate_steps
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.refit import AS_GOOD, CANNOT_FIT, Candidate, refit_with
from calibration.diagnosis.score_test import LEVEL, SCATTER, Scored, ScoreTest
from calibration.diagnosis.sensitivity import Absorbed
from calibration.effects.instrument_errors import INSTRUMENT_ERRORS, InstrumentError
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.identifiability import identify
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import STANDS_OUT, WANDERS
from calibration.inputs.conditions import bins, covariates
from calibration.inputs.deadline import Each, in_turn
from calibration.inputs.denoised_depth import LOAD, branches, nominal_depth
from calibration.laws.flat_punch import FlatPunch
from calibration.model.stages import Effect, Parameter
from calibration.noise.model import Scatter, Whitener
from tactilevision.records.measured import Floats, Pair

# What is left over, and whether it matters: what it may do to E, and to a force or a depth that is read.
#
# What stands out of the residual is taken for a random function of what it follows,
#
#     y = f + J a + D b + noise,    b ~ N(0, s^2),
#
# D its steps, s the likeliest on a grid; a plain error is fitted instead. E may be off by the shift that it brings
# and by the std that it adds; forces by D b beside what J takes of it. It matters where a 95 % interval then holds
# in less than 90 %: where E is off by more than MATTERS std of its own, or, at one sample in ten, a force by more
# than MATTERS std of one press's reading (its gain, its zero and its sample). It is described, never repaired.
# Source: Kennedy, O'Hagan, J. R. Stat. Soc. B 63 (2001) 425 (a discrepancy as a random function).

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


# What a search has named, held against one plain error of an instrument that no effect of the catalogue has.
#
# Several effects can follow together what one function of one covariate does alone (a force sensor that creeps
# looks like a relaxation beside an adhesion), and then leave nothing. A plain error needs a reason: it stands out
# in the test of the fit that the search began with, its range searched in the null as in the data, and its fit
# lies inside its range. It is then fitted under the noise that the search ended with, and costs chi^2 + 2 q and
# what its range was searched for, 2 ln of the ways to begin. What was named is not identified where a plain error
# costs no more than an equally good fit may (AS_GOOD), and less by as much than each of the named effects does
# alone.

EDGE = 0.02  # of a range: a fit this near its end has found no size


@dataclass(frozen=True, slots=True)
class AlternativeExplanation:
    """A plain error that does as well as effects together: its words and covariate, what it is fitted to be, the
    keys that it stands in place of, and how much less it costs than they do, in chi^2 + 2 q.
    """

    key: str
    words: str
    covariate: str
    sizes: tuple[tuple[Parameter, float], ...]
    instead_of: tuple[str, ...]
    cheaper: float
    modulus_MPa: float

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "key": self.key,
            "what": self.words,
            "covariate": self.covariate,
            "parameters": {p.name: {"value": value, "unit": p.unit} for p, value in self.sizes},
            "instead_of": list(self.instead_of),
            "cheaper_by": self.cheaper,
        }


def plain_errors(searched: Searched, each: Each = in_turn) -> tuple[Candidate, ...]:
    """Each plain error on what a search began with, under the noise that it ended with, the nearest first."""
    begin = _begin(searched)
    return tuple(sorted(_fitted(begin, INSTRUMENT_ERRORS, each), key=lambda one: _penalised_chi2(one, begin)))


def alternative_explanation(
    searched: Searched, plain: Sequence[Candidate] | None = None, *, level: float = LEVEL
) -> AlternativeExplanation | None:
    """The plain error that does as well as all that was added and better than each part of it; else None.

    `plain`: the plain errors where they have been fitted already.
    """
    named, start, begin = [step.best.effect for step in searched.steps], searched.start, _begin(searched)
    paid = searched.current.chi2 + 2 * (searched.current.values.size - start.values.size)
    standing = {s.key for s in searched.first.others if s.p_adjusted <= level}
    looked = plain_errors(searched) if plain is None else plain
    best = next((one for one in looked if one.effect.key in standing and _inside(one, begin)), None)
    if best is None or _penalised_chi2(best, begin) >= paid + (AS_GOOD if named else -AS_GOOD):
        return None
    if _penalised_chi2(best, begin) >= min((one.cost for one in _fitted(begin, named)), default=np.inf) - AS_GOOD:
        return None
    assert isinstance(best.effect, InstrumentError)
    sizes = tuple(zip(best.effect.parameters, best.own_values.tolist(), strict=True))
    return AlternativeExplanation(
        best.effect.key,
        best.effect.words,
        best.effect.covariate,
        sizes,
        tuple(effect.key for effect in named),
        paid - _penalised_chi2(best, begin),
        float(best.values[0]),
    )


def _penalised_chi2(one: Candidate, begin: Fit) -> float:
    """chi^2 + 2 q, and what its range was searched for."""
    return one.cost + 2 * float(np.log(len(one.effect.starts(begin.data))))


def _inside(one: Candidate, begin: Fit) -> bool:
    """No parameter stands at an end of its range; an angle has none."""
    assert isinstance(one.effect, InstrumentError)
    return all(
        p.unit == "rad" or _clear(value, p.bounds)
        for value, p in zip(one.own_values, one.effect.parameters_on(begin.data), strict=True)
    )


def _clear(value: float, bounds: Pair) -> bool:
    """Of either end, relative to it where the range is of one sign: periods and times are."""
    low, high = bounds
    near_low, near_high = (EDGE * abs(end) if low > 0 else EDGE * (high - low) / 10 for end in bounds)
    return low + near_low < value < high - near_high


def _begin(searched: Searched) -> Fit:
    return replace(searched.start, noise=searched.current.noise)


def suggested(fitted: Fit) -> tuple[Candidate, ...]:
    """Plain errors that take more off a fit than they cost, the best first: what to try, not what is there."""
    others = [one for one in INSTRUMENT_ERRORS if one.key not in fitted.model.keys]
    better = [one for one in _fitted(fitted, others) if one.cost < fitted.chi2 - AS_GOOD]
    return tuple(sorted(better, key=lambda one: one.cost))


def _fitted(begin: Fit, effects: Sequence[Effect], each: Each = in_turn) -> Iterator[Candidate]:
    for refit in each(partial(refit_with, begin), [one for one in effects if not one.missing(begin.data)]):
        with suppress(*CANNOT_FIT):
            yield refit()


# What no effect explains, described: how large it is, over what depth it varies, on what it depends.
#
# The mean residual in bins of depth is taken for a Gaussian process, covariance s^2 exp(-(w - w')^2/(2 l^2))
# beside the bins' own errors times k, since presses scatter by more than their samples say; s, l and k are the
# likeliest on a grid. It describes and never repairs E. An l at the grid's finest is not resolved: NaN. Source:
# Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), eq. 2.30.

BINS = 40  # of depth, that the mean residual is taken in
MIN_COUNT = 6  # filled bins; with fewer no length can be stated
WIDER = (1.0, 2.0, 4.0, 8.0)  # times k that are tried on the bins' own errors


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Size of the residual's part that depends on depth (N, rms), the depth over which it varies (mm; NaN where
    nothing does), the covariates it depends on, the most telling first.
    """

    size_N: float
    length_mm: float
    covariates: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Its entry `left` in diagnosis.json."""
        return {"rms_N": self.size_N, "length_mm": self.length_mm, "covariates": list(self.covariates)}


def unexplained(searched: Searched, plain: AlternativeExplanation | None) -> Unexplained:
    """What a search leaves; where `plain` stands for its steps, what its start leaves."""
    if plain is None:
        return describe(searched.current, searched.last.covariates)
    found = describe(searched.start, searched.first.covariates)
    return replace(found, covariates=tuple(dict.fromkeys((plain.covariate, *found.covariates))))


def describe(fitted: Fit, scored: tuple[Scored, ...], *, level: float = 0.05) -> Unexplained:
    """What is left of a fit."""
    size, length = _process(*_binned(fitted))
    return Unexplained(size, length, tuple(s.key for s in scored if s.p_adjusted < level))


def nearest(searched: Searched) -> tuple[str, float] | None:
    """The effects that came nearest to a misfit that none explains, and their share of it."""
    if searched.steps:
        return "+".join(step.best.effect.key for step in searched.steps), searched.explained
    start, candidates = searched.start, searched.rounds[-1].candidates
    beyond = start.chi2 - start.dof
    if not candidates or beyond <= 0:
        return None
    share = (start.chi2 - candidates[0].chi2) / beyond
    return candidates[0].effect.key, float(np.clip(share, 0.0, 1.0))


def _binned(fitted: Fit) -> tuple[Floats, Floats, Floats]:
    """Depth, mean residual and its error in bins of depth that hold three samples or more."""
    depth, residual = nominal_depth(fitted.data), fitted.residual_N
    edges = np.linspace(max(float(depth.min()), 0.0), float(depth.max()), BINS + 1)
    number = np.clip(np.digitize(depth, edges) - 1, 0, BINS - 1)
    rows = [np.flatnonzero(number == k) for k in range(BINS)]
    rows = [row for row in rows if row.size >= 3 and depth[row].max() > 0]
    mean = np.array([residual[row].mean() for row in rows])
    error = np.array([residual[row].std(ddof=1) / np.sqrt(row.size) for row in rows])
    return np.array([depth[row].mean() for row in rows]), mean, np.maximum(error, 1e-9)


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
    """-2 log likelihood."""
    volume = float(np.linalg.slogdet(covariance)[1])
    return float(values @ np.linalg.solve(covariance, values)) + volume
