"""The balls of all pictures: found one by one, then again by the light that the others tell.

Samples are drawn under each ball, and of the untouched gel beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.ball.cross_validation import groups_of, held_out, patch_error
from tactilevision.photometric.ball.detection import Ball, find_ball
from tactilevision.photometric.ball.refinement import HELD_SHARE, MAX_MOVE, RADIUS_SHARE, refined_circle
from tactilevision.photometric.ball.samples import (
    CONTACT,
    RESTING,
    Samples,
    ball_samples,
    join,
    resting_samples,
    told_alike,
    with_noise,
)
from tactilevision.photometric.ball.shading_fit import PLACE_PENALTIES, fit_light
from tactilevision.photometric.illumination.colour_change import ColourChange, Planes
from tactilevision.photometric.markers import marked
from tactilevision.photometric.methods.inverse_shading import DRAWN_RIDGE, SHARES, InverseShading
from tactilevision.records import Bools, Bytes, Pair

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
