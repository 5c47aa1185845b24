"""Directions and residuals freed of what a fit can absorb, and their scores under any size of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.noise.inner_products import Product, Weighing
from calibration.noise.model import Noise, Whitener
from calibration.noise.reml import prior_cost
from calibration.repeats.draws import draw_errors
from calibration.repeats.repeat_noise import drawn_noise
from tactilevision.records import Floats

SEEN = 0.02  # a direction with less left beside the fit is the fit's own: a ramp's speed, known to .5 %, makes it
LESS_GAIN = (1.0, 0.125, 0.25, 0.5, 2.0, 4.0)  # of the presses' gain, that are tried: from 4 % to what is usual


@dataclass(frozen=True, slots=True)
class _Seen:
    """Residuals (N, b) as the fit and as the directions see them, their squares, and priors (k, b)."""

    own: Product
    looked: Product
    squares: Product
    priors: Floats


class Cast:
    """Directions against residuals under one model: freed of what the fit absorbs, weighed, scored.

    All is put in coordinates that are white under the fit's own noise, so that under a draw's noise, which is
    never far from it, nothing that matters cancels.
    """

    def __init__(self, fitted: Fit, tables: Sequence[Floats], form_N: Floats) -> None:
        """`form_N` (N, m): what the form of effects in the fit may be off by, each column one std."""
        self.fitted = fitted
        free = fitted.free & ~fitted.at_bound  # what stands at its bound cannot give way any further
        known = np.array([0.0 if p.prior is None else 1 / p.prior.std for p in fitted.parameters])[free]
        known = np.concatenate([known, np.ones(form_N.shape[1])])
        self.own_priors = np.array(
            [
                (p.prior.mean - v) / p.prior.std
                for p, v, gives in zip(fitted.parameters, fitted.values, free, strict=True)
                if p.prior is not None and gives
            ]
            + [0.0] * form_N.shape[1]
        )
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
        seen = self._seen(residual_N, priors)
        return [self._split(self._weighed(seen, k, noise)[0]) for k, noise in enumerate(noises)]

    def ratios(self, noises: Sequence[Noise], residual_N: Floats, priors: Floats) -> list[list[Floats]]:
        """Signed roots of likelihood ratios in place of scores: with a direction the presses may scatter less.

        What changes from press to press passes for their gains; few presses then hide it, however large it is.
        A direction d takes t^2 off -2 ln L at any noise; both with it and without the likeliest gain counts.
        """
        seen, found = self._seen(residual_N, priors), []
        for k, noise in enumerate(noises):
            each = [self._weighed(seen, k, replace(noise, gain=noise.gain * share)) for share in LESS_GAIN]
            scores, costs = np.array([one for one, _ in each]), np.array([cost for _, cost in each])
            with_it = np.min(costs[:, None] - scores**2, axis=0)
            found.append(self._split(np.sign(scores[0]) * np.sqrt(costs.min() - with_it)))
        return found

    def _split(self, scores: Floats) -> list[Floats]:
        return list(np.split(scores, self.ends[:-1]))

    def _seen(self, residual_N: Floats, priors: Floats) -> _Seen:
        errors = self._weighing.take(residual_N)
        own, looked = (self._weighing.product(one, errors) for one in (self._own, self._looked))
        return _Seen(own, looked, self._weighing.squares(errors), priors)

    def _weighed(self, seen: _Seen, k: int, noise: Noise) -> tuple[Floats, float]:
        """Scores of all directions for the k-th residual under a noise, and -2 ln L of that noise."""
        within = self._within.under(noise) + self._priors.T @ self._priors
        between = self._between.under(noise) + self._priors.T @ self._beside
        taken = np.linalg.solve(within, between)
        length = self._lengths.under(noise) + np.sum(self._beside**2, axis=0) - np.sum(between * taken, axis=0)
        own = seen.own.of(k).under(noise)[:, 0] + self._priors.T @ seen.priors[:, k]
        along = seen.looked.of(k).under(noise)[:, 0] + self._beside.T @ seen.priors[:, k] - taken.T @ own
        unit = np.sqrt(np.where(self._visible, np.maximum(length, 1e-12), np.inf))
        return along / unit, self._cost(noise, within, seen.squares.under(noise)[k] - own @ np.linalg.solve(within, own))

    def _cost(self, noise: Noise, within: Floats, squares: float) -> float:
        """-2 ln L of a noise that leaves so many squares; a constant is left out."""
        volume = self._weighing.log_volume(noise) + np.linalg.slogdet(within)[1]
        sizes = np.log([noise.scale, max(noise.gain, 1e-6), max(noise.zero_mm, 1e-7)])
        return float(squares + volume + prior_cost(sizes, trust=noise.trust))

    def white(self, noise: Noise, residual_N: Floats, *, priors: Floats) -> Floats:
        """What the fit leaves of a residual (N,), white."""
        whitener = Whitener(self.fitted.data, noise, self.fitted.about)
        seen = whitener.apply(np.column_stack([self._jacobian, residual_N]))
        jacobian, white = seen[:, :-1], seen[:, -1]
        within = jacobian.T @ jacobian + self._priors.T @ self._priors
        own = jacobian.T @ white + self._priors.T @ priors
        return np.asarray(white - jacobian @ np.linalg.solve(within, own))

    def left_of(self, residual_N: Floats, priors: Floats) -> Floats:
        """What the fit leaves of residuals (N, k) with priors (q, k), in N."""
        own = self._weighing.product(self._own, self._weighing.take(residual_N)).under(self.fitted.noise)
        return np.asarray(residual_N - self._jacobian @ (own + self._priors.T @ priors))

    def null(self, rng: np.random.Generator, draws: int) -> tuple[Floats, Floats]:
        """Draws of the model itself: errors (N, draws), priors (k, draws).

        The noise's sizes are drawn too, as they are known: where repeats are few a press's gain may well be twice
        what was estimated, and presses that differ by place or day are then no finding.
        """
        errors = draw_errors(self.fitted, rng, draws, noises=drawn_noise(self.fitted, rng, draws))
        return errors, rng.standard_normal((len(self._priors), draws))
