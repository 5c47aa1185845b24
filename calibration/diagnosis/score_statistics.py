"""Score statistics free of what a fit absorbs, their bootstrap distribution and p-values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calibration.fit.least_squares import Fit, prior_pulls
from calibration.fit.outlying_presses import TAILS, log_student, press_dof
from calibration.fit.repeats import drawn_noise
from calibration.noise.model import Noise, Whitener
from calibration.noise.reml import Columns, Weighing, log_sizes, prior_cost, sizes_of
from tactilevision.records.constants import NONZERO, TINY
from tactilevision.records.measured import Floats

# p-values of a statistic from null samples, extrapolated beyond the largest.
#
# Up to the largest tenth p is the samples' own share; beyond it the slower of two tails: an exponential of that
# tenth's mean excess, and the scaled chi-squared with the mean and variance of all samples. One outlier makes both
# too slow: p is never more than the share of all, the measured one included, that lie as far out.
# Sources: Pickands, Ann. Stat. 3 (1975) 119, shape 0; Barnard, J. R. Stat. Soc. B 25 (1963) 294.

TAIL = 0.1  # share of the samples from which p is extrapolated


class Tail:
    """p of a measured statistic, and of each null sample among the others."""

    def __init__(self, draws: Floats) -> None:
        self._draws, self._from = draws, float(np.quantile(draws, 1 - TAIL))
        self._beyond = draws > self._from
        self._excess = (draws - self._from)[self._beyond]

    def __call__(self, statistic: float) -> float:
        """Return p of a statistic that is not one of the samples."""
        if statistic <= self._from:
            return max(float(np.mean(self._draws > statistic)), TAIL)
        means = [np.mean(one) if one.size else 0.0 for one in (self._draws, self._draws**2, self._excess)]
        counted = (1 + np.count_nonzero(self._draws >= statistic)) / (1 + self._draws.size)
        return min(float(self._far(np.array(statistic), *(np.array(mean) for mean in means))), float(counted))

    def of_each(self) -> Floats:
        """Return p of each sample (n,) among the others: one in its own tail would make that longer."""
        own, rest = self._draws[self._beyond], self._draws.size - 1
        rank = np.argsort(np.argsort(self._draws))
        p = np.maximum((rest - rank) / rest, TAIL)
        if own.size > 1:
            mean, square = ((np.sum(self._draws**n) - own**n) / rest for n in (1, 2))
            excess = (np.sum(self._excess) - self._excess) / (own.size - 1)
            counted = (self._draws.size - rank[self._beyond]) / self._draws.size
            p[self._beyond] = np.minimum(self._far(own, mean, square, excess), counted)
        return np.asarray(p)

    def _far(self, statistic: Floats, mean: Floats, square: Floats, excess: Floats) -> Floats:
        """Return p beyond the tail's begin, from the samples' mean, mean square and mean excess."""
        from scipy.special import chdtrc

        known = mean > 0
        scale = np.where(known, np.maximum((square - mean**2) / (2 * np.where(known, mean, 1.0)), TINY), 1.0)
        dof = np.maximum(mean / scale, 0.1)
        share = np.maximum(chdtrc(dof, self._from / scale), NONZERO)
        exponential = np.exp(-(statistic - self._from) / np.maximum(excess, TINY))
        p = TAIL * np.maximum(exponential, chdtrc(dof, statistic / scale) / share)
        return np.asarray(np.maximum(p, NONZERO))


# Bootstrap samples of a fit's error model, with the tails of its samples and presses.
#
# Samples and presses' gains and zeros are Student's t of unit variance, of the likeliest degrees of freedom, or
# normal by the Bayesian information criterion (Schwarz, Ann. Stat. 6 (1978) 461).

NORMAL_DOF = 100  # degrees of freedom from which a t is sampled as a normal
MIN_DOF = 2.5  # degrees of freedom: with 2 a t has no variance


def draw_errors(fitted: Fit, rng: np.random.Generator, draws: int, *, noises: Sequence[Noise] = ()) -> Floats:
    """Return errors (N, draws), N, of the fit's error model, with the tails of its samples and presses.

    `noises`: the sizes of each sample, where they are not the fit's own.
    """
    noise, about, press = fitted.noise, fitted.about, fitted.data.press
    own = replace(noise, gain=0.0, zero_mm=0.0)
    sizes = np.array([[n.scale, n.gain, n.zero_mm] for n in noises or [noise] * draws]).T
    of_samples = student(rng, sample_dof(fitted), (fitted.data.size, draws))
    errors = Whitener(fitted.data, own, about).colour(of_samples) * sizes[0] / noise.scale
    if noise.gain or noise.zero_mm:
        gain, zero = student(rng, press_dof(fitted), (2, fitted.data.count, draws))
        errors += sizes[1] * about.force_N[:, None] * gain[press]
        errors += sizes[2] * about.slope_N_per_mm[:, None] * zero[press]
    return np.asarray(errors)


def student(rng: np.random.Generator, dof: float, shape: tuple[int, ...]) -> Floats:
    """Return Student's t of this shape, unit variance; normal from NORMAL_DOF degrees of freedom on."""
    if dof > NORMAL_DOF:
        return rng.standard_normal(shape)
    dof = max(dof, MIN_DOF)
    return np.asarray(rng.standard_t(dof, shape) * np.sqrt((dof - 2) / dof))


