"""A ball's circle by the light that other balls told: planted circles are found from a start that is off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from each import each

from tactilevision.photometric.ball_detection import Ball, ball_slopes
from tactilevision.photometric.ball_pictures import BallPicture, BallSearch, refined_circle
from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.shading_law import answers_at, colours_by, colours_of, fit_light
from tactilevision.records.measured import Bytes, Floats

SHAPE, SCALE, RADIUS_MM = (120, 160), (0.06, 0.06), 4.0
TOWARD = np.array([[0.9, 0.1], [-0.5, 0.8], [-0.4, -0.9]])  # of the lamps, as slopes they light best
GREY = 110
TRUE = Ball((83.4, 57.7), 28.0, RADIUS_MM)


def matt(slopes: Floats) -> Floats:
    """Changes of colour (N, 3) of a matt surface under three far lamps."""
    return np.asarray((1.0 + slopes @ TOWARD.T) / np.sqrt(1.0 + np.sum(slopes**2, axis=1))[:, None] - 1.0)


def light() -> Floats:
    rng = np.random.default_rng(0)
    slopes, place = rng.uniform(-0.5, 0.5, (4000, 2)), rng.uniform(-1.0, 1.0, (4000, 2))
    return fit_light(Samples(matt(slopes), place, slopes, np.zeros(4000, np.int64)))


def picture(
    noise: float, ball: Ball = TRUE, lit: Callable[[Floats], Floats] = matt
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    p, q = ball_slopes(
        (x - ball.centre_px[0]) * SCALE[0],
        (y - ball.centre_px[1]) * SCALE[1],
        contact_mm=ball.contact_radius_px * SCALE[0],
        radius_mm=RADIUS_MM,
    )
    change = lit(np.stack([p.ravel(), q.ravel()], axis=1)).T.reshape(3, *SHAPE)
    return (change + noise * np.random.default_rng(1).standard_normal(change.shape)).astype(np.float32)


def frame(change: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> Bytes:
    """The picture (H, W, 3) of changes (3, H, W)."""
    return np.ascontiguousarray(np.rint(GREY * (1.0 + change)).astype(np.uint8).transpose(1, 2, 0))


@each("start", [(2.0, -1.5, 2.5), (-3.0, 2.0, -2.0)])
@each("lost", [False, True])
def test_a_circle_that_is_off_is_found(start: tuple[float, float, float], lost: bool) -> None:
    change = picture(0.03)
    if lost:
        change[2, :, :80] = np.nan  # blue overexposed on the left
    off = Ball(
        (TRUE.centre_px[0] + start[0], TRUE.centre_px[1] + start[1]), TRUE.contact_radius_px + start[2], RADIUS_MM
    )
    found = refined_circle(
        change, np.ones(SHAPE, np.bool_), off, light=light(), mm_per_px=SCALE, radius_px=(22.0, 34.0)
    )
    assert np.hypot(*np.subtract(found.centre_px, TRUE.centre_px)) < 0.25
    assert found.contact_radius_px == pytest.approx(TRUE.contact_radius_px, abs=0.7)


def test_the_radius_is_held_within_its_bounds() -> None:
    found = refined_circle(
        picture(0.01), np.ones(SHAPE, np.bool_), TRUE, light=light(), mm_per_px=SCALE, radius_px=(30.0, 34.0)
    )
    assert 30.0 <= found.contact_radius_px < 30.2


def test_a_ball_that_too_few_pixels_tell_stays() -> None:
    valid = np.zeros(SHAPE, np.bool_)
    valid[55:60, 80:85] = True
    assert (
        refined_circle(picture(0.0), valid, TRUE, light=light(), mm_per_px=SCALE, radius_px=(20.0, 30.0)) is TRUE
    )


def test_colours_by_answers_are_the_laws() -> None:
    rng = np.random.default_rng(2)
    slopes, place, law = rng.uniform(-0.6, 0.6, (50, 2)), rng.uniform(-1.0, 1.0, (50, 2)), light()
    np.testing.assert_allclose(colours_by(answers_at(law, place), slopes), colours_of(law, slopes, place=place))


def hard(slopes: Floats) -> Floats:
    """As `matt`, of lamps so low that their light is soon all there, or gone."""
    return np.asarray(0.35 * np.tanh(10.0 * slopes @ TOWARD.T))


def test_a_shift_that_all_balls_share_is_lost() -> None:
    """Balls at one place show a light that shares their shift, and lose it round by round."""
    true = [Ball((80.0 + k % 3, 60.0 - k % 2), 20.0 + 0.7 * k, RADIUS_MM) for k in range(6)]
    shifted = [replace(one, centre_px=(one.centre_px[0] + 3.0, one.centre_px[1] - 2.5)) for one in true]
    change = ColourChange(make_reference([np.full((*SHAPE, 3), GREY, np.uint8)]))
    pictures = [BallPicture(frame(picture(0.02, one, hard)), RADIUS_MM) for one in true]
    search = BallSearch(change, pictures, SCALE, np.random.default_rng(0))
    seen = search.refine(search.collect(lambda number, *_: shifted[number])).balls
    off = [np.subtract(ball.centre_px, one.centre_px) for ball, one in zip(seen, true, strict=True) if ball]
    assert len(off) == len(true)
    assert np.abs(np.mean(off, axis=0)).max() < 0.4  # px; two rounds leave .8
