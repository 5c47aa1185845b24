"""Detect a ball's contact in a picture: centre and contact radius to a fraction of a pixel.

The change of colour against the untouched gel depends, near one place, on the slope alone. So the slopes of a
ball pressed into a half-space (Hertz; R ball radius, a contact radius, r the distance from the axis),

    dz/dr = -r / sqrt(R^2 - r^2)                                       r <= a   (the ball itself)
    dz/dr = -(2/pi) s_a [ (r/a) asin(a/r) - sqrt(1 - (a/r)^2) ]        r >  a,  s_a = a / sqrt(R^2 - a^2)

are drawn for a trial (centre, a), each channel's change is fitted by a quadratic of the two slopes (no constant:
no slope, no change), and what is left over is made least in the three unknowns. No calibration is needed
before, and no threshold decides where the circle ends. Outside the contact a real gel layer slopes less far out
than the half-space; the window reaches WINDOW a only, and what is used afterwards is the inside.
Source: Johnson, Contact Mechanics (1985), eqs. 3.42a, b.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records.measured import Floats, Pair

Array = npt.NDArray[np.floating[Any]]
MAX_PIXELS = 1500  # of the window; more only slow the fit down
MAX_ITERATIONS = 40  # steps of the fit; one that has not settled by then is judged by its residual all the same
MIN_RADIUS_PX = 3.0  # five terms and three unknowns need some thirty pixels
MAX_RADIUS_SHARE = 0.9  # of the ball: no gel is pressed so deep, its slopes would go upright
MAX_GUESS_SHARE = 1.5  # of that: blobs of change are up to 1.4 times as wide as the contact
MAX_GROWTH = 1.3  # of the blob or label, where the fit ran away: rendered contacts are .7 to 1.3 of their blob
STEP_TOL = 1e-5  # of the contact radius, the last step; 2e-3 left .05 px to the processor's rounding
WINDOW = 1.45  # contact radii; of 16 rendered deep balls 1.6 has the circle 1.1 px off (rms), 1.45 .9
MAX_WINDOWS = 4  # fits, each in a window round the last one's circle
WINDOW_TOL = 0.02  # of the contact radius: a circle that moves by less stays
# residual: a ball on the brightest side of a contact alone leaves .46 and more, 258 of 259 others .44 at most
MAX_RESIDUAL = 0.45
TOP_PERCENTILE = 99.8  # percentile of change that stands for the steepest slopes of a contact
SCALE_REMEDY = (
    "Is mm_per_px ten times too large, or pixels in a mm? It is mm in a pixel of the rectified frame. "
    "ball_radius_mm is in mm."
)
MIN_SEEN = 0.5  # of a ball's place that must be usable: less leaves out one whole side of its slopes


@dataclass(frozen=True, slots=True)
class Ball:
    """A ball's contact: `centre_px` (x, y), `contact_radius_px` along x, the ball's `radius_mm`.

    `residual` is the part of the colour change that no slope of a ball explains (rms over rms, 0 to 1).
    """

    centre_px: Pair
    contact_radius_px: float
    radius_mm: float
    residual: float = 0.0


def ball_slopes(
    x_mm: Floats, y_mm: Floats, *, contact_mm: float, radius_mm: float, pixel_mm: float = 0.0
) -> tuple[Floats, Floats]:
    """Slopes (dz/dx, dz/dy) of the gel under and beside a ball, at places (mm) from its axis, any shape alike.

    At the edge of contact the slope falls as a square root, without limit in its rate. `pixel_mm` rounds that off
    over about a pixel, as a picture does: a fit of the circle then has one minimum, not one at each pixel.
    """
    square = x_mm**2 + y_mm**2
    beyond = square / contact_mm**2 - 1.0
    if pixel_mm > 0:
        width = 0.5 * pixel_mm / contact_mm
        beyond = width * np.logaddexp(0.0, beyond / width)
    else:
        beyond = np.maximum(beyond, 0.0)
    covered = np.maximum(square - contact_mm**2 * beyond, 0.0)  # r^2 under the ball, contact^2 beside it
    share = beyond / (1.0 + beyond)  # 1 - (contact / r)^2 beside the ball
    per_r = np.arcsin(np.sqrt(1.0 - share)) - np.sqrt((1.0 - share) * share)
    per_r *= -2.0 / np.pi / np.sqrt(radius_mm**2 - covered)
    return per_r * x_mm, per_r * y_mm


def find_ball(
    change: Array,
    mm_per_px: Pair,
    *,
    radius_mm: float,
    centre_px: Pair | None = None,
    contact_radius_px: float | None = None,
    usable: npt.NDArray[np.bool_] | None = None,
) -> Ball:
    """The ball in `change` (H, W, 3), the relative change of colour against untouched gel without its drift.

    `usable` is a mask (H, W); a change of a colour that is not known is NaN. `centre_px`, `contact_radius_px` are
    a start where they are known; the largest blob of change otherwise. A fit that runs away is held to what the
    picture shows, the blob or the label, and a little more. Where its residual exceeds MAX_RESIDUAL, the ball is
    looked for with all colours made equal, too, and the better one kept. Raises InputError where there is no
    contact, or none that a ball of `radius_mm`
    could make.
    """
    most_px = MAX_RADIUS_SHARE * radius_mm / mm_per_px[0]

    def refined(guess: tuple[float, float, float]) -> Ball:
        (x, y), radius = centre_px or guess[:2], contact_radius_px or guess[2]
        _check_size(
            radius,
            radius_mm / mm_per_px[0],
            stated=f"ball_radius_mm = {radius_mm:g}, mm_per_px = {mm_per_px[0]:.3g}",
        )
        start = x, y, min(radius, most_px)
        ball = _settled(change, mm_per_px, radius_mm=radius_mm, start=start, most_px=np.inf, usable=usable)
        if ball.contact_radius_px <= most_px:
            return ball
        shown_px = min(most_px, MAX_GROWTH * start[2])  # the picture shows a smaller one: what ran away is the fit
        return _settled(change, mm_per_px, radius_mm=radius_mm, start=start, most_px=shown_px, usable=usable)

    ball = refined(first_guess(change, usable))
    if ball.residual > MAX_RESIDUAL and (centre_px is None or contact_radius_px is None):
        top = np.nanpercentile(
            np.abs(change.reshape(-1, 3) if usable is None else change[usable]), TOP_PERCENTILE, axis=0
        )
        with suppress(InputError):
            equalised = refined(first_guess(np.asarray(change / np.maximum(top, 1e-6), np.float32), usable))
            ball = min(ball, equalised, key=lambda one: one.residual)
    return ball


def _check_size(contact_px: float, ball_px: float, *, stated: str) -> None:
    """Raise InputError where a contact, its radius in px, is none of a ball of `ball_px`, or cannot be read."""
    most_px = MAX_RADIUS_SHARE * ball_px
    remedy = "ball_radius_mm is in mm, contact_radius_px in pixels of the rectified frame."
    if most_px < MIN_RADIUS_PX:
        what = f"a ball of {ball_px:.2g} px in radius is too small to be read"
        remedy = SCALE_REMEDY
    elif contact_px < MIN_RADIUS_PX:
        what = f"a contact of {contact_px:.2g} px in radius is too small to be read"
    elif contact_px > MAX_GUESS_SHARE * most_px:
        what, remedy = "the contact is as wide as the whole ball", SCALE_REMEDY
        stated = f"{contact_px:.0f} px in radius, the ball {ball_px:.2g} px by {stated}"
    else:
        return
    raise InputError(what, where="ball press", value=stated, remedy=remedy)


def first_guess(change: Array, usable: npt.NDArray[np.bool_] | None = None) -> tuple[float, float, float]:
    """Centre x, y and radius (px) of the largest blob of `change` (H, W, 3) that stands out of the noise."""
    seen = np.nan_to_num(change)
    size = np.asarray(np.sqrt(np.mean(np.square(cv2.GaussianBlur(seen, (0, 0), 1.5)), axis=2)))
    if usable is not None:
        size = np.where(usable, size, 0.0)
    typical = float(np.median(size))
    top = float(np.percentile(size, TOP_PERCENTILE))
    if not top > 6.0 * typical:
        raise InputError(
            "no contact stands out of the noise",
            where="ball press",
            value=round(top / max(typical, 1e-12), 1),
            remedy="Leave the frame out of reference/ball, or press deeper.",
        )
    blob = (size > max(0.35 * top, 4.0 * typical)).astype(np.uint8)
    blob = cv2.morphologyEx(blob, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    _, _, stats, centres = cv2.connectedComponentsWithStats(blob)
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    area = float(stats[best, cv2.CC_STAT_AREA])
    return float(centres[best][0]), float(centres[best][1]), float(np.sqrt(area / np.pi))


def _settled(
    change: Array,
    mm_per_px: Pair,
    *,
    radius_mm: float,
    start: tuple[float, float, float],
    most_px: float,
    usable: npt.NDArray[np.bool_] | None,
) -> Ball:
    """The fit, in a window that is laid round its own last circle until that stays.

    A wide window shows gel that slopes as no half-space does, and draws the circle out.
    """
    for _ in range(MAX_WINDOWS):
        ball = _refined(change, mm_per_px, radius_mm=radius_mm, start=start, most_px=most_px, usable=usable)
        moved = np.hypot(*np.subtract(ball.centre_px, start[:2])), ball.contact_radius_px - start[2]
        if np.abs(moved).max() < WINDOW_TOL * start[2]:
            break
        start = (*ball.centre_px, ball.contact_radius_px)
    return ball


def _refined(
    change: Array,
    mm_per_px: Pair,
    *,
    radius_mm: float,
    start: tuple[float, float, float],
    most_px: float,
    usable: npt.NDArray[np.bool_] | None,
) -> Ball:
    """Damped Gauss-Newton on centre and contact radius."""
    changes, x_mm, y_mm = _window(change, mm_per_px, start, usable)
    contact_mm = start[2] * mm_per_px[0]
    lowest = np.array([-contact_mm, -contact_mm, 0.3 * contact_mm])
    highest = np.array([contact_mm, contact_mm, min(0.98 * radius_mm, most_px * mm_per_px[0])])

    def misfit(unknown: Floats) -> Floats:
        p, q = ball_slopes(
            x_mm - unknown[0],
            y_mm - unknown[1],
            contact_mm=unknown[2],
            radius_mm=radius_mm,
            pixel_mm=mm_per_px[0],
        )
        return _unexplained(changes, p, q)

    unknown = np.array([0.0, 0.0, min(contact_mm, 0.9 * highest[2])])
    residual, damping, step = misfit(unknown), 1e-3, 1e-3 * contact_mm
    for _ in range(MAX_ITERATIONS):
        slope = np.stack([(misfit(unknown + step * axis) - residual) / step for axis in np.eye(3)], axis=-1)
        normal = slope.T @ slope
        move = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope.T @ residual)
        trial = np.clip(unknown + move, lowest, highest)
        after = misfit(trial)
        if after @ after < residual @ residual:
            unknown, residual, damping = trial, after, 0.3 * damping
            if np.abs(move).max() < STEP_TOL * contact_mm:
                break
        else:
            damping *= 10.0
    centre = (start[0] + unknown[0] / mm_per_px[0], start[1] + unknown[1] / mm_per_px[1])
    share = np.sqrt(np.mean(residual**2) / np.mean(np.nan_to_num(changes) ** 2))
    return Ball((float(centre[0]), float(centre[1])), float(unknown[2] / mm_per_px[0]), radius_mm, float(share))


def _window(
    change: Array, mm_per_px: Pair, start: tuple[float, float, float], usable: npt.NDArray[np.bool_] | None
) -> tuple[Floats, Floats, Floats]:
    """Changes (N, 3) and places from the first centre (N,) in mm, of the pixels within WINDOW radii."""
    height, width = change.shape[:2]
    reach = WINDOW * start[2]
    reach_y = reach * mm_per_px[0] / mm_per_px[1]
    step = max(1, int(np.sqrt(np.pi * reach * reach_y / MAX_PIXELS)))
    rows = np.arange(max(0, int(start[1] - reach_y)), min(height, int(start[1] + reach_y) + 1), step)
    columns = np.arange(max(0, int(start[0] - reach)), min(width, int(start[0] + reach) + 1), step)
    y, x = np.meshgrid((rows - start[1]) * mm_per_px[1], (columns - start[0]) * mm_per_px[0], indexing="ij")
    take = np.hypot(x, y) <= reach * mm_per_px[0]
    if usable is not None:
        pixels, take = int(take.sum()), take & usable[np.ix_(rows, columns)]
        if take.sum() < MIN_SEEN * pixels:
            raise InputError(
                "the ball was pressed where the light is saturated or too dark",
                where="ball press",
                value=f"{100 * take.sum() / max(pixels, 1):.0f} % of its place can be used",
                remedy="Press it elsewhere, or dim the light.",
            )
    return np.asarray(change[np.ix_(rows, columns)][take], np.float64), x[take], y[take]


def _unexplained(changes: Floats, p: Floats, q: Floats) -> Floats:
    """What a quadratic of the slopes leaves of the changes (N, 3), flat (3 N,); nothing of those not known."""
    terms = np.stack([p, q, p * p, p * q, q * q], axis=1)
    if not np.isfinite(changes).all():
        known = np.isfinite(changes)
        parts = [
            _unexplained(change[at, None], p[at], q[at])
            for change, at in zip(changes.T, known.T, strict=True)
            if at.any()
        ]
        left = np.zeros(changes.shape)
        left.T[known.T] = np.concatenate(parts)
        return left.ravel()
    normal = terms.T @ terms
    normal[np.diag_indices(5)] += 1e-9 * np.trace(normal)
    return np.asarray((changes - terms @ np.linalg.solve(normal, terms.T @ changes)).ravel())