def sample_dof(fitted: Fit) -> float:
    """Return the likeliest degrees of freedom of whitened residuals, normal unless t improves the criterion."""
    white = fitted.whitener.apply(fitted.residual_N)
    white = white / max(float(np.std(white)), NONZERO)

    def likelihood(dof: float) -> float:
        size = float(np.sqrt((dof - 2) / dof))
        return float(np.sum(log_student(white / size, dof)) - white.size * np.log(size))

    tails = [dof for dof in TAILS if dof > MIN_DOF]
    best = max(tails, key=likelihood)
    return best if likelihood(best) - likelihood(tails[-1]) > np.log(white.size) else tails[-1]


# Directions and residuals orthogonal to what a fit can absorb, and their scores under any size of the noise.

SEEN = 0.02  # a direction with a smaller share orthogonal to the fit is the fit's own
LARGER = np.geomspace(1, 64, 13)  # factors of the presses' gain, for what changes from press to press


@dataclass(frozen=True, slots=True)
class _Seen:
    """Residuals (N, b) in `columns`, with their products `own` (p, b) with the fit, `looked` (D, b) with the
    directions and `squares` (b,), all without gain and zero of presses, and priors (k, b).
    """

    columns: Columns
    own: Floats
    looked: Floats
    squares: Floats
    priors: Floats


class _Found(NamedTuple):
    """-2 ln L (b, n) up to a constant, scores and squared lengths of the directions (b, n, D), and what the fit
    absorbs (b, n, p).
    """

    costs: Floats
    scores: Floats
    lengths: Floats
    moved: Floats


