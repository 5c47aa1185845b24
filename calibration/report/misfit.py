"""Misfit of models: force curves, residuals against covariates, and the error of each model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from calibration.diagnosis.covariates import DEPTH_BINS, press_trends, seen_covariates
from calibration.diagnosis.diagnosis import Diagnosis
from calibration.diagnosis.score_test import Scored
from calibration.diagnosis.vision_depth_check import face_error_mm, reading_error_mm
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.least_squares import Fit
from calibration.fit.repeats import repeatability_rms
from calibration.inputs.conditions import Covariate, bins, repeat_groups
from calibration.inputs.denoised_depth import BRANCHES, branches
from calibration.inputs.observations import Observations
from calibration.report import wording
from calibration.tasks.compare import Compared, Comparison
from tactilevision.errors import InputError
from tactilevision.records.measured import Floats, Pair
from tactilevision.records.misfit import ErrorFall, ForceCurves, PressCurve, ResidualStrips, Strip

# Measured and modelled force press by press, and what each effect of a model does to it.


def force_curves(fits: Mapping[str, Fit]) -> ForceCurves:
    """The presses of fits on the same measurements, by the models' names, the plain law first.

    Raises InputError where the fits have not the same samples.
    """
    models, data = same_samples(fits), next(iter(fits.values())).data
    table = np.array([one.force_N for one in fits.values()])
    words = np.array(BRANCHES)[branches(data)]
    ends = [*data.first[1:], data.size]
    presses = []
    for k in np.argsort(data.presses.order, kind="stable"):
        rows = slice(int(data.first[k]), int(ends[k]))
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


def force_of_effect(fitted: Fit, key: str) -> Floats:
    """What one effect of a fitted model does to the force (N,), N: with it less without, all else held.

    Raises InputError where the model has no such effect.
    """
    places = fitted.model.slices(fitted.data)
    if key not in fitted.model.keys:
        raise InputError("the model has no such effect", where=fitted.model.name, value=key)
    values = np.delete(fitted.values, places[key])
    return np.asarray(fitted.force_N - fitted.model.without(key).predict(values, fitted.data))


def same_samples(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """The fits' names. Raises InputError for none, or for fits that do not stand on the same samples."""
    every = list(fits.values())
    if not every:
        raise InputError("there is no model to show", where="figure")
    first = every[0].data
    for name, one in fits.items():
        if one.data.size != first.size or one.data.presses.label != first.presses.label:
            raise InputError("these models were fitted to other presses", where="figure", value=name)
    return tuple(fits)


# What models leave of the force against everything recorded, in one unit, so that before and after compare.

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


# How the error falls from model to model, and the band in which the presses repeat.

BASE = "plain law"  # the model that all others add to
AS_READ = "as read"  # the picture's depth with nothing added
MIN_DOF = 2  # like presses, less one a group, that a repeatability has to stand on


def repeatability_band(fitted: Fit, repeatability: float) -> Pair | None:
    """The 95 % interval of a repeatability (a std, in any unit), None where too few presses repeat each other.

    (n - 1) s^2/sigma^2 is chi-squared; n - 1 counts the presses less one a group of like ones. Source: Draper and
    Smith, Applied Regression Analysis, ch. 1.
    """
    from scipy.special import gammaincinv

    groups = repeat_groups(fitted.data)
    dof = fitted.data.count - np.unique(groups).size
    if dof < MIN_DOF or not math.isfinite(repeatability):
        return None
    low, high = (repeatability * math.sqrt(dof / 2 / float(gammaincinv(dof / 2, p))) for p in (0.975, 0.025))
    return low, high


def error_fall_of_comparison(found: Comparison) -> ErrorFall:
    """Of the models in the order in which effects were added."""
    held_out = all(math.isfinite(one.held_out_N) for one in found.models)
    last = found.models[-1]
    return ErrorFall(
        model_names([one.effects for one in found.models]),
        tuple(one.held_out_N if held_out else one.rms_N for one in found.models),
        last.repeatability_N,
        repeatability_band(last.fitted, last.repeatability_N),
        held_out,
    )


def error_fall_of_picture(found: Sequence[Compared]) -> tuple[ErrorFall, ...]:
    """Of the depth that the picture reads, from as it is read on; nothing where no effect was added to it."""
    if not found:
        return ()
    last = found[-1]
    band = repeatability_band(last.fitted, last.repeatability_N)
    errors = tuple(one.held_out_N for one in found)
    return (
        ErrorFall(
            (AS_READ, *model_names([one.effects for one in found[1:]])),
            errors,
            last.repeatability_N,
            band,
            True,
            "mm",
            _faces([one.fitted for one in found]),
        ),
    )


def error_fall_of_sight(found: Diagnosis) -> tuple[ErrorFall, ...]:
    """Of the depth that the picture reads, where effects on it were named."""
    if found.search.sight is None or not any(e.key not in found.fits.fitted.model.keys for e in found.effects):
        return ()
    fits = [found.search.sight.base, *(step.fitted for step in found.search.sight.steps)]
    keys = [step.best.effect.key for step in found.search.sight.steps]
    floor = repeatability_rms(fits[-1])
    names = (AS_READ, *model_names([keys[: k + 1] for k in range(len(keys))]))
    errors = tuple(reading_error_mm(one) for one in fits)
    return (ErrorFall(names, errors, floor, repeatability_band(fits[-1], floor), True, "mm", _faces(fits)),)


def _faces(fits: Sequence[Fit]) -> tuple[float, ...]:
    """The error of the faces themselves, mm, where the other is of what lies beside them."""
    return () if fits[0].data.slopes is None else tuple(face_error_mm(one) for one in fits)


def error_fall_of_diagnosis(found: Diagnosis) -> ErrorFall:
    """Of the plain law and each effect of the force that was named."""
    keys = [effect.key for effect in found.effects if effect.key in found.fits.fitted.model.keys]
    steps = [tuple(keys[:k]) for k in range(len(keys) + 1)][: max(len(found.errors.held_out_N), 1)]
    held_out = bool(found.errors.held_out_N) and all(math.isfinite(one) for one in found.errors.held_out_N)
    fitted = (found.errors.before, found.errors.after)[: len(steps)]
    errors = found.errors.held_out_N if held_out else (fitted[0], *[math.nan] * (len(steps) - 2), *fitted[1:])
    return ErrorFall(
        model_names(steps),
        tuple(errors),
        found.errors.floor,
        repeatability_band(found.fits.fitted, found.errors.floor),
        held_out,
    )


def model_names(effects: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Names of models in the order of adding: the plain law, then each by what it adds."""
    return tuple(f"+ {keys[-1].replace('_', ' ')}" if keys else BASE for keys in effects)
