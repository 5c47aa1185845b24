"""The circles of balls found anew, by what the other balls say of the light.

A ball alone is found without knowing the light (`detection.py`): fifteen answers of colours to slope are fitted
beside its centre and contact radius. A light's law that was fitted to other balls (`shading_fit.py`) leaves these
three alone to be found,

    sum over colours and pixels of rho(u - u_law(p, q, X, Y))  ->  least        |r| < REACH contact radii

with p, q the ball's slopes, u the change of colour, rho square near 0 and linear beyond SOFT. A third of the balls
is left out of the law at a time, so that no ball draws the law to its own circle. Twelve balls of a path tracer:
centres were .69 px off (rms), after two rounds .28. Balls at one place show a light that shares their circles'
shift, so rounds go on until circles stay (`found_balls.py`). On four real sets slopes of balls left out point .1
to .8 degrees better. Assumes that most circles are nearly right to begin with.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball.detection import Ball, ball_slopes
from tactilevision.photometric.ball.shading_fit import answers_at, colours_by
from tactilevision.photometric.illumination.colour_change import Planes
from tactilevision.records import Bools, Floats, Pair

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