class Cast:
    """Scores of directions on residuals under one model, orthogonal to what the fit absorbs.

    Coordinates are white under the fit's own noise, so that nothing cancels under the similar noise of a sample.
    """

    def __init__(self, fitted: Fit, tables: Sequence[Floats], form_N: Floats) -> None:
        """Take the directions `tables`, and `form_N` (N, m), errors of the form of effects, one std a column."""
        self.fitted = fitted
        free = fitted.free & ~fitted.at_bound  # what stands at its bound cannot give way any further
        known, forms = np.concatenate([fitted.prior_weight[free], np.ones(form_N.shape[1])]), form_N.shape[1]
        table = [p for p, gives in zip(fitted.parameters, free, strict=True) if gives]
        self.own_priors = np.append(-prior_pulls(fitted.values[free], table), np.zeros(forms))
        self.ends = np.cumsum([t.shape[1] for t in tables])
        directions = np.column_stack(tables) if tables else np.zeros((fitted.data.size, 0))
        self._free_and_norm(np.hstack([fitted.jacobian[:, free], form_N]), np.diag(known)[known > 0], directions)
        self.left = list(np.split(self._visible, self.ends[:-1]))
        self._weighing = Weighing(fitted.data, fitted.about, fitted.noise)
        own, looked = self._weighing.take(self._jacobian), self._weighing.take(self._directions)
        self._own, self._looked = own, looked
        self._within, self._between = (self._weighing.product(own, other) for other in (own, looked))
        self._lengths = self._weighing.squares(looked)

    def _free_and_norm(self, jacobian: Floats, priors: Floats, directions: Floats) -> None:
        """Make fit and directions (samples and priors) orthonormal under the fit's own noise."""
        size = np.linalg.norm(jacobian, axis=0)
        scale = np.where(size > 0, size, 1.0)
        apply = self.fitted.whitener.apply
        white = np.vstack([apply(jacobian / scale), priors / scale])
        left, length, right = np.linalg.svd(white, full_matrices=False)
        kept = length > 1e-10 * max(float(length.max(initial=0.0)), NONZERO)
        back = right[kept].T / length[kept] / scale[:, None]
        self._jacobian, self._priors = jacobian @ back, priors @ back
        seen = apply(directions)
        before = np.linalg.norm(seen, axis=0)
        share = left[: len(seen), kept].T @ seen
        self.sizes = np.sqrt(np.maximum(before**2 - np.sum(share**2, axis=0), 0.0))
        self._visible = (self.sizes > SEEN * np.maximum(before, NONZERO)) & (self.sizes > TINY)
        unit = np.where(self._visible, self.sizes, np.inf)
        self._directions = (directions - self._jacobian @ share) / unit
        self._beside = -(self._priors @ share) / unit

    def ratios(
        self, noises: Sequence[Noise], residual_N: Floats, priors: Floats, *, gains: Sequence[float]
    ) -> tuple[list[Floats], Floats]:
        """Return the likelihood ratios (b, d) of each table's d directions, for residuals (N, b), and their
        whitened parts (N, b) that the fit does not absorb.

        Each column of residuals has a noise of its own; `priors` (k, b) are the parameters' deviations from their
        priors, in std. A direction takes t^2 off -2 ln L at any noise; with it and without it the likeliest of
        `gains`, over the noise's own, counts, since changes from press to press otherwise count as scatter.
        """
        seen = self._seen(residual_N, priors)
        found = self._under(seen, [[self._of_presses(noise, share) for share in gains] for noise in noises])
        with_it = np.min(found.costs[..., None] - found.scores**2, axis=1)
        ratio = found.costs.min(axis=1)[:, None] - with_it
        fitted = [
            seen_part - own @ found.moved[:, 0].T
            for own, seen_part in zip(self._own.tables, seen.columns.tables, strict=True)
        ]
        white = self._weighing.white(replace(seen.columns, tables=fitted), sizes_of(noises))
        return list(np.split(ratio, self.ends[:-1], axis=1)), white

    def _of_presses(self, noise: Noise, share: float) -> Noise:
        """Return the noise with the presses' scatter times `share`; points do not distinguish gain and zero."""
        zero = noise.zero_mm if self.fitted.data.is_curves else share * noise.zero_mm
        return replace(noise, gain=share * noise.gain, zero_mm=zero)

    def shown(self, ratio: Floats) -> Floats:
        """Return the size of each direction (D,), in std, that gives such a likelihood `ratio` (D,).

        A larger gain of the presses may account for part of it: -2 ln L rises by the least of rise + x^2 length
        over the gains.
        """
        seen = self._seen(self.fitted.residual_N[:, None], self.own_priors[:, None])
        found = self._under(seen, [[self._of_presses(self.fitted.noise, share) for share in LARGER]])
        rise = (found.costs - found.costs.min()).T
        return np.asarray(np.sqrt(np.max((ratio - rise) / np.maximum(found.lengths[0], TINY), axis=0)))

    def _seen(self, residual_N: Floats, priors: Floats) -> _Seen:
        errors = self._weighing.take(residual_N)
        own, looked = (self._weighing.product(one, errors).rest for one in (self._own, self._looked))
        return _Seen(errors, own, looked, self._weighing.squares(errors).rest, priors)

    def _under(self, seen: _Seen, noises: Sequence[Sequence[Noise]]) -> _Found:
        """Return what each residual (b,) shows under each of its own noises (b, n).

        With W the presses' weights the products of A and a residual r are (A^T r - A^T G W G^T r)/scale^2.
        """
        every, shape = [noise for row in noises for noise in row], (len(noises), -1)
        known, beside = self._priors, self._beside
        sizes = sizes_of(every)
        (weight, of_noise), scale = self._weighing.weigh(sizes), sizes[:, 0]
        within = self._within.weighted(weight, scale) + known.T @ known
        between = self._between.weighted(weight, scale) + known.T @ beside
        inverse = np.linalg.inv(within)
        taken = inverse @ between
        lengths = (
            self._lengths.weighted(weight, scale) + np.sum(beside**2, axis=0) - np.sum(between * taken, axis=1)
        )
        index = np.repeat(np.arange(len(noises)), len(every) // len(noises))
        shared = seen.columns.shared[:, :, index]  # (M, 2, b n)
        lost = np.einsum("nmrs,msn->nmr", weight, shared).reshape(len(every), -1)
        square = scale[:, None] ** 2
        own = (seen.own.T[index] - lost @ self._own.shared.reshape(lost.shape[1], -1)) / square
        own += (seen.priors.T @ known)[index]
        along = (seen.looked.T[index] - lost @ self._looked.shared.reshape(lost.shape[1], -1)) / square
        along += (seen.priors.T @ beside)[index] - (own[:, None] @ taken)[:, 0]
        unit = np.sqrt(np.where(self._visible, np.maximum(lengths, TINY), np.inf))
        moved = (inverse @ own[:, :, None])[:, :, 0]
        left = seen.squares[index] - np.sum(lost * shared.reshape(lost.shape[1], -1).T, axis=1)
        left = left / scale**2 - np.sum(own * moved, axis=1)
        volume = of_noise + np.linalg.slogdet(within)[1]
        trust = np.array([noise.trust for noise in every])
        costs = left + volume + prior_cost(log_sizes(sizes), trust=trust)
        return _Found(*(one.reshape(*shape, *one.shape[1:]) for one in (costs, along / unit, lengths, moved)))

    def left_of(self, residual_N: Floats, priors: Floats) -> Floats:
        """Return the part in N of residuals (N, k) with priors (q, k) that the fit does not absorb."""
        own = self._weighing.product(self._own, self._weighing.take(residual_N)).under(self.fitted.noise)
        return np.asarray(residual_N - self._jacobian @ (own + self._priors.T @ priors))

    def null(self, rng: np.random.Generator, draws: int) -> tuple[Floats, Floats]:
        """Return null samples: errors (N, draws), priors (k, draws).

        The noise's sizes are sampled too: with few repeats a press's gain may well be twice the estimated one.
        """
        errors = draw_errors(self.fitted, rng, draws, noises=drawn_noise(self.fitted, rng, draws))
        return errors, rng.standard_normal((len(self._priors), draws))
