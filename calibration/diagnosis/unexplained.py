"""What no effect explains, described: how large it is, over what depth it varies, on what it depends.

The mean residual in bins of depth is taken for a Gaussian process, covariance s^2 exp(-(w - w')^2/(2 l^2)) beside
the bins' own errors times k, since presses scatter by more than their samples say; s, l and k are the likeliest on
a grid. It describes and never repairs E. An l at the grid's finest is not resolved: NaN.
Source: Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), eq. 2.30.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from calibration.diagnosis.alternative_explanation import AlternativeExplanation
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.score_test import Scored
from calibration.fit.least_squares import Fit
from calibration.inputs.denoised_depth import nominal_depth
from tactilevision.records import Floats

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


def describe(fitted: Fit, scored: tuple[Scored, ...], level: float = 0.05) -> Unexplained:
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
    best = (min(_cost(k**2 * own, mean_N) for k in WIDER), 0.0, float("nan"))
    lengths = np.geomspace(span / 40, span, 20)
    for length, size, k in product(lengths, float(np.std(mean_N)) * np.geomspace(0.1, 3, 12), WIDER):
        covariance = size**2 * np.exp(-((apart / length) ** 2) / 2) + k**2 * own
        best = min(best, (_cost(covariance, mean_N), float(size), float(length)))
    return best[1], best[2] if best[2] > lengths[0] else float("nan")


def _cost(covariance: Floats, values: Floats) -> float:
    """-2 log likelihood."""
    volume = float(np.linalg.slogdet(covariance)[1])
    return float(values @ np.linalg.solve(covariance, values)) + volume
