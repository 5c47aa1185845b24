"""p-values of a statistic from draws of it, carried on beyond the farthest draw.

Up to the largest tenth of the draws p is their own share; beyond it the slower of two tails: an exponential of
that tenth's mean excess, and the scaled chi-squared with the mean and variance of all draws. A chi-squared of few
degrees of freedom falls off more and more slowly, so that an exponential read at its tenth understates p far out;
where the noise is hardly known draws fall off more slowly than a chi-squared. One wild draw makes both tails too
slow: p is never more than the share of all, the measured one among them, that lie as far out.
Sources: Pickands, Ann. Stat. 3 (1975) 119, shape 0; Barnard, J. R. Stat. Soc. B 25 (1963) 294.
"""

from __future__ import annotations

import numpy as np

from tactilevision.records import Floats

LEAST = 1e-300  # p of what lies farther out than a number can say: its logarithm is finite
TAIL = 0.1  # share of the draws from which p-values are carried on beyond them


class Tail:
    """p of what is measured, and of each draw by the others."""

    def __init__(self, draws: Floats) -> None:
        self._draws, self._from = draws, float(np.quantile(draws, 1 - TAIL))
        self._beyond = draws > self._from
        self._excess = (draws - self._from)[self._beyond]

    def __call__(self, statistic: float) -> float:
        """Of a statistic that is none of the draws."""
        if statistic <= self._from:
            return max(float(np.mean(self._draws > statistic)), TAIL)
        means = [np.mean(one) if one.size else 0.0 for one in (self._draws, self._draws**2, self._excess)]
        counted = (1 + np.count_nonzero(self._draws >= statistic)) / (1 + self._draws.size)
        return min(float(self._far(np.array(statistic), *(np.array(mean) for mean in means))), float(counted))

    def of_each(self) -> Floats:
        """Of each draw (n,) by the others.

        A draw that takes part in its own tail makes that longer, and lies less far out than a measurement would:
        the smallest p of many statistics would be held against too large ones.
        """
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
        """Beyond the tail's begin, from the draws' mean, mean square and mean excess."""
        from scipy.special import chdtrc

        known = mean > 0
        scale = np.where(known, np.maximum((square - mean**2) / (2 * np.where(known, mean, 1.0)), 1e-12), 1.0)
        dof = np.maximum(mean / scale, 0.1)
        share = np.maximum(chdtrc(dof, self._from / scale), LEAST)
        exponential = np.exp(-(statistic - self._from) / np.maximum(excess, 1e-12))
        p = TAIL * np.maximum(exponential, chdtrc(dof, statistic / scale) / share)
        return np.asarray(np.maximum(p, LEAST))
