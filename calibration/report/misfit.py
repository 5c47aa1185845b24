"""Misfit of models: force curves, residuals against covariates, and the error of each model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from calibration.diagnosis.covariates import DEPTH_BINS, press_trends, seen_covariates
from calibration.diagnosis.score_test import Scored
from calibration.diagnosis.vision_depth_check import face_error_mm
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import Covariate, bins, true_repeats
from calibration.inputs.denoised_depth import BRANCHES, branches
from calibration.inputs.observations import Observations, press_names
from calibration.report import wording
from calibration.tasks.compare import Compared, Comparison
from tactilevision.errors import InputError
from tactilevision.records.constants import TAILS95
from tactilevision.records.measured import Floats
from tactilevision.records.misfit import ErrorFall, ForceCurves, PressCurve, ResidualStrips, Strip


def force_curves(fits: Mapping[str, Fit]) -> ForceCurves:
    """Return the presses of fits to the same data, by the models' names, the base model first.

    Raises InputError where the fits have different samples.
    """
    models, data = same_samples(fits), next(iter(fits.values())).data
    table = np.array([one.force_N for one in fits.values()])
    words = np.array(BRANCHES)[branches(data)]
    spans, presses = data.spans, []
    for k in np.argsort(data.presses.order, kind="stable"):
        rows = spans[k]
        indenter = data.indenters[int(data.presses.indenter[k])]
        presses.append(
            PressCurve(
                label=data.presses.label[k],
                indenter=indenter.name,
                radius_mm=float(data.presses.radius_mm[k]),
                time_s=data.time_s[rows] - data.time_s[rows.start],
                depth_mm=data.depth_mm[rows],
                measured_N=data.normal_N[rows],
                modelled_N=table[:, rows],
                phase=tuple(words[rows].tolist()),
            )
        )
    return ForceCurves(models, tuple(presses), data.is_curves)


def same_samples(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """Return the fits' names. Raises InputError for none, or for fits to different samples."""
    every = list(fits.values())
    if not every:
        raise InputError("there is no model to show", where="figure")
    first = every[0].data
    for name, one in fits.items():
        if one.data.size != first.size or one.data.presses.label != first.presses.label:
            raise InputError("these models were fitted to different presses", where="figure", value=name)
    return tuple(fits)


BINS = 8  # of a covariate, with about equal counts
HELD = 0.98  # share of all residuals that the common scale shows
DEPTHS = ("w", "w/h", "1/w")  # forms of the depth: plotted as the first, with the smallest p


def residual_strips(
    fits: Mapping[str, Fit], scored: Sequence[Sequence[Scored]], *, most: int = 8
) -> ResidualStrips:
    """Return the covariates most significant in the first fit, with the residuals of all fits.

    `scored`: for each fit, the covariates of its score test; others are not shown. Raises InputError where the
    fits have different samples.
    """
    models, fitted = same_samples(fits), list(fits.values())
    data = fitted[0].data
    residual = np.array([one.residual_N for one in fitted])
    p = [{one.key: one.p_adjusted for one in own} for own in scored]
    trends = [press_trends(one) for one in fitted]
    seen = {one.name: one for one in seen_covariates(at_denoised_depth(fitted[0]))}
    strips = []
    for key in (one for one in _distinct(scored[0]) if one in seen):
        p_of, trend_of = (tuple(own.get(key, float("nan")) for own in table) for table in (p, trends))
        strips.append(strip_of(seen["w" if key in DEPTHS else key], data, residual, p=p_of, trend=trend_of))
    reach = float(np.quantile(np.abs(residual), HELD))
    names = press_names(data)
    press = tuple(names[k] for k in data.press)
    return ResidualStrips(models, tuple(strips[:most]), residual, data.radius_mm, reach, press)


def _distinct(scored: Sequence[Scored]) -> list[str]:
    """Return the keys, the most significant first, the depth in one of its forms."""
    keys = [one.key for one in scored]
    depth = next((key for key in keys if key in DEPTHS), "")
    return [key for key in keys if key == depth or key not in DEPTHS]


