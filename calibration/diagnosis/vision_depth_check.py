"""The picture's depth compared with the certified one.

The picture has a gain and a zero for each press, as a force sensor has, so that the error model, tests and search
for forces apply, with the picture's depth as the force. Detectable are a wrong gain, a drift, saturating slopes,
and a certified depth that does not allow for the gel's rise.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from calibration.diagnosis.refit import Candidate, fit_without, press_folds
from calibration.effects import EFFECTS
from calibration.effects.in_picture import InPicture
from calibration.fit.least_squares import Fit, fit
from calibration.fit.repeats import refit_with_pure_noise
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.observations import Observations
from calibration.laws.reconstructed_depth import ReconstructedDepth, beside_face, with_slopes
from calibration.model.composition import Model
from tactilevision.records.measured import Floats

MIN_COUNT = 4  # samples of a comparison


def in_picture(data: Observations | None = None) -> tuple[InPicture, ...]:
    """Return the effects that the picture's depth can show; those of slopes where these data have them."""
    shown = (effect.in_picture(data) for effect in EFFECTS.values())
    return tuple(effect for effect in shown if isinstance(effect, InPicture))


def sight_of(data: Observations) -> Observations | None:
    """Return the samples in contact with both depths, the picture's as the force; None where they are too few."""
    if data.reconstructed_mm is None:
        return None
    usable = np.isfinite(data.reconstructed_mm) & (data.depth_mm > 0)
    if np.count_nonzero(usable) < MIN_COUNT:
        return None
    both = data.samples(usable)
    assert both.reconstructed_mm is not None
    nothing = np.full(both.size, np.nan)
    presses = replace(both.presses, speed_mm_s=np.full(both.count, np.nan))  # a picture knows no rate
    seen = np.column_stack([np.zeros((both.size, 2)), both.reconstructed_mm])  # nor a force aside
    faces = replace(both, force_N=seen, force_std_N=nothing, depth_std_mm=nothing, presses=presses)
    return with_slopes(faces) or faces


def unseen_beside(data: Observations) -> str:
    """Return why slope and azimuth cannot be tested; "" where they can."""
    if data.slopes is not None:
        return ""
    return (
        "Not testable by slope and azimuth: that needs frames of six presses of a flat cylinder, and the "
        "gel beside its face in view."
    )


def fit_vision_depth(data: Observations) -> Fit | None:
    """Return the fit of the picture's depth with the noise of repeats; None without such a depth."""
    both = sight_of(data)
    return None if both is None else refit_with_pure_noise(fit(Model(ReconstructedDepth()), both))


def reading_error_mm(fitted: Fit) -> float:
    """Return the rms error in mm of the picture's depth, corrected by the effects in the model alone.

    On presses held out of the fit, over the slopes outside the faces, which no walls hide; over the faces where
    these were not read.
    """
    beside = beside_face(fitted.data)
    return _rms(_left_out_mm(fitted)[beside if beside.any() else ~beside])


def face_error_mm(fitted: Fit) -> float:
    """Return the same error over the faces."""
    return _rms(_left_out_mm(fitted)[~beside_face(fitted.data)])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


@lru_cache(maxsize=16)  # a page needs it several times
def _left_out_mm(fitted: Fit) -> Floats:
    """Return the picture's depth less the certified one (N,), mm, each press by a fit without it."""
    data, law, problem = fitted.data, fitted.model.slices(fitted.data)["law"], fitted.problem
    folds, error = press_folds(data), np.empty(data.size)
    for fold in np.unique(folds):
        out = (folds == fold)[data.press]
        values = problem.full(fit_without(problem, fitted.values, out).values)
        values[law] = 0.0  # other errors of the height map
        error[out] = (data.normal_N - fitted.model.predict(values, data))[out]
    return error


def read_alone(fitted: Fit) -> Floats:
    """Return what the picture would read (N,), mm, with the fitted effects alone."""
    values = fitted.values.copy()
    values[fitted.model.slices(fitted.data)["law"]] = 0.0
    return fitted.model.predict(values, fitted.data)


def corrected_depth(fitted: Fit) -> Floats:
    """Return the depth that the picture read (N,), mm, corrected by the fitted effects alone."""
    data, values = fitted.data, fitted.values.copy()
    for key, place in fitted.model.slices(data).items():
        if key != "law" and key not in TOLERANCES:
            values[place] = [p.default for p in fitted.parameters[place]]
    return np.asarray(data.normal_N * read_alone(replace(fitted, values=values)) / read_alone(fitted))


def recorded_of_depth(data: Observations) -> list[tuple[str, Floats]]:
    """Return what was recorded along with the picture's depth, (N,) each, by its words and unit."""
    against = [("certified depth (mm)", data.depth_mm)]
    if np.isfinite(data.time_s).all() and np.ptp(data.time_s) > 0:
        against.append(("time (min)", (data.time_s - data.time_s.min()) / 60))
    else:
        against.append(("press", data.presses.order[data.press] + 1))
    if data.slopes is not None:
        against += [
            ("slope next to the punch face (mm/mm)", data.slopes.slope),
            ("azimuth about the face (°, 90 is down)", data.slopes.azimuth_deg),
        ]
    return against


def depth_ratio(fitted: Fit) -> Floats:
    """Return the picture's over the certified depth (N,)."""
    return np.asarray(fitted.data.normal_N / fitted.data.depth_mm)


def risen(candidate: Candidate, data: Observations) -> float:
    """Return the median share of the certified depths that a fitted effect takes off; 0 for other effects."""
    if not isinstance(candidate.effect, InPicture) or not candidate.effect.of_certificate:
        return 0.0
    left = candidate.effect.inner.seen(np.ones(data.size), candidate.own_values, data)
    return float(1 - np.median(left))
