"""Calibrate a method on ball presses: detect balls, take samples, fit a law, cross-validate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.ball_consistency import (
    contradicting_radii,
    coverage_warnings,
    label_warnings,
    odd_balls,
    outlier_among,
    pressed_reference,
    reference_warnings,
    scale_warnings,
)
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import (
    MIN_BALLS,
    BallPicture,
    check_count,
    collect_balls,
    pressed_balls,
    refine_balls,
)
from tactilevision.photometric.ball_samples import (
    Observability,
    Samples,
    far_from,
    slope_observability,
    values_at,
    with_same_colours,
)
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.cross_validation import (
    SLOPE_SOFTENING,
    BallFit,
    Fitter,
    HeldOutLaw,
    ScaleUncertainty,
    fit_light_law,
    gain_std,
    gains_of,
    scale_uncertainty,
)
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.polynomial import RIDGES, Polynomial, fit_polynomial
from tactilevision.photometric.methods.two_colours import TwoColourLaws, fit_two_colours
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.photometric.reference import BackgroundSums, Reference
from tactilevision.photometric.shading_law import response_of
from tactilevision.records.measured import Floats, Pair, Picture

MAX_SLOPE_NOISE = 0.03  # slope of a pixel's noise, worst direction: real .001 to .006, a tenth as coloured .047
MAX_EVEN_NOISE = (
    0.04  # the same where alike in all directions: pure colours, noisy, .033; a fifth as coloured .042
)
MAX_NOISE_RATIO = 4  # worst over best direction: real 1.8 to 2.7, a tenth as coloured 4.6
MAX_GAP_DEG = 200  # degrees between the sides of colours: five real sensors leave 131 to 184, two lamps 250


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
    rng: np.random.Generator | None = None,
) -> Calibration:
    """Fit a colour law to ball presses; held-out thirds select the fit and give its error.

    Assumes that inside the contact circle the gel has the ball's shape. Raises InputError for fewer than MIN_BALLS
    usable presses, with the faults of the others.
    """
    rng, change = rng or np.random.default_rng(0), ColourChange(reference)
    alone = collect_balls(change, pictures, mm_per_px, rng)
    seen = refine_balls(alone, change, pictures, mm_per_px, rng)
    balls, every = list(seen.balls), seen.every
    warnings = [*seen.warnings, *label_warnings([(p.centre_px, p.contact_radius_px) for p in pictures], balls)]
    pressed, resting = with_same_colours(*every, min_balls=MIN_BALLS)
    if (prepared := getattr(fit, "prepared", None)) is not None:
        fit = prepared(change, [picture.rgb for picture in pictures], balls, mm_per_px)
    best = _best_fit(fit, pressed, resting)
    scale = scale_uncertainty(best)
    direction = float(np.median(direction_error_deg(best.held_out, pressed.slopes)))
    slope_error = float(np.sqrt(np.mean(np.sum((best.held_out - pressed.slopes) ** 2, axis=1))))
    background = _measure_background(best.law, change, pictures, balls, mm_per_px)
    light, cover = slope_observability(pressed), 0.5 * np.ptp(pressed.place, axis=0)  # places run from -1 to 1
    contact_px, at_contact = pressed_reference(change, [picture.rgb for picture in pictures], alone.balls)
    odd = _odd_warnings(best, scale, balls, pictures)
    warnings += reference_warnings(contact_px) or [
        *scale_warnings(pressed.change, pressed.slopes),
        *coverage_warnings(cover),
        *_observability_warnings(light),
        *odd,
    ]
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
        response=response_of(pressed, values_at(pressed, change.level)).to_card(),
    )
    relative = slope_error / float(np.sqrt(np.mean(np.sum(pressed.slopes**2, axis=1))))
    return Calibration(
        CalibratedMethod(
            best.law, reference, relative, background, card, _two_colours(best, *every), fit_light_law(best)
        ),
        tuple(balls),
        direction,
        slope_error,
        tuple(warnings),
        tuple(scale.held_out_laws.get(number) for number in range(len(pictures))),
    )


def _best_fit(fit: Fitter, pressed: Samples, resting: Samples) -> BallFit:
    """Return the fit by the fitter and ridge with the least error at held-out balls.

    Raises InputError where too few balls have the same known colours.
    """
    white = InputError("two colours are overexposed there", remedy="Dim the light, or press balls elsewhere.")
    check_count(known := len(np.unique(pressed.press)), known, [("the others", white)])
    ways = getattr(fit, "ways", None) or [(fit, ridge) for ridge in getattr(fit, "ridges", RIDGES[:3])]
    return min((BallFit(fitter, ridge, pressed, resting) for fitter, ridge in ways), key=lambda made: made.error)


def _two_colours(best: BallFit, pressed: Samples, resting: Samples) -> TwoColourLaws:
    """Return laws of two colours each, by the fitter of the law of three where that is a polynomial."""
    as_best = isinstance(best.law, Polynomial)
    fit, ridge = (best.fitter, best.ridge) if as_best else (fit_polynomial, RIDGES[1])
    return fit_two_colours(BallFit(fit, ridge, pressed, resting), error=best.error)


def _odd_warnings(
    best: BallFit, scale: ScaleUncertainty, balls: Sequence[Ball | None], pictures: Sequence[BallPicture]
) -> list[str]:
    """Return warnings of contradictory radii, then of single outliers."""
    radii = contradicting_radii(
        {number: ball.radius_mm for number in map(int, np.unique(best.contact.press)) if (ball := balls[number])},
        lambda group, steeper: replace(best, contact=best.contact.steepened(steeper)).gains_without(
            np.array(group)
        ),
    )
    return radii + odd_balls(
        gains_of(best.held_out, best.contact),
        balls,
        names=[picture.name for picture in pictures],
        unsure={number: held.std for number, held in scale.held_out_laws.items()},
        outlier_among=partial(outlier_among, best),
    )


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


def _observability_warnings(light: Observability) -> list[str]:
    """Return a warning where a direction of slope is lost in noise, or no colour lights one side."""
    uneven = light.worst > MAX_NOISE_RATIO * light.best
    worst = f"{light.worst:.2g} along {light.worst_deg:.0f} degrees (from x, right, to y, down)"
    if light.worst < (MAX_SLOPE_NOISE if uneven else MAX_EVEN_NOISE):
        if light.gap_deg < MAX_GAP_DEG:
            return []
        return [
            f"no colour lights the gel from a side {light.gap_deg:.0f} degrees wide, about {light.dark_deg:.0f} "
            "degrees (from x, right, to y, down): two lamps? The error of slopes is larger. Light that side in a "
            "third colour"
        ]
    if not uneven and light.worst < SLOPE_SOFTENING:
        return [
            f"these lights show slopes faintly: one of {worst}, of {light.best:.2g} across it, changes the "
            "colours by a pixel's noise. Depth is too shallow. Are the lamps' colours nearly alike? Light each "
            "side in a pure colour"
        ]
    return [
        f"these lights hardly show slopes of one direction: one of {worst} changes the colours by a pixel's "
        f"noise, across it {light.best:.2g} does. Do lamps of one colour face each other, or are all of one "
        "colour? Light each side in a colour of its own"
    ]