def strip_of(
    covariate: Covariate,
    data: Observations,
    residual_N: Floats,
    *,
    p: tuple[float, ...] = (),
    trend: tuple[float, ...] = (),
) -> Strip:
    """Return residuals (m, N), N, in bins of a covariate, with 95 % intervals of the bins' means.

    Readings of one press err together, so an interval counts presses: with S_p the sum of a press's deviations
    from the mean of its bin, n readings and G presses, std = sqrt(G / (G - 1) sum S_p^2) / n, times Student's t;
    NaN for a bin of one press. Source: Cameron and Miller, J. Hum. Resour. 50 (2015) 317.
    """
    number = bins(covariate, DEPTH_BINS if covariate.name in DEPTHS else BINS)
    rows = [np.flatnonzero(number == k) for k in range(int(number.max()) + 1)]
    mean = np.array([[one[row].mean() for row in rows] for one in residual_N])
    reach = [[_reach95(one[row], data.press[row]) for row in rows] for one in residual_N]
    return Strip(
        name=covariate.name,
        words=wording.covariate(covariate.name),
        unit=covariate.unit,
        levels=levels(covariate.name, data),
        values=covariate.values,
        centre=np.array([covariate.values[row].mean() for row in rows]),
        mean_N=mean,
        reach95_N=np.array(reach),
        p_adjusted=p,
        p_trend=trend,
    )


def _reach95(residual: Floats, press: npt.NDArray[np.int_]) -> float:
    from scipy.special import stdtrit

    _, number = np.unique(press, return_inverse=True)
    sums = np.bincount(number, residual - residual.mean())
    if sums.size < 2:
        return float("nan")
    std = np.sqrt(sums.size / (sums.size - 1) * np.sum(sums**2)) / residual.size
    return float(stdtrit(sums.size - 1, TAILS95[1]) * std)


def levels(name: str, data: Observations) -> tuple[str, ...]:
    """Return the names of the values 0, 1, 2 ... of a categorical covariate; none for a quantity."""
    if name == "load/unload":
        return BRANCHES
    return tuple(one.name for one in data.indenters) if name == "indenter" else ()


BASE = "base model"  # the contact law without effects
AS_READ = "as read"  # the reconstructed depth without effects


def error_falls(found: Comparison) -> list[ErrorFall]:
    """Return the error of the force and of the reconstructed depth: what changes, then what is off."""
    both = [error_fall_of_comparison(found), *error_fall_of_picture(found.pictured)]
    return sorted(both, key=lambda fall: (len(fall.models) == 1, fall.reached))


def error_fall_of_comparison(found: Comparison) -> ErrorFall:
    """Return the error of the models in the order in which effects were added."""
    held_out = [one.held_out_N for one in found.models]
    known = all(map(math.isfinite, held_out))
    errors = held_out if known else [one.rms_N for one in found.models]
    return _fall([one.effects for one in found.models], errors, found.models[0].fitted, known)


def error_fall_of_picture(found: Sequence[Compared]) -> tuple[ErrorFall, ...]:
    """Return the error of the reconstructed depth, from as it is read on; nothing without fits to it.

    The error of the faces as well, where it is of slopes next to them.
    """
    if not found:
        return ()
    fits, effects = [one.fitted for one in found], [one.effects for one in found[1:]]
    fall = _fall(effects, [one.held_out_N for one in found], fits[-1], True)  # a treatment changes what repeats
    faces = () if fits[0].data.slopes is None else tuple(face_error_mm(one) for one in fits)
    return (replace(fall, models=(AS_READ, *fall.models), unit="mm", faces=faces),)


def _fall(effects: Sequence[Sequence[str]], errors: Sequence[float], base: Fit, held_out: bool) -> ErrorFall:
    repeats = true_repeats(base.data)
    std, band = (math.nan, None) if repeats is None else (repeats.std, repeats.interval95)
    return ErrorFall(model_names(effects), tuple(errors), std, band, held_out)


def model_names(effects: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the names of models in the order of adding: the base model, then each by the effect it adds."""
    return tuple(f"+ {keys[-1].replace('_', ' ')}" if keys else BASE for keys in effects)
