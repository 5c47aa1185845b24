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

from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import Covariate, bins, covariates
from calibration.model.stages import Effect
from calibration.noise.heteroscedasticity import Scatter
from calibration.noise.inner_products import Weighing
from calibration.noise.model import Noise, Whitener
from calibration.repeats.at_denoised_depth import at_denoised_depth
from calibration.repeats.repeat_noise import renewed_noise
from tactilevision.errors import InputError
from tactilevision.records import Floats

DRAWS = 399  # of the bootstrap: p to .0025, finer by the tail's fit
TAIL = 0.1  # share of the draws from which p-values are carried on beyond them
SCATTER = "scatter while loading"
FAILED = "it failed"
SEEN = 1e-3  # a direction of which less than this share is left beside the fit is the fit's own
DEPTH_BINS = 16  # steps of the depth: what varies over a sixteenth of it is seen
OTHER_BINS = 6  # steps of every other covariate


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
class ScoreTest:
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


def score_test(
    fitted: Fit, effects: Sequence[Effect], rng: np.random.Generator, *, draws: int = DRAWS
) -> ScoreTest:
    """Score `effects` and every covariate against the residual of `fitted`, whose noise is taken as its own."""
    fitted = at_denoised_depth(fitted)
    tables, missing = effect_directions(fitted, effects)
    seen = seen_covariates(fitted)
    steps = {c.name: _steps(fitted, c) for c in seen} | _of_one_size(fitted, seen)
    cast = _Cast(fitted, [*tables.values(), *steps.values()])
    real = cast.scores([fitted.noise], fitted.residual_N[:, None], cast.own_priors[:, None])[0]
    drawn = cast.null(rng, draws)
    null = cast.scores(*drawn)
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
        white = [cast.white(noise, drawn[1][:, k], drawn[2][:, k]) for k, noise in enumerate(drawn[0])]
        usual = float(np.mean([scatter.differences(one).mean() for one in white]))
        looks.append(SCATTER)
        sums.append(scatter.statistic(cast.white(fitted.noise, fitted.residual_N, cast.own_priors), usual))
        null_sums = np.column_stack([null_sums, [scatter.statistic(one, usual) for one in white]])
    return ScoreTest(
        effects=_ranked(list(tables), largest, null_largest, skip=missing),
        covariates=_ranked(looks, sums, null_sums, skip={}),
        not_testable=missing,
        visible=_visible(fitted, effects, tables, cast),
    )


def seen_covariates(steady: Fit) -> tuple[Covariate, ...]:
    """The covariates of a steadied fit, force as fitted: bins of what was read would sort residuals by their own
    noise.
    """
    return covariates(steady.data.with_force(steady.force_N))


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
        except (Exception, SystemExit) as fault:  # of a private effect, anything; the rest of the analysis goes on
            why = f"{FAILED}: {type(fault).__name__}: {fault}"
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
        if np.iscomplexobj(force):
            raise InputError("an effect returns real forces", where=effect.key, value=start.tolist())
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


def _of_one_size(fitted: Fit, seen: Sequence[Covariate]) -> dict[str, Floats]:
    """Step functions (N, k) of the sizes of effects in the fit that have to have one throughout."""
    found = {}
    for effect in fitted.model.effects:
        name = f"{effect.key}.{effect.parameters[0].name}" if effect.parameters else ""
        for covariate in (c for c in seen if c.name in getattr(effect, "same_over", ())):
            change = fitted.jacobian[:, fitted.index(name)]
            number = bins(covariate, OTHER_BINS)
            found[f"{effect.key} by {covariate.name}"] = np.eye(int(number.max()) + 1)[number] * change[:, None]
    return found


