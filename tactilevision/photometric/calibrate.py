"""Calibrate a method on ball presses: detect balls, take samples, fit a law, cross-validate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.cache import kept_record, packed_record
from tactilevision.photometric.ball_consistency import ball_warnings, pressed_reference
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import MIN_BALLS, BallPicture, BallSearch, check_count, pressed_balls
from tactilevision.photometric.ball_samples import (
    Samples,
    far_from,
    forget_samples,
    slope_observability,
    with_same_colours,
)
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.cross_validation import BallFit, Fitter, HeldOutLaw, gain_std, scale_uncertainty
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.polynomial import RIDGES, Polynomial, fit_polynomial
from tactilevision.photometric.methods.two_colours import TwoColourLaws, fit_two_colours
from tactilevision.photometric.protocols import ColourLaw, Progress, silent
from tactilevision.photometric.reference import BackgroundSums, Reference
from tactilevision.photometric.shading_law import response_of
from tactilevision.records.measured import Floats, Pair, Picture


@dataclass(frozen=True, slots=True)
class Calibration:
    """A method and its errors.

    `balls`: None where a picture was excluded (see `warnings`); `direction_error_deg` median and `slope_error` rms
    over held-out balls; `held_out_laws`: for each ball a law fitted without it.
    """

    method: CalibratedMethod
    balls: tuple[Ball | None, ...]
    direction_error_deg: float
    slope_error: float
    warnings: tuple[str, ...]
    held_out_laws: tuple[HeldOutLaw | None, ...] = ()


def calibrate_from_balls(
    reference: Reference,
    pictures: Sequence[BallPicture],
    *,
    mm_per_px: Pair,
    fit: Fitter,
    progress: Progress = silent,
) -> Calibration:
    """Fit a colour law to ball presses; held-out thirds select the fit and give its error.

    Assumes that inside the contact circle the gel has the ball's shape. The balls found are kept in the cache, for
    other fits. `progress` hears of each pass. Raises InputError for fewer than MIN_BALLS usable presses, with the
    faults of the others.
    """
    change, shots = ColourChange(reference), [picture.rgb for picture in pictures]
    search = BallSearch(change, pictures, mm_per_px, np.random.default_rng(0), progress)
    content = packed_record((reference, tuple(pictures), mm_per_px))
    key = [sha256(part).hexdigest() for part in content.values()]
    alone, seen = kept_record("balls", key, make=search.alone_and_refined)
    balls, every = list(seen.balls), seen.every
    pressed, resting = with_same_colours(*every, min_balls=MIN_BALLS)
    if (prepared := getattr(fit, "prepared", None)) is not None:
        fit = prepared(change, shots, balls, mm_per_px)
    best = _best_fit(fit, pressed, resting, progress)
    progress(0, 1, "uncertainty of the scale")
    scale = scale_uncertainty(best)
    progress(0, 1, "checks of the balls")
    direction = float(np.median(direction_error_deg(best.held_out, pressed.slopes)))
    slope_error = float(np.sqrt(np.mean(np.sum((best.held_out - pressed.slopes) ** 2, axis=1))))
    background = _measure_background(best.law, change, pictures, balls, mm_per_px)
    light, cover = slope_observability(pressed), 0.5 * np.ptp(pressed.place, axis=0)  # places run from -1 to 1
    contact_px, at_contact = pressed_reference(change, shots, alone)
    unsure = {number: held.std for number, held in scale.held_out_laws.items()}
    warnings = ball_warnings(best, balls, pictures, cover=cover, light=light, contact_px=contact_px, unsure=unsure)
    card = MethodCard(
        method=best.law.name,
        balls=seen.count,
        balls_left_out=len(pictures) - seen.count,
        balls_cover=tuple(np.round(cover, 3).tolist()),
        held_out_direction_error_deg=direction,
        held_out_slope_rms=slope_error,
        held_out_gain_std=gain_std(best.held_out, pressed),
        place_gain_std=np.round(scale.gain_std, 5).tolist(),
        extrapolated_gain_std=np.round(scale.extrapolated_std, 5).tolist(),
        coverage_factor=scale.coverage_factor,
        min_slope_noise=light.best,
        max_slope_noise=light.worst,
        contact_in_reference_px=contact_px,
        balls_at_that_contact=at_contact,
        fitted_by=getattr(best.fitter, "__name__", type(best.fitter).__name__),
        ridge=best.ridge,
        steepest_slope=float(np.hypot(*pressed.slopes.T).max()),
        response=response_of(pressed, pressed.values_of(change.maps.mean)).to_card(),
    )
    relative = slope_error / float(np.sqrt(np.mean(np.sum(pressed.slopes**2, axis=1))))
    two, law = _two_colours(best, *every), best.light_law()
    forget_samples()
    return Calibration(
        CalibratedMethod(best.law, reference, relative, background, card, two, law),
        tuple(balls),
        direction,
        slope_error,
        (*seen.warnings, *warnings),
        tuple(scale.held_out_laws.get(number) for number in range(len(pictures))),
    )


def _best_fit(fit: Fitter, pressed: Samples, resting: Samples, progress: Progress) -> BallFit:
    """Return the fit by the fitter and ridge with the least error at held-out balls.

    Raises InputError where too few balls have the same known colours.
    """
    white = InputError("two colours are overexposed there", remedy="Dim the light, or press balls elsewhere.")
    check_count(known := len(np.unique(pressed.press)), known, [("the others", white)])
    ways = getattr(fit, "ways", None) or [(fit, ridge) for ridge in getattr(fit, "ridges", RIDGES[:3])]
    fits = [BallFit(fitter, ridge, pressed, resting) for fitter, ridge in ways]
    for number, made in enumerate(fits):
        progress(number, len(fits), "laws of the light")
        made.error  # noqa: B018 -- kept by the fit
    return min(fits, key=lambda made: made.error)


def _two_colours(best: BallFit, pressed: Samples, resting: Samples) -> TwoColourLaws:
    """Return laws of two colours each, by the fitter of the law of three where that is a polynomial."""
    as_best = isinstance(best.law, Polynomial)
    fit, ridge = (best.fitter, best.ridge) if as_best else (fit_polynomial, RIDGES[1])
    return fit_two_colours(BallFit(fit, ridge, pressed, resting), error=best.error)


def direction_error_deg(slopes: Floats, true: Floats) -> Floats:
    """Return the angle (N,) between estimated and true slopes, both (N, 2)."""
    turn = (slopes[:, 0] + 1j * slopes[:, 1]) * (true[:, 0] - 1j * true[:, 1])
    return np.asarray(np.degrees(np.abs(np.angle(turn))))


def _measure_background(
    law: ColourLaw,
    change: ColourChange,
    pictures: Sequence[BallPicture],
    balls: Sequence[Ball | None],
    mm_per_px: Pair,
) -> Picture:
    """Return bias and noise of the law on the untouched part of the ball pictures."""
    evaluate = law.evaluator(change.reference.shape)
    sums = BackgroundSums(change.reference.shape)
    for rgb, ball in pressed_balls(pictures, balls):
        changes, _, valid = change.measure(rgb)
        sums.add(*evaluate(changes), valid & far_from(ball, valid.shape, mm_per_px=mm_per_px))
    return sums.result(evaluate.noise(change.noise))
