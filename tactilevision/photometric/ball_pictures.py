"""Detect the balls of all pictures, and refine their circles with the shading law of the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.ball_detection import MAX_SLOPING_SHARE, Ball, ball_slopes, find_ball
from tactilevision.photometric.ball_samples import (
    CONTACT,
    RESTING,
    Samples,
    ball_samples,
    join,
    places_of,
    resting_samples,
    with_same_colours,
)
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.cross_validation import BallFit, groups_of
from tactilevision.photometric.markers import marked
from tactilevision.photometric.methods.polynomial import LAW_RIDGE, SHARES, InverseShading
from tactilevision.photometric.protocols import Progress, silent
from tactilevision.photometric.shading_law import PLACE_PENALTIES, answers_at, colours_by, fit_light
from tactilevision.records.measured import Bools, Bytes, Floats, Pair, Picture

# Refinement of circles by the shading law of the other balls.
#
# `find_ball` fits fifteen responses of colours to slope along with centre and contact radius. With the shading law
# fitted to other balls only these three remain unknown,
#
#     sum over colours and pixels of rho(u - u_law(p, q, X, Y))  ->  min          |r| < REACH contact radii
#
# with p, q the slopes of the ball, u the change of colour, rho quadratic near 0 and linear beyond SOFT. A third of
# the balls is held out of the law at a time. Centres of twelve path-traced balls: .69 px off (rms), .28 after two
# rounds. Balls at one place bias the law by an error that they share, so rounds go on until the circles stay. On
# four real sets the directions of slope of held-out balls improve by .1 to .8 degrees.

REACH = 1.15  # contact radii; best for rendered balls of 1 to 1.45, as further out gel differs from a half-space
SOFT = 0.05  # change of colour beyond which residuals count linearly: dust, highlights and marks
MAX_PIXELS = 1000  # of a ball; more only slow the fit down
MIN_PIXELS = 60  # of a ball; fewer determine no circle
MAX_MOVE = 0.25  # of the contact radius, from the centre found alone; a diverged fit had .33
RADIUS_CHANGE = 0.1  # of the contact radius found alone: real ones converge at .91 to .98
HELD_CHANGE = 0.005  # the same where the median reaches RADIUS_CHANGE less HELD_CHANGE
INWARDS = 1e-3  # px from the bounds at which the fit starts
MAX_STEPS = 15  # of the fit


def refined_circle(
    change: Picture, valid: Bools, ball: Ball, *, light: Floats, mm_per_px: Pair, radius_px: Pair
) -> Ball:
    """Return the `ball` with centre and contact radius fitted by the shading law `light`.

    `radius_px`: least and greatest contact radius. Relative `change` of colour (3, H, W), NaN where unknown;
    `valid`, a mask (H, W). With fewer than MIN_PIXELS the ball is returned unchanged.
    """
    from scipy.optimize import least_squares

    x, y = _pixels(valid, ball)
    if len(x) < MIN_PIXELS:
        return ball
    colours = np.asarray(change[:, y, x].T, np.float64)
    known = np.isfinite(colours)
    answers = answers_at(light, places_of(x, y, valid.shape))

    def misfit(unknown: Floats) -> Floats:
        p, q = ball_slopes(
            (x - ball.centre_px[0] - unknown[0]) * mm_per_px[0],
            (y - ball.centre_px[1] - unknown[1]) * mm_per_px[1],
            contact_mm=unknown[2] * mm_per_px[0],
            radius_mm=ball.radius_mm,
            pixel_mm=mm_per_px[0],
        )
        return np.asarray((colours_by(answers, np.stack([p, q], axis=1)) - colours)[known])

    move = 1.2 * MAX_MOVE * ball.contact_radius_px  # beyond MAX_MOVE, so that divergence is detected
    least, most = radius_px[0], min(radius_px[1], MAX_SLOPING_SHARE * ball.radius_mm / mm_per_px[0])
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
    """Return columns and rows (N,) of about MAX_PIXELS valid pixels at most within REACH of the ball's axis."""
    (x, y), reach = ball.centre_px, REACH * ball.contact_radius_px
    height, width = valid.shape
    top, left = max(0, int(y - reach)), max(0, int(x - reach))
    step = max(1, int(np.sqrt(np.pi * reach**2 / MAX_PIXELS)))
    rows, columns = np.mgrid[
        top : min(height, int(y + reach) + 1) : step, left : min(width, int(x + reach) + 1) : step
    ]
    take = (np.hypot(columns - x, rows - y) < reach) & valid[rows, columns]
    return columns[take], rows[take]