class _Cast:
    """Directions against residuals under one model: freed of what the fit absorbs, weighed, scored.

    All is put in coordinates that are white under the fit's own noise, so that under a draw's noise, which is
    never far from it, nothing that matters cancels.
    """

    def __init__(self, fitted: Fit, tables: Sequence[Floats]) -> None:
        self.fitted = fitted
        free = fitted.free & ~fitted.at_bound  # what stands at its bound cannot give way any further
        known = np.array([0.0 if p.prior is None else 1 / p.prior.std for p in fitted.parameters])[free]
        self.own_priors = np.array(
            [
                (p.prior.mean - v) / p.prior.std
                for p, v, gives in zip(fitted.parameters, fitted.values, free, strict=True)
                if p.prior is not None and gives
            ]
        )
        self._ends = np.cumsum([t.shape[1] for t in tables])
        directions = np.column_stack(tables) if tables else np.zeros((fitted.data.size, 0))
        self._free_and_norm(fitted.jacobian[:, free], np.diag(known)[known > 0], directions)
        self.left = list(np.split(self._visible, self._ends[:-1]))
        self._weighing = Weighing(fitted.data, fitted.about, fitted.noise)
        own, looked = self._weighing.take(self._jacobian), self._weighing.take(self._directions)
        self._own, self._looked = own, looked
        self._within, self._between = (self._weighing.product(own, other) for other in (own, looked))
        self._lengths = self._weighing.squares(looked)

    def _free_and_norm(self, jacobian: Floats, priors: Floats, directions: Floats) -> None:
        """Fit and directions (samples and priors) as orthonormal columns under the fit's own noise."""
        size = np.linalg.norm(jacobian, axis=0)
        scale = np.where(size > 0, size, 1.0)
        apply = Whitener(self.fitted.data, self.fitted.noise, self.fitted.about).apply
        white = np.vstack([apply(jacobian / scale), priors / scale])
        left, length, right = np.linalg.svd(white, full_matrices=False)
        kept = length > 1e-10 * max(float(length.max(initial=0.0)), 1e-300)
        back = right[kept].T / length[kept] / scale[:, None]
        self._jacobian, self._priors = jacobian @ back, priors @ back
        seen = apply(directions)
        before = np.linalg.norm(seen, axis=0)
        share = left[: len(seen), kept].T @ seen
        self.sizes = np.sqrt(np.maximum(before**2 - np.sum(share**2, axis=0), 0.0))
        self._visible = (self.sizes > SEEN * np.maximum(before, 1e-300)) & (self.sizes > 1e-9)
        unit = np.where(self._visible, self.sizes, np.inf)
        self._directions = (directions - self._jacobian @ share) / unit
        self._beside = -(self._priors @ share) / unit

    def scores(self, noises: Sequence[Noise], residual_N: Floats, priors: Floats) -> list[list[Floats]]:
        """Scores of each table's directions for each column of residuals (N, b), under a noise of its own.

        `priors` (k, b): how far, in std, the parameters' truth lies off its priors.
        """
        errors = self._weighing.take(residual_N)
        own, looked = (self._weighing.product(one, errors) for one in (self._own, self._looked))
        found = []
        for k, noise in enumerate(noises):
            within = self._within.under(noise) + self._priors.T @ self._priors
            between = self._between.under(noise) + self._priors.T @ self._beside
            taken = np.linalg.solve(within, between)
            length = self._lengths.under(noise) + np.sum(self._beside**2, axis=0) - np.sum(between * taken, axis=0)
            own_k = own.of(k).under(noise)[:, 0] + self._priors.T @ priors[:, k]
            along = looked.of(k).under(noise)[:, 0] + self._beside.T @ priors[:, k] - taken.T @ own_k
            unit = np.sqrt(np.where(self._visible, np.maximum(length, 1e-12), np.inf))
            found.append(list(np.split(along / unit, self._ends[:-1])))
        return found

    def white(self, noise: Noise, residual_N: Floats, priors: Floats) -> Floats:
        """What the fit leaves of a residual (N,), white."""
        whitener = Whitener(self.fitted.data, noise, self.fitted.about)
        seen = whitener.apply(np.column_stack([self._jacobian, residual_N]))
        jacobian, white = seen[:, :-1], seen[:, -1]
        within = jacobian.T @ jacobian + self._priors.T @ self._priors
        own = jacobian.T @ white + self._priors.T @ priors
        return np.asarray(white - jacobian @ np.linalg.solve(within, own))

    def null(self, rng: np.random.Generator, draws: int) -> tuple[list[Noise], Floats, Floats]:
        """Draws of the model itself: the noise estimated anew from each, errors (N, draws), priors (k, draws)."""
        fitted = self.fitted
        whitener = Whitener(fitted.data, fitted.noise, fitted.about)
        errors = whitener.colour(rng.standard_normal((fitted.data.size, draws)))
        priors = rng.standard_normal((len(self._priors), draws))
        return renewed_noise(fitted, errors), errors, priors


def _ranked(
    keys: Sequence[str], real: Sequence[float], null: Floats, skip: Mapping[str, str]
) -> tuple[Scored, ...]:
    """p of each, and adjusted for the smallest of all, from the same draws."""
    kept = [k for k, key in enumerate(keys) if key not in skip]
    if not kept:
        return ()
    tails = {k: _Tail(null[:, k]) for k in kept}
    smallest = np.min([[tails[k](float(x)) for x in null[:, k]] for k in kept], axis=0)
    typical = min(float(np.quantile(smallest, 0.05)), 1 - 1e-12)
    looks = max(float(np.log(0.95) / np.log1p(-typical)), 1.0)
    scored = []
    for k in kept:
        p = tails[k](real[k])
        adjusted = float(-np.expm1(looks * np.log1p(-min(p, 1 - 1e-12))))
        scored.append(Scored(keys[k], real[k], p, adjusted, float(np.mean(null[:, k]))))
    return tuple(sorted(scored, key=lambda s: (s.p, -s.statistic)))


class _Tail:
    """p-values from draws: their own share up to the largest tenth, and beyond it the slower of two tails: an
    exponential of that tenth's mean excess, and the scaled chi-squared with the mean and variance of all draws.

    A chi-squared of few degrees of freedom falls off more and more slowly, so that an exponential read at its
    tenth understates p far out; where the noise is hardly known draws fall off more slowly than a chi-squared.
    Source: Pickands, Ann. Stat. 3 (1975) 119, shape 0.
    """

    def __init__(self, draws: Floats) -> None:
        self._draws = np.sort(draws)
        self._from = float(np.quantile(draws, 1 - TAIL))
        beyond = draws[draws > self._from] - self._from
        self._excess = max(float(np.mean(beyond)) if beyond.size else 0.0, 1e-12)
        mean, variance = float(np.mean(draws)), float(np.var(draws))
        self._scale = max(variance / (2 * mean), 1e-12) if mean > 0 else 1.0
        self._dof = max(mean / self._scale, 0.1)
        self._share = max(self._chi_squared(self._from), 1e-300)

    def _chi_squared(self, statistic: float) -> float:
        from scipy.special import chdtrc

        return float(chdtrc(self._dof, statistic / self._scale))

    def __call__(self, statistic: float) -> float:
        if statistic > self._from:
            exponential = float(np.exp(-(statistic - self._from) / self._excess))
            return TAIL * max(exponential, self._chi_squared(statistic) / self._share)
        below = np.searchsorted(self._draws, statistic) / self._draws.size
        return max(float(1 - below), TAIL)


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
