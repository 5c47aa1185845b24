"""Whether what a model leaves of the presses rises or falls along what was recorded.

A press's residual is the mean of its samples' over the std that the noise gives it, its covariate the mean there.
Spearman's rank correlation of the two over the presses is held against presses in random order; p is Bonferroni's,
times the covariates looked at. It sees a slow drift of few presses, which free steps of a covariate do not.
Source: Hollander, Wolfe, Chicken, Nonparametric Statistical Methods, 3rd ed. (2014), ch. 8.
"""

from __future__ import annotations

import numpy as np

from calibration.diagnosis.covariate_steps import seen_covariates
from calibration.fit.least_squares import Fit
from calibration.repeats.at_denoised_depth import at_denoised_depth
from tactilevision.records import Floats

LEVEL = 0.05  # p below which a trend is told
SHUFFLES = 9999  # of the presses: p to 1e-4
MOST_VALUES = 4e6  # shuffled at once: fewer shuffles of more than 400 presses
NO_QUANTITY = ("load/unload", "indenter", "azimuth", "azimuth beside the face")  # names, and directions around


def press_trends(fitted: Fit) -> dict[str, float]:
    """p of each covariate's trend over the presses, for all that are looked at, by its name.

    Names, directions around the axis, and what is the same in all presses are not looked at.
    """
    fitted = at_denoised_depth(fitted)
    data, seen = fitted.data, seen_covariates(fitted)
    count = np.bincount(data.press)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(data.press, values) / count)

    along = {one.name: _ranks(mean(one.values)) for one in seen if one.name not in NO_QUANTITY}
    along = {name: ranks for name, ranks in along.items() if np.ptp(ranks) > 0}
    own = mean(fitted.residual_N)
    if not along or np.ptp(own) == 0:
        return {}
    noise, about = fitted.noise, fitted.about
    of_samples = noise.scale**2 * mean(about.base_N**2) / count
    of_press = (noise.gain * mean(about.force_N)) ** 2 + (noise.zero_mm * mean(about.slope_N_per_mm)) ** 2
    ranks = _ranks(own / np.sqrt(of_samples + of_press))
    draws = int(min(SHUFFLES, MOST_VALUES / own.size))
    rows = np.vstack([ranks, np.random.default_rng(0).permuted(np.tile(ranks, (draws, 1)), axis=1)])
    score = np.abs(rows @ np.column_stack(list(along.values())))
    p = np.mean(score >= score[0] * (1 - 1e-12), axis=0)
    return {name: min(1.0, len(along) * float(one)) for name, one in zip(along, p, strict=True)}


def _ranks(values: Floats) -> Floats:
    """Ranks about their mean (M,), equal values with one rank."""
    ranks = np.unique(np.round(values, 9), return_inverse=True)[1].astype(float)
    return np.asarray(ranks - ranks.mean())
