"""Noise of block means that is correlated from block to block, estimated from what a fit leaves over.

    cov(i, j) = s^2 (1 + sqrt(3) d/L) exp(-sqrt(3) d/L) + white^2/share_i [i = j],     d the blocks' distance.

Matern's form of order 3/2: smooth enough for integrated slopes, and never singular. The moments of the residuals
give s, L and white: their mean product at each distance, a method of moments with the degrees of freedom
corrected.

Source: Matern, Spatial Variation (1960); Cressie, Statistics for Spatial Data (1993), section 2.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.mechanics.surface_view import Blocks
from tactilevision.records import Floats

START_STD_MM = 0.005  # before anything is known; only the weight of weak priors depends on it
LONGEST = 8.0  # lags up to this many blocks are looked at
# of the variance: at least this share is taken for white, which keeps the matrix well conditioned
FLOOR_SHARE = 0.02
LINEAR_UNKNOWNS = 12  # columns of the linear part of the fit


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """`std_mm` and `length_mm` of the correlated part, `white_mm` of what each full block has for itself."""

    std_mm: float
    length_mm: float
    white_mm: float

    def covariance(self, blocks: Blocks) -> Floats:
        """(n, n), mm^2."""
        smooth = self.std_mm**2 * matern(_distances(blocks) / self.length_mm)
        return np.asarray(smooth + np.diag(self.white_mm**2 / blocks.share))

    def effective_samples(self, blocks: Blocks) -> float:
        """How many independent readings of the same variance fix a mean as well: 1' R^-1 1, R the correlation."""
        matrix = self.covariance(blocks)
        scale = np.sqrt(np.diag(matrix))
        ones = np.ones(len(scale))
        return float(ones @ np.linalg.solve(matrix / np.outer(scale, scale), ones))


WHITE = NoiseModel(0.0, 1.0, START_STD_MM)


def matern(distance: Floats) -> Floats:
    """Correlation, -1 to 1, at a distance of any shape in parts of the length: dimensionless."""
    reach = np.sqrt(3) * distance
    return np.asarray((1 + reach) * np.exp(-reach))


def estimate_noise(blocks: Sequence[Blocks], misfits: Sequence[Floats], *, block_mm: float) -> NoiseModel:
    """The noise of all presses together, from their misfits (n,) each, in mm; blocks are `block_mm` apart."""
    edges = (np.arange(LONGEST + 1) + 0.5) * block_mm
    total, pairs, variance, count = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1), 0.0, 0.0
    distance_sum = np.zeros(len(edges) - 1)
    for part, misfit in zip(blocks, misfits, strict=True):
        weighted = misfit * np.sqrt(len(misfit) / max(len(misfit) - LINEAR_UNKNOWNS, 1))
        distance = _distances(part)
        upper = np.triu_indices(len(misfit), 1)
        lag = np.digitize(distance[upper], edges) - 1
        near = (lag >= 0) & (lag < len(total)) & (part.face[upper[0]] == part.face[upper[1]])
        product = np.outer(weighted, weighted)[upper][near]
        total += np.bincount(lag[near], product, len(total))
        pairs += np.bincount(lag[near], minlength=len(total))
        distance_sum += np.bincount(lag[near], distance[upper][near], len(total))
        variance += float(weighted @ weighted)
        count += len(weighted)
    seen = pairs > 0
    return _match(variance / count, total[seen] / pairs[seen], distance_sum[seen] / pairs[seen], pairs[seen])


def _match(variance: float, products: Floats, lags: Floats, pairs: Floats) -> NoiseModel:
    """Least squares of s^2 rho(lag/L) to the mean products, over a range of L; what is left at lag 0 is white."""
    best = (np.inf, 0.0, 1.0)
    for length in np.geomspace(lags.min(initial=1.0) / 2, lags.max(initial=1.0), 40):
        shape = matern(lags / length)
        power = float(np.clip(np.sum(pairs * shape * products) / np.sum(pairs * shape**2), 0, variance))
        cost = float(np.sum(pairs * (products - power * shape) ** 2))
        best = min(best, (cost, power, float(length)))
    _, power, length = best
    power = min(power, (1 - FLOOR_SHARE) * variance)
    return NoiseModel(float(np.sqrt(power)), length, float(np.sqrt(variance - power)))


def _distances(blocks: Blocks) -> Floats:
    return np.asarray(np.hypot(*(np.subtract.outer(place, place) for place in (blocks.x_mm, blocks.y_mm))))
