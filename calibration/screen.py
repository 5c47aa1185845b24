"""Which directions stand out of the residual, with error rates that hold for presses that are no repeats.

A direction is the change of the force that an effect would bring (from each of its starts), or a step function
of a covariate. Whitened and freed of what the fit can absorb, its score is t = d.z/|d|. For an effect the
largest t^2 over its starts counts, for a covariate the sum over its bins. Both are calibrated by a parametric
bootstrap in which the error model is estimated anew each time; the smallest p over all effects (or covariates)
is calibrated by the same bootstrap, which gives p_adjusted a family-wise meaning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.conditions import Covariate, bins, covariates, nominal_depth
from calibration.fitting import Fit
from calibration.noise import Noise, Whitener
from calibration.pure_noise import renewed_noise
from calibration.scatter import Scatter
from calibration.stages import Effect
from tactilevision.errors import InputError
from tactilevision.records import Floats

DRAWS = 199
SCATTER = "scatter while loading"
SEEN = 1e-3  # a direction of which less than this share is left beside the fit is the fit's own
DEPTH_BINS, OTHER_BINS = 16, 6


@dataclass(frozen=True, slots=True)
class Scored:
    """One effect or covariate: its statistic, its own p, and p adjusted for having looked at all.

    `usual` is the statistic's mean where nothing is there.
    """

    key: str
    statistic: float
    p: float
    p_adjusted: float
    usual: float = 0.0

    def as_json(self) -> dict[str, str | float]:
        """One entry of covariates."""
        return {"name": self.key, "p_adjusted": self.p_adjusted}


@dataclass(frozen=True, slots=True)
class Screen:
    """The scores of effects and of covariates, the most telling first, and why others were not looked at.

    `visible` is, for each effect, the amplitude of its first parameter that would be seen in 4 of 5 such data
    (3.6 std); inf where the base model absorbs it.
    """

    effects: tuple[Scored, ...]
    covariates: tuple[Scored, ...]
    not_testable: Mapping[str, str]
    visible: Mapping[str, float]

    @property
    def lack_of_fit(self) -> float:
        """Adjusted p of the most telling covariate; 1 where there is none."""
        return min((c.p_adjusted for c in self.covariates), default=1.0)


def screen(fitted: Fit, effects: Sequence[Effect], rng: np.random.Generator, *, draws: int = DRAWS) -> Screen:
    """Score `effects` and every covariate against the residual of `fitted`, whose noise is taken as its own."""
    tables, missing = effect_directions(fitted, effects)
    seen = seen_covariates(fitted)
    steps = {c.name: _steps(fitted, c) for c in seen}
    cast = _Cast(fitted, [*tables.values(), *steps.values()])
    real, white = cast.scores(fitted.noise, fitted.residual_N[:, None], cast.own_priors[:, None], [0])[0]
    drawn = cast.null(rng, draws)
    null = [scores for scores, _ in drawn]
    for key, table in zip(tables, cast.left[: len(tables)], strict=True):
        if not table.any():
            missing[key] = "the base model takes all of it: these data cannot tell it from E, nu or beta"
    count = len(tables)
    largest = [float(np.max(s**2, initial=0.0)) for s in real[:count]]
    sums = [float(np.sum(s**2)) for s in real[count:]]
    null_largest = np.array([[np.max(s**2, initial=0.0) for s in row[:count]] for row in null]).reshape(
        draws, count
    )
    null_sums = np.array([[np.sum(s**2) for s in row[count:]] for row in null]).reshape(draws, len(sums))
    looks, scatter = list(steps), Scatter(fitted.data)
    if scatter.seen:
        usual = float(np.mean([scatter.differences(one).mean() for _, one in drawn]))
        looks.append(SCATTER)
        sums.append(scatter.statistic(white, usual))
        spread = np.array([scatter.statistic(one, usual) for _, one in drawn])
        null_sums = np.column_stack([null_sums, spread])
    return Screen(
        effects=_ranked(list(tables), largest, null_largest, skip=missing),
        covariates=_ranked(looks, sums, null_sums, skip={}),
        not_testable=missing, visible=_visible(fitted, effects, tables, cast),
    )  # fmt: skip


def seen_covariates(fitted: Fit) -> tuple[Covariate, ...]:
    """The covariates, depth without its readings' noise and force as fitted to that: bins of what was read would
    sort residuals by their own noise.
    """
    steady = fitted.data.shifted(nominal_depth(fitted.data) - fitted.data.depth_mm)
    return covariates(steady.with_force(fitted.model.predict(fitted.values, steady)))


def effect_directions(fitted: Fit, effects: Sequence[Effect]) -> tuple[dict[str, Floats], dict[str, str]]:
    """Change of the force (N, s) for each start of each effect that can be tested, and why others cannot."""
    tables: dict[str, Floats] = {}
    missing: dict[str, str] = {}
    data, base = fitted.data, fitted.force_N
    for effect in effects:
        if effect.key in fitted.model.keys:
            continue
        try:
            why = effect.missing(data)
            if not why:
                tables[effect.key] = _directions(fitted, effect, base)
        except Exception as fault:  # a private effect may raise anything; the rest of the analysis goes on
            why = f"it failed: {type(fault).__name__}: {fault}"
        if why:
            missing[effect.key] = why
    return tables, missing


def _directions(fitted: Fit, effect: Effect, base: Floats) -> Floats:
    model = fitted.model + effect
    place = model.slices(fitted.data)[effect.key]
    off = len(model.parameters(fitted.data)) - len(effect.parameters)
    values = np.insert(fitted.values, place.start, np.zeros(place.stop - place.start))
    assert values.size == off + len(effect.parameters)
    columns = []
    for start in effect.starts(fitted.data):
        values[place] = start
        force = np.asarray(model.predict(values, fitted.data))
        if force.shape != base.shape:
            raise InputError("an effect returns one force a sample", where=effect.key, value=force.shape)
        if not np.isfinite(force).all():
            raise InputError("an effect returns finite forces", where=effect.key, value=start.tolist())
        columns.append(force - base)
    return np.column_stack(columns)


def _steps(fitted: Fit, covariate: Covariate) -> Floats:
    """Step functions (N, k) of a covariate: of the stiffness for a press's, of the depth for a sample's."""
    number = bins(covariate, DEPTH_BINS if covariate.name == "w" else OTHER_BINS)
    carried = fitted.about.force_N if covariate.of_press else fitted.about.slope_N_per_mm
    hot = np.eye(int(number.max()) + 1)[number]
    return np.asarray(hot * (np.abs(carried) + fitted.about.base_N * fitted.noise.scale)[:, None])


class _Cast:
    """Directions against residuals under one model: whiten, take out what the fit absorbs, score."""

    def __init__(self, fitted: Fit, tables: Sequence[Floats]) -> None:
        self.fitted = fitted
        free = fitted.free & ~fitted.at_bound  # what stands at its bound cannot give way any further
        self._jacobian = fitted.jacobian[:, free]
        known = [0.0 if p.prior is None else 1 / p.prior.std for p in fitted.parameters]
        self._priors = np.diag(np.array(known)[free])[np.array(known)[free] > 0]
        self.own_priors = np.array([(p.prior.mean - v) / p.prior.std for p, v, gives in zip(
            fitted.parameters, fitted.values, free, strict=True) if p.prior is not None and gives])  # fmt: skip
        self._ends = np.cumsum([t.shape[1] for t in tables])
        self._tables = np.column_stack(tables) if tables else np.zeros((fitted.data.size, 0))
        self.left = self._split_seen()

    def scores(
        self, noise: Noise, residual_N: Floats, priors: Floats, which: Sequence[int]
    ) -> list[tuple[list[Floats], Floats]]:
        """Scores of each table's directions for the columns `which` of residuals (N, b), under one noise, and the
        white residual (N,) itself. `priors` (k, b): how far, in std, the parameters' truth lies off its priors.
        """
        directions, white = self._freed(noise, residual_N[:, which], priors[:, which])
        unit = directions / np.where(self._visible, np.linalg.norm(directions, axis=0), np.inf)
        all_scores = unit.T @ white
        size = self.fitted.data.size
        return [(np.split(all_scores[:, k], self._ends[:-1]), white[:size, k]) for k in range(len(which))]

    def null(self, rng: np.random.Generator, draws: int) -> list[tuple[list[Floats], Floats]]:
        """Scores and white residual under the model itself, the noise estimated anew for each draw."""
        fitted = self.fitted
        whitener = Whitener(fitted.data, fitted.noise, fitted.about)
        errors = whitener.colour(rng.standard_normal((fitted.data.size, draws)))
        priors = rng.standard_normal((len(self._priors), draws))
        noises = renewed_noise(fitted, errors)
        return [self.scores(noises[k], errors, priors, [k])[0] for k in range(draws)]

    def _freed(self, noise: Noise, residual_N: Floats, priors: Floats) -> tuple[Floats, Floats]:
        """Directions and residuals, whitened and orthogonal to the fit (priors included)."""
        fitted = self.fitted
        whitener = Whitener(fitted.data, noise, fitted.about)
        both = whitener.apply(np.column_stack([self._jacobian, self._tables, residual_N]))
        free, count = self._jacobian.shape[1], self._tables.shape[1]
        jacobian = np.vstack([both[:, :free], self._priors])
        rest = np.vstack([both[:, free:], np.column_stack([np.zeros((len(self._priors), count)), priors])])
        scale = np.linalg.norm(jacobian, axis=0)
        q, _ = np.linalg.qr(jacobian / np.where(scale > 0, scale, 1.0))
        self._before = np.linalg.norm(rest[:, :count], axis=0)
        rest = rest - q @ (q.T @ rest)
        return rest[:, :count], rest[:, count:]

    def _split_seen(self) -> list[np.ndarray[tuple[int], np.dtype[np.bool_]]]:
        nothing = np.zeros((self.fitted.data.size, 0))
        directions, _ = self._freed(self.fitted.noise, nothing, np.zeros((len(self._priors), 0)))
        self.sizes = np.linalg.norm(directions, axis=0)
        self._visible = self.sizes > SEEN * np.maximum(self._before, 1e-300)
        self._visible &= self.sizes > 1e-9
        return list(np.split(self._visible, self._ends[:-1]))


def _ranked(
    keys: Sequence[str], real: Sequence[float], null: Floats, skip: Mapping[str, str]
) -> tuple[Scored, ...]:
    """p of each, and adjusted for the smallest of all, from the same draws."""
    kept = [k for k, key in enumerate(keys) if key not in skip]
    if not kept:
        return ()
    tails = {k: _Tail(null[:, k]) for k in kept}
    smallest = np.min([[tails[k](float(x)) for x in null[:, k]] for k in kept], axis=0)
    looks = max(float(np.log(0.95) / np.log1p(-np.quantile(smallest, 0.05))), 1.0)
    scored = []
    for k in kept:
        p = tails[k](real[k])
        adjusted = float(-np.expm1(looks * np.log1p(-min(p, 1 - 1e-12))))
        scored.append(Scored(keys[k], real[k], p, adjusted, float(np.mean(null[:, k]))))
    return tuple(sorted(scored, key=lambda s: (s.p, -s.statistic)))


class _Tail:
    """p-values from draws: a scaled chi-squared with the draws' mean and variance, which reaches beyond them."""

    def __init__(self, draws: Floats) -> None:
        mean, variance = float(np.mean(draws)), float(np.var(draws))
        self._scale = max(variance / (2 * mean), 1e-12) if mean > 0 else 1.0
        self._dof = max(mean / self._scale, 0.1)

    def __call__(self, statistic: float) -> float:
        from scipy.special import chdtrc

        return float(chdtrc(self._dof, statistic / self._scale))


def _visible(
    fitted: Fit, effects: Sequence[Effect], tables: Mapping[str, Floats], cast: _Cast
) -> dict[str, float]:
    """Amplitude of each effect that such data would show, from its most visible start."""
    found = {}
    ends = np.concatenate([[0], cast._ends])
    for k, key in enumerate(tables):
        effect = next(e for e in effects if e.key == key)
        sizes = cast.sizes[ends[k] : ends[k + 1]]
        first = np.array([abs(s[0] - effect.parameters[0].default) for s in effect.starts(fitted.data)])
        best = int(np.argmax(sizes))
        seen = sizes[best] > 1e-9 and cast.left[k][best]
        found[key] = float(3.6 * first[best] / sizes[best]) if seen and first[best] > 0 else float("inf")
    return found
