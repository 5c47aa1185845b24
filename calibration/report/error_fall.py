"""How the error falls from model to model, and the band in which the presses repeat."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from calibration.diagnosis.diagnosis import Diagnosis
from calibration.diagnosis.vision_depth_check import face_error_mm, reading_error_mm
from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import repeat_groups
from calibration.repeats.pure_error import repeatability_rms
from calibration.tasks.compare import Compared, Comparison
from tactilevision.records import Pair
from tactilevision.records.misfit import ErrorFall

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
    if found.sight is None or not any(e.key not in found.fitted.model.keys for e in found.effects):
        return ()
    fits = [found.sight.base, *(step.fitted for step in found.sight.steps)]
    keys = [step.best.effect.key for step in found.sight.steps]
    floor = repeatability_rms(fits[-1])
    names = (AS_READ, *model_names([keys[: k + 1] for k in range(len(keys))]))
    errors = tuple(reading_error_mm(one) for one in fits)
    return (ErrorFall(names, errors, floor, repeatability_band(fits[-1], floor), True, "mm", _faces(fits)),)


def _faces(fits: Sequence[Fit]) -> tuple[float, ...]:
    """The error of the faces themselves, mm, where the other is of what lies beside them."""
    return () if fits[0].data.slopes is None else tuple(face_error_mm(one) for one in fits)


def error_fall_of_diagnosis(found: Diagnosis) -> ErrorFall:
    """Of the plain law and each effect of the force that was named."""
    keys = [effect.key for effect in found.effects if effect.key in found.fitted.model.keys]
    steps = [tuple(keys[:k]) for k in range(len(keys) + 1)][: max(len(found.held_out), 1)]
    held_out = bool(found.held_out) and all(math.isfinite(one) for one in found.held_out)
    fitted = (found.errors.before, found.errors.after)[: len(steps)]
    errors = found.held_out if held_out else (fitted[0], *[math.nan] * (len(steps) - 2), *fitted[1:])
    return ErrorFall(
        model_names(steps),
        tuple(errors),
        found.errors.floor,
        repeatability_band(found.fitted, found.errors.floor),
        held_out,
    )


def model_names(effects: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Names of models in the order of adding: the plain law, then each by what it adds."""
    return tuple(f"+ {keys[-1].replace('_', ' ')}" if keys else BASE for keys in effects)
