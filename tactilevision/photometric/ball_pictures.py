"""Detect the balls of all pictures, and refine their circles with the shading law of the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.ball_detection import Ball, ball_slopes, find_ball
from tactilevision.photometric.ball_samples import (
    CONTACT,
    RESTING,
    Samples,
    ball_samples,
    join,
    resting_samples,
    told_alike,
    with_noise,
)
from tactilevision.photometric.colour_change import ColourChange, Planes
from tactilevision.photometric.cross_validation import groups_of, held_out, patch_error
from tactilevision.photometric.markers import marked
from tactilevision.photometric.methods.inverse_shading import DRAWN_RIDGE, SHARES, InverseShading
from tactilevision.photometric.shading_law import PLACE_PENALTIES, answers_at, colours_by, fit_light
from tactilevision.records.measured import Bools, Bytes, Floats, Pair

# The circles of balls found anew, by what the other balls say of the light.
#
# A ball alone is found without knowing the light (`detection.py`): fifteen answers of colours to slope are fitted
# beside its centre and contact radius. A light's law that was fitted to other balls (`shading_fit.py`) leaves
# these three alone to be found,
#
#     sum over colours and pixels of rho(u - u_law(p, q, X, Y))  ->  least        |r| < REACH contact radii
#
# with p, q the ball's slopes, u the change of colour, rho square near 0 and linear beyond SOFT. A third of the
# balls is left out of the law at a time, so that no ball draws the law to its own circle. Twelve balls of a path
# tracer: centres were .69 px off (rms), after two rounds .28. Balls at one place show a light that shares their
# circles' shift, so rounds go on until circles stay (`found_balls.py`). On four real sets slopes of balls left out
# point .1 to .8 degrees better. Assumes that most circles are nearly right to begin with.

REACH = (
    1.15  # contact radii; further out gel slopes as no half-space does: rendered balls best at 1.15 of 1 to 1.45
)
SOFT = 0.05  # change of colour beyond which a misfit counts in proportion only: dust, shine and marks
MAX_PIXELS = 1000  # pixels of a ball; more only slow the fit down
MIN_PIXELS = 60  # pixels of a ball; fewer fix no circle
MAX_MOVE = 0.25  # of the contact radius, from the centre found alone: one ball that ran away had .33
RADIUS_SHARE = (0.9, 1.1)  # of the contact radius as it was found alone: real ones settle at .91 to .98
HELD_SHARE = (0.995, 1.005)  # the same, where the light would take it further than that: it stays
INWARDS = 1e-3  # px from the bounds at which the fit begins: it may not begin on them
MAX_SHARE = 0.98  # of the ball's radius: where its slopes go upright
MAX_STEPS = 15  # of the fit


def refined_circle(
    change: Planes, valid: Bools, ball: Ball, *, light: Floats, mm_per_px: Pair, radius_px: Pair
) -> Ball:
    """The `ball` with the centre and contact radius that the `light`'s law makes the best of.

    `radius_px` are the least and greatest contact radius that it may have. Relative `change` of colour (3, H, W),
    NaN where it is not known; `valid`, a mask (H, W). The ball as it was where too few pixels tell.
    """
    from scipy.optimize import least_squares

    x, y = _pixels(valid, ball)
    if len(x) < MIN_PIXELS:
        return ball
    colours = np.asarray(change[:, y, x].T, np.float64)
    known = np.isfinite(colours)
    place = np.stack([2.0 * at / (n - 1) - 1.0 for at, n in zip((x, y), valid.shape[::-1], strict=True)], axis=1)
    answers = answers_at(light, place)

    def misfit(unknown: Floats) -> Floats:
        p, q = ball_slopes(
            (x - ball.centre_px[0] - unknown[0]) * mm_per_px[0],
            (y - ball.centre_px[1] - unknown[1]) * mm_per_px[1],
            contact_mm=unknown[2] * mm_per_px[0],
            radius_mm=ball.radius_mm,
            pixel_mm=mm_per_px[0],
        )
        return np.asarray((colours_by(answers, np.stack([p, q], axis=1)) - colours)[known])

    move = 1.2 * MAX_MOVE * ball.contact_radius_px  # further than is believed, so that running away is seen
    least, most = radius_px[0], min(radius_px[1], MAX_SHARE * ball.radius_mm / mm_per_px[0])
    found = least_squares(
        misfit,
        (0.0, 0.0, float(np.clip(ball.contact_radius_px, least + INWARDS, most - INWARDS))),
        bounds=((-move, -move, least), (move, move, most)),
        loss="soft_l1",
        f_scale=SOFT,
        max_nfev=MAX_STEPS,
    ).x
    centre = float(ball.centre_px[0] + found[0]), float(ball.centre_px[1] + found[1])
    return replace(ball, centre_px=centre, contact_radius_px=float(found[2]))


def _pixels(valid: Bools, ball: Ball) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Columns and rows (N,) of at most about MAX_PIXELS valid pixels within REACH of the ball's axis."""
    (x, y), reach = ball.centre_px, REACH * ball.contact_radius_px
    height, width = valid.shape
    top, left = max(0, int(y - reach)), max(0, int(x - reach))
    step = max(1, int(np.sqrt(np.pi * reach**2 / MAX_PIXELS)))
    rows, columns = np.mgrid[
        top : min(height, int(y + reach) + 1) : step, left : min(width, int(x + reach) + 1) : step
    ]
    take = (np.hypot(columns - x, rows - y) < reach) & valid[rows, columns]
    return columns[take], rows[take]