# Balls of all pictures, and samples under each and of the untouched gel around it.

MIN_BALLS = 3  # presses; a third is held out at a time, and no third may be empty
MIN_REFINED = 6  # balls whose light refines circles: a law of two or three follows their errors
REFINEMENTS = 6  # rounds at most; on a Mini each leaves .45 of a shift that all circles share
SETTLED_PX = 0.1  # px, median change of circles that ends the rounds
THINNED = 3  # every third sample decides whether circles are better


@dataclass(frozen=True, slots=True)
class BallPicture:
    """A rectified ball press (H, W, 3); the ball's radius; its centre and contact radius where known."""

    rgb: Bytes
    radius_mm: float
    centre_px: Pair | None = None
    contact_radius_px: float | None = None
    name: str = ""


def pressed_balls(
    pictures: Sequence[BallPicture], balls: Sequence[Ball | None], *, most: int | None = None
) -> list[tuple[Bytes, Ball]]:
    """Return the pictures (H, W, 3) in which a ball was found, with that ball; at most `most`, evenly chosen."""
    found = [(picture.rgb, ball) for picture, ball in zip(pictures, balls, strict=True) if ball is not None]
    return found if most is None else found[:: max(1, -(-len(found) // most))]


@dataclass(frozen=True, slots=True)
class FoundBalls:
    """The balls of all pictures, None where one was excluded, and samples under them and of untouched gel."""

    balls: tuple[Ball | None, ...]
    warnings: tuple[str, ...]
    every: tuple[Samples, Samples]

    @property
    def count(self) -> int:
        return sum(ball is not None for ball in self.balls)


Finder = Callable[[int, Picture, Bools], Ball | None]  # of the number of a picture, its changes and their validity


@dataclass(frozen=True, slots=True)
class BallSearch:
    """Search for the balls of all `pictures`; `rng` draws the samples."""

    change: ColourChange
    pictures: Sequence[BallPicture]
    mm_per_px: Pair
    rng: np.random.Generator
    progress: Progress = silent

    def alone_and_refined(self) -> tuple[tuple[Ball | None, ...], FoundBalls]:
        """Return each ball as found alone, and all as refined by the light of the others."""
        alone = self.collect()
        return alone.balls, self.refine(alone)

    def collect(self, find: Finder | None = None, what: str = "balls") -> FoundBalls:
        """Return the balls by `find`, or by `locate`; the progress says `what` is found.

        Raises InputError for too few, with the faults of the others.
        """
        balls, faults = list[Ball | None](), list[tuple[str, InputError]]()
        contact, resting = list[Samples](), list[Samples]()
        marks, scale, rng = self.change.reference.marks, self.mm_per_px, self.rng
        for number, picture in enumerate(self.pictures):
            self.progress(number, len(self.pictures), what)
            try:
                changes, _, valid = self.change.measure_known(picture.rgb)
                if marks is not None:
                    valid = valid & (marked(picture.rgb, marks) == 0)  # filled pixels are no samples
                if find is None:
                    ball: Ball | None = locate(changes, valid, picture=picture, mm_per_px=scale)
                else:
                    ball = find(number, changes, valid)
            except InputError as fault:
                faults.append((picture.name or f"ball {number + 1}", fault))
                ball = None
            balls.append(ball)
            if ball is None:
                continue
            for parts, draw, most in ((contact, ball_samples, CONTACT), (resting, resting_samples, RESTING)):
                few = max(100, most // len(self.pictures))
                parts.append(draw(changes, ball, mm_per_px=scale, number=number, most=few, valid=valid, rng=rng))
        check_count(len(contact), len(self.pictures), faults)
        warnings = tuple(f"{name} excluded: {fault.what}" for name, fault in faults)
        every = join(contact).with_noise(self.change.noise), join(resting).with_noise(self.change.noise)
        return FoundBalls(tuple(balls), warnings, every)

    def refine(self, alone: FoundBalls) -> FoundBalls:
        """Return the balls with circles refined by the light of the others, if held-out errors are smaller then.

        Where the median contact radius changes by nearly RADIUS_CHANGE from that found `alone`, radii are held.
        """
        if alone.count < MIN_REFINED:
            return alone
        for shares in ((1 - RADIUS_CHANGE, 1 + RADIUS_CHANGE), (1 - HELD_CHANGE, 1 + HELD_CHANGE)):
            seen = alone
            for turn in range(REFINEMENTS):
                last, find = seen, self._by_light(seen, alone.balls, shares)
                seen = self.collect(find, f"circles of balls, round {turn + 1} of at most {REFINEMENTS}")
                if _moved_px(seen.balls, last.balls) < SETTLED_PX:
                    break
            if shares[0] + HELD_CHANGE < _radius_change(seen.balls, alone.balls) < shares[1] - HELD_CHANGE:
                break
        return replace(seen, warnings=alone.warnings) if _held_out_error(seen) < _held_out_error(alone) else alone

    def _by_light(self, seen: FoundBalls, alone: Sequence[Ball | None], shares: Pair) -> Finder:
        pressed, scale = with_same_colours(*seen.every, min_balls=MIN_BALLS)[0], self.mm_per_px
        lights = {
            int(number): light
            for group in groups_of(pressed)
            for light in [fit_light(pressed.where(~np.isin(pressed.press, group)), PLACE_PENALTIES[1])]
            for number in group
        }

        def find(number: int, changes: Picture, valid: Bools) -> Ball | None:
            ball, first = seen.balls[number], alone[number]
            if ball is None or first is None or number not in lights:
                return ball
            radius_px = shares[0] * first.contact_radius_px, shares[1] * first.contact_radius_px
            light = lights[number]
            found = refined_circle(changes, valid, ball, light=light, mm_per_px=scale, radius_px=radius_px)
            moved_px = np.hypot(*np.subtract(found.centre_px, first.centre_px))
            return found if moved_px < MAX_MOVE * first.contact_radius_px else first

        return find


def _moved_px(balls: Sequence[Ball | None], before: Sequence[Ball | None]) -> float:
    """Return the median change of centres, or radii, from those `before`."""
    moved = [
        max(math.dist(one.centre_px, other.centre_px), abs(one.contact_radius_px - other.contact_radius_px))
        for one, other in zip(balls, before, strict=True)
        if one is not None and other is not None
    ]
    return float(np.median(moved)) if moved else 0.0


def _radius_change(balls: Sequence[Ball | None], alone: Sequence[Ball | None]) -> float:
    """Return the median contact radius over that of the ball found alone."""
    pairs = [
        (one, other) for one, other in zip(balls, alone, strict=True) if one is not None and other is not None
    ]
    return float(np.median([one.contact_radius_px / other.contact_radius_px for one, other in pairs]))


def _held_out_error(seen: FoundBalls) -> float:
    pressed, resting = (
        samples.where(np.arange(len(samples.press)) % THINNED == 0)
        for samples in with_same_colours(*seen.every, min_balls=MIN_BALLS)
    )
    return BallFit(InverseShading(PLACE_PENALTIES[1], SHARES[0]), LAW_RIDGE, pressed, resting).error


def check_count(usable: int, of: int, faults: Sequence[tuple[str, InputError]]) -> None:
    """Raise InputError for fewer than MIN_BALLS usable presses; each fault is reported once."""
    if usable >= MIN_BALLS:
        return
    alike: dict[str, list[tuple[str, InputError]]] = {}
    for name, fault in faults:
        alike.setdefault(fault.remedy, []).append((name, fault))
    most = sorted(alike.values(), key=len, reverse=True)
    reasons = [
        (f"{len(some)} as " if len(some) > 1 else "")
        + f"{some[0][0]}: {some[0][1].what}"
        + (f" ({some[0][1].value})" if some[0][1].value is not None else "")
        for some in most
    ]
    raise InputError(
        f"too few ball presses are usable; at least {MIN_BALLS} are needed",
        where="reference/ball",
        value=": ".join([f"{usable} of {of}", *(["; ".join(reasons)] if reasons else [])]),
        remedy=most[0][0][1].remedy if most else "Press the ball at more places, over the whole picture.",
    )


def locate(change: Picture, valid: Bools, *, picture: BallPicture, mm_per_px: Pair) -> Ball:
    """Return the ball of one picture by its relative `change` of colour (3, H, W) in the mask `valid` (H, W)."""
    image = np.ascontiguousarray(change.transpose(1, 2, 0))
    return find_ball(
        image,
        mm_per_px,
        radius_mm=picture.radius_mm,
        centre_px=picture.centre_px,
        contact_radius_px=picture.contact_radius_px,
        usable=valid,
    )
