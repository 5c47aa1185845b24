"""What models leave of the force against everything recorded, in one unit, so that before and after compare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.diagnosis.covariate_steps import DEPTH_BINS, seen_covariates
from calibration.diagnosis.press_trends import press_trends
from calibration.diagnosis.score_test import Scored
from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import Covariate, bins
from calibration.inputs.denoised_depth import BRANCHES
from calibration.inputs.observations import Observations
from calibration.repeats.at_denoised_depth import at_denoised_depth
from calibration.report import wording
from calibration.report.force_curves import same_samples
from tactilevision.records import Floats
from tactilevision.records.misfit import ResidualStrips, Strip

BINS = 8  # of a strip, each with about as many residuals
HELD = 0.98  # share of all residuals that the common scale shows
DEPTHS = ("w", "w/h", "1/w")  # one thing in three forms: drawn as the first, by the most telling one's p


def residual_strips(
    fits: Mapping[str, Fit], scored: Sequence[Sequence[Scored]], *, most: int = 8
) -> ResidualStrips:
    """The covariates that tell most of the first fit, with the residuals of all.

    `scored`: for each fit, the covariates of its score test. A covariate that was not scored is left out. Raises
    InputError where the fits have not the same samples.
    """
    models, fitted = same_samples(fits), list(fits.values())
    data = fitted[0].data
    residual = np.array([one.residual_N for one in fitted])
    p = [{one.key: one.p_adjusted for one in own} for own in scored]
    trends = [press_trends(one) for one in fitted]
    seen = {one.name: one for one in seen_covariates(at_denoised_depth(fitted[0]))}
    strips = []
    for key in (one for one in _once(scored[0]) if one in seen):
        p_of, trend_of = (tuple(own.get(key, float("nan")) for own in table) for table in (p, trends))
        strips.append(_strip(seen["w" if key in DEPTHS else key], data, residual, p=p_of, trend=trend_of))
    reach = float(np.quantile(np.abs(residual), HELD))
    return ResidualStrips(models, tuple(strips[:most]), residual, data.radius_mm, reach)


def _once(scored: Sequence[Scored]) -> list[str]:
    """Keys, the most telling first, the depth in one of its forms alone."""
    keys = [one.key for one in scored]
    depth = next((key for key in keys if key in DEPTHS), "")
    return [key for key in keys if key == depth or key not in DEPTHS]


def _strip(
    covariate: Covariate, data: Observations, residual_N: Floats, *, p: tuple[float, ...], trend: tuple[float, ...]
) -> Strip:
    number = bins(covariate, most_bins(covariate.name))
    rows = [np.flatnonzero(number == k) for k in range(int(number.max()) + 1)]
    count = np.array([row.size for row in rows])
    mean = np.array([[one[row].mean() for row in rows] for one in residual_N])
    spread = np.array([[one[row].std(ddof=1) if row.size > 1 else np.nan for row in rows] for one in residual_N])
    return Strip(
        name=covariate.name,
        words=wording.covariate(covariate.name),
        unit=covariate.unit,
        levels=levels(covariate.name, data),
        values=covariate.values,
        centre=np.array([covariate.values[row].mean() for row in rows]),
        mean_N=mean,
        reach95_N=1.96 * spread / np.sqrt(count),
        p_adjusted=p,
        p_trend=trend,
    )


def most_bins(name: str) -> int:
    """How many bins a covariate has at most."""
    return DEPTH_BINS if name in DEPTHS else BINS


def levels(name: str, data: Observations) -> tuple[str, ...]:
    """The words for 0, 1, 2 ... of a covariate whose values only count; none for a quantity."""
    if name == "load/unload":
        return BRANCHES
    return tuple(one.name for one in data.indenters) if name == "indenter" else ()