# The balls of all pictures: found one by one, then again by the light that the others tell.
#
# Samples are drawn under each ball, and of the untouched gel beside it.

MIN_BALLS = 3  # presses; a third of them is held out at a time, and no third may be empty
MIN_REFINED = 6  # balls from which the light tells circles: a law of two or three follows their errors
AT_BOUND = 0.005  # of the contact radius: a median that near to its bound would go further
REFINEMENTS = 6  # rounds at most; on a Mini each leaves .45 of a shift that all circles share
SETTLED_PX = 0.1  # px that circles move by, the median, where rounds end
THINNED = 3  # every third sample tells whether circles are better


@dataclass(frozen=True, slots=True)
class BallPicture:
    """A rectified ball press (H, W, 3); the ball's radius; its centre and contact radius where they are known."""

    rgb: Bytes
    radius_mm: float
    centre_px: Pair | None = None
    contact_radius_px: float | None = None
    name: str = ""


@dataclass(frozen=True, slots=True)
class FoundBalls:
    """The balls of all pictures, None where one was left out, and samples under them and of untouched gel."""

    balls: tuple[Ball | None, ...]
    warnings: tuple[str, ...]
    every: tuple[Samples, Samples]

    @property
    def count(self) -> int:
        return sum(ball is not None for ball in self.balls)


Finder = Callable[[int, Planes, Bools], Ball | None]  # by a picture's number, its changes and where they are valid


