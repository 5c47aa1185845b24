"""The two figures that say how well a model fits, the same in calibrate, compare, diagnose and steps.

    held-out error = rms of measured less predicted force over presses that the fit did not see (five folds)
    repeatability  = std of the force among like presses, after what the model says of their differences

A model is as good as the presses allow where the first is near the second. Either is an estimate from few presses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.diagnosis.refit import CANNOT_FIT, held_out_rms
from calibration.fit.least_squares import Fit, fit
from calibration.inputs.checks import clear_of_touch
from calibration.repeats.pure_error import repeatability_rms
from calibration.repeats.repeat_noise import beyond_stated, refit_with_pure_noise
from calibration.repeats.sample_noise import clear_of_own_touch, depth_beyond_stated, with_sample_noise
from calibration.result.result import CalibrationResult

TOO_SMALL = "stated_noise_too_small"


@dataclass(frozen=True, slots=True)
class FitErrors:
    """Of one fit, in N: `rms_N` over the presses it was fitted to, `held_out_N` (NaN for two presses or fewer).

    A radius that is pressed once keeps the slope beta of the whole fit while its press is left out: no other press
    tells it.
    """

    rms_N: float
    held_out_N: float
    repeatability_N: float


def fit_errors(fitted: Fit) -> FitErrors:
    """How well a fit that weighs its samples by what repeats show describes its presses, and others."""
    return FitErrors(fitted.rms_error_N, held_out_rms(fitted), repeatability_rms(fitted))


def judged(fitted: Fit) -> Fit:
    """The same model on the same presses as `compare` and `diagnose` fit it; the fit itself where that fails.

    Those weigh samples by how repeats and neighbours differ, and leave out samples of curves too near to first
    contact.
    """
    data = clear_of_touch(fitted.data)
    try:
        again = fitted if data is fitted.data else fit(fitted.model, data, tolerances=False)
        again = refit_with_pure_noise(again)
        shaped = clear_of_own_touch(again, with_sample_noise(again))
        if shaped is again.data:
            return again
        return refit_with_pure_noise(fit(again.model, shaped, starts=again.values[None], tolerances=False))
    except CANNOT_FIT:
        return fitted


def with_errors(result: CalibrationResult, errors: FitErrors) -> CalibrationResult:
    """The result with its held-out error and its repeatability."""
    return replace(result, held_out_N=errors.held_out_N, noise_floor_N=errors.repeatability_N)


def with_stated_noise(result: CalibrationResult, fitted: Fit, *, or_else: str = "") -> CalibrationResult:
    """The result with a word on a stated noise far off what this fit's samples scatter, or else on its cause."""
    times = beyond_stated(fitted)
    if times is None and (deeper := depth_beyond_stated(fitted)) is not None:
        said = f"depths scatter {deeper:.1f} times as much as was stated of them. Check std_mm of [depth]{or_else}"
        return replace(result, flags=(*result.flags, TOO_SMALL), warnings=(*result.warnings, said))
    if times is None:
        return result
    said = (
        f"samples scatter {times:.1f} times as much as was stated of them; that is taken as their noise. Check "
        f"std_N of [force] and std_mm of [depth]{or_else}"
    )
    flag = TOO_SMALL
    if times < 1:
        said = (
            "samples scatter less than half as much as was stated of them: small effects may stay unseen. Check "
            "std_N of [force] and std_mm of [depth]"
        )
        flag = "stated_noise_too_large"
    return replace(result, flags=(*result.flags, flag), warnings=(*result.warnings, said))