def collect_balls(
    change: ColourChange,
    pictures: Sequence[BallPicture],
    mm_per_px: Pair,
    rng: np.random.Generator,
    *,
    find: Finder | None = None,
) -> FoundBalls:
    """The balls that `find` finds, or `locate`. Raises InputError for too few, naming what was wrong."""
    balls: list[Ball | None] = []
    faults: list[tuple[str, InputError]] = []
    contact: list[Samples] = []
    resting: list[Samples] = []
    marks = change.reference.marks

    def share(samples: int) -> int:
        return max(100, samples // max(1, len(pictures)))

    for number, picture in enumerate(pictures):
        try:
            changes, _, valid = change.measure_known(picture.rgb)
            if marks is not None:
                valid = valid & (marked(picture.rgb, marks) == 0)  # filled, which is no colour of a slope
            if find is None:
                ball: Ball | None = locate(changes, valid, picture=picture, mm_per_px=mm_per_px)
            else:
                ball = find(number, changes, valid)
        except InputError as fault:
            faults.append((picture.name or f"ball {number + 1}", fault))
            ball = None
        balls.append(ball)
        if ball is None:
            continue
        for parts, draw, most in ((contact, ball_samples, CONTACT), (resting, resting_samples, RESTING)):
            parts.append(
                draw(changes, ball, mm_per_px=mm_per_px, number=number, most=share(most), valid=valid, rng=rng)
            )
    check_count(len(contact), len(pictures), faults)
    warnings = tuple(f"{name} left out: {fault.what}" for name, fault in faults)
    every = with_noise(join(contact), change.noise), with_noise(join(resting), change.noise)
    return FoundBalls(tuple(balls), warnings, every)


def refine_balls(
    alone: FoundBalls,
    change: ColourChange,
    pictures: Sequence[BallPicture],
    mm_per_px: Pair,
    rng: np.random.Generator,
) -> FoundBalls:
    """The same with circles by the light of the other balls, if balls left out are told better by them.

    Rounds go on until the circles stay: balls that share a shift show a light that shares it, and lose it slowly.
    Where most contacts would come out far smaller or larger than each was found `alone`, radii are held.
    """
    if alone.count < MIN_REFINED:
        return alone
    for shares in (RADIUS_SHARE, HELD_SHARE):
        seen = alone
        for _ in range(REFINEMENTS):
            last, find = seen, _by_light(seen, alone.balls, shares, mm_per_px)
            seen = collect_balls(change, pictures, mm_per_px, rng, find=find)
            if _moved_px(seen.balls, last.balls) < SETTLED_PX:
                break
        if shares[0] + AT_BOUND < _radius_change(seen.balls, alone.balls) < shares[1] - AT_BOUND:
            break
    return replace(seen, warnings=alone.warnings) if _left_out_error(seen) < _left_out_error(alone) else alone


def _moved_px(balls: Sequence[Ball | None], before: Sequence[Ball | None]) -> float:
    """How far centres, or radii, lie from those `before`, the median."""
    moved = [
        max(math.dist(one.centre_px, other.centre_px), abs(one.contact_radius_px - other.contact_radius_px))
        for one, other in zip(balls, before, strict=True)
        if one is not None and other is not None
    ]
    return float(np.median(moved)) if moved else 0.0


def _radius_change(balls: Sequence[Ball | None], alone: Sequence[Ball | None]) -> float:
    """Contact radius over that of the ball found alone, the median."""
    pairs = [
        (one, other) for one, other in zip(balls, alone, strict=True) if one is not None and other is not None
    ]
    return float(np.median([one.contact_radius_px / other.contact_radius_px for one, other in pairs]))


def _by_light(seen: FoundBalls, alone: Sequence[Ball | None], shares: Pair, mm_per_px: Pair) -> Finder:
    pressed = told_alike(*seen.every, min_balls=MIN_BALLS)[0]
    lights = {
        int(number): light
        for group in groups_of(pressed)
        for light in [fit_light(pressed.where(~np.isin(pressed.press, group)), PLACE_PENALTIES[1])]
        for number in group
    }

    def find(number: int, changes: Planes, valid: Bools) -> Ball | None:
        ball, first = seen.balls[number], alone[number]
        if ball is None or first is None or number not in lights:
            return ball
        radius_px = shares[0] * first.contact_radius_px, shares[1] * first.contact_radius_px
        light = lights[number]
        found = refined_circle(changes, valid, ball, light=light, mm_per_px=mm_per_px, radius_px=radius_px)
        moved_px = np.hypot(*np.subtract(found.centre_px, first.centre_px))
        return found if moved_px < MAX_MOVE * first.contact_radius_px else first

    return find


def _left_out_error(seen: FoundBalls) -> float:
    pressed, resting = (
        samples.where(np.arange(len(samples.press)) % THINNED == 0)
        for samples in told_alike(*seen.every, min_balls=MIN_BALLS)
    )
    slopes, _ = held_out(
        InverseShading(PLACE_PENALTIES[1], SHARES[0]), pressed, untouched_samples=resting, ridge=DRAWN_RIDGE
    )
    return patch_error(slopes, pressed)


def check_count(usable: int, of: int, faults: Sequence[tuple[str, InputError]]) -> None:
    """Raise InputError for fewer than MIN_BALLS usable presses; each fault is told once, of its first picture."""
    if usable >= MIN_BALLS:
        return
    alike: dict[str, list[tuple[str, InputError]]] = {}
    for name, fault in faults:
        alike.setdefault(fault.remedy, []).append((name, fault))
    most = sorted(alike.values(), key=len, reverse=True)
    told = [
        (f"{len(some)} as " if len(some) > 1 else "")
        + f"{some[0][0]}: {some[0][1].what}"
        + (f" ({some[0][1].value})" if some[0][1].value is not None else "")
        for some in most
    ]
    raise InputError(
        f"too few ball presses that can be used; {MIN_BALLS} are the least",
        where="reference/ball",
        value=": ".join([f"{usable} of {of}", *(["; ".join(told)] if told else [])]),
        remedy=most[0][0][1].remedy if most else "Press the ball at more places, over the whole picture.",
    )


def locate(change: Planes, valid: Bools, *, picture: BallPicture, mm_per_px: Pair) -> Ball:
    """The ball of one picture by its relative change of colour (3, H, W), where it is `valid`, a mask (H, W)."""
    image = np.ascontiguousarray(change.transpose(1, 2, 0))
    return find_ball(
        image,
        mm_per_px,
        radius_mm=picture.radius_mm,
        centre_px=picture.centre_px,
        contact_radius_px=picture.contact_radius_px,
        usable=valid,
    )
