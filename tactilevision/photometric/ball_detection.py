"""Detect a ball's contact in a picture: centre and contact radius to a fraction of a pixel.

Near one place the change of colour depends on the slope alone. The slopes of a half-space under a ball (Hertz; R
ball radius, a contact radius, r the distance from the axis) are

    dz/dr = -r / sqrt(R^2 - r^2)                                       r <= a   (the ball itself)
    dz/dr = -(2/pi) s_a [ (r/a) asin(a/r) - sqrt(1 - (a/r)^2) ]        r >  a,  s_a = a / sqrt(R^2 - a^2)

For a trial (centre, a) the change of each channel is fitted by a quadratic of the two slopes without a constant;
the sum of squared residuals is minimised over the three unknowns. No calibration is needed. A real gel layer
slopes less than the half-space far from the contact, so the window reaches WINDOW a only, and only the inside is
used afterwards. Source: Johnson, Contact Mechanics (1985), eqs. 3.42a, b.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Array, Bools, Floats, Pair

MAX_PIXELS = 1500  # of the window; more only slow the fit down
MAX_ITERATIONS = 40  # of the fit; one that has not converged is judged by its residual all the same
MIN_RADIUS_PX = 3  # five terms and three unknowns need some thirty pixels
MAX_RADIUS_SHARE = 0.9  # of the ball radius: a greater contact radius makes the slopes vertical
MAX_SLOPING_SHARE = 0.98  # of the ball radius: greatest contact radius at which a fit has finite slopes
MAX_GUESS_SHARE = 1.5  # of MAX_RADIUS_SHARE: a blob of change is up to 1.4 times as wide as the contact
MAX_GROWTH = 1.3  # of the blob or label, if the fit diverges: rendered contacts are .7 to 1.3 of their blob
STEP_TOL = 1e-5  # relative; 2e-3 left .05 px to the processor's rounding
WINDOW = 1.45  # contact radii: the circles of 16 rendered deep balls are .9 px off (rms), 1.1 px with 1.6
MAX_WINDOWS = 4  # fits, each in a window around the last circle
WINDOW_TOL = 0.02  # of the contact radius: change of the circle below which the window stays
MAX_RESIDUAL = 0.45  # of 259 real balls 258 leave at most .44; a fit to one bright side of a contact .46 and more
TOP_PERCENTILE = 99.8  # of the change: taken as that of the steepest slopes of a contact
SCALE_REMEDY = (
    "Is mm_per_px ten times too large, or pixels in a mm? It is mm in a pixel of the rectified frame. "
    "ball_radius_mm is in mm."
)
MIN_USABLE = 0.5  # of the window: with less, one whole side of the slopes is missing

Circle = tuple[float, float, float]  # centre x, y and contact radius, px


@dataclass(frozen=True, slots=True)
class Ball:
    """A ball's contact: `centre_px` (x, y), `contact_radius_px` along x, the ball's `radius_mm`.

    `residual`: unexplained part of the colour change (rms over rms, 0 to 1).
    """

    centre_px: Pair
    contact_radius_px: float
    radius_mm: float
    residual: float = 0.0


def ball_slopes(
    x_mm: Floats, y_mm: Floats, *, contact_mm: float, radius_mm: float, pixel_mm: float = 0.0
) -> tuple[Floats, Floats]:
    """Return slopes dz/dx, dz/dy of the gel under and around a ball, at places x, y (any shape) from its axis.

    At the edge of contact the slope falls as a square root, at an infinite rate. `pixel_mm` smooths this over
    about one pixel, as a picture does: a fit of the circle then has one minimum, not one at each pixel.
    """
    square = x_mm**2 + y_mm**2
    beyond = square / contact_mm**2 - 1.0
    if pixel_mm > 0:
        width = 0.5 * pixel_mm / contact_mm
        beyond = width * np.logaddexp(0.0, beyond / width)
    else:
        beyond = np.maximum(beyond, 0.0)
    covered = np.maximum(square - contact_mm**2 * beyond, 0.0)  # r^2 inside the contact, contact^2 outside
    share = beyond / (1.0 + beyond)  # 1 - (contact / r)^2 outside the contact
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
    usable: Bools | None = None,
) -> Ball:
    """Return the ball in `change` (H, W, 3), the drift-corrected relative colour change against untouched gel.

    `usable` is a mask (H, W); unknown changes are NaN. The fit starts from `centre_px`, `contact_radius_px` where
    given, else from the largest blob of change. If it diverges, the radius is limited to MAX_GROWTH times the
    start. If the residual exceeds MAX_RESIDUAL, a second fit scales all colours to equal size, and the better one
    is kept. Raises InputError where there is no contact, or none that a ball of `radius_mm` could make.
    """
    most_px, search = MAX_RADIUS_SHARE * radius_mm / mm_per_px[0], _Search(change, mm_per_px, radius_mm, usable)

    def refined(guess: Circle) -> Ball:
        (x, y), radius = centre_px or guess[:2], contact_radius_px or guess[2]
        search.check_size(radius)
        start = x, y, min(radius, most_px)
        ball = search.fit(start)
        if ball.contact_radius_px > most_px:
            ball = search.fit(start, min(most_px, MAX_GROWTH * start[2]))
        return ball

    ball = refined(first_guess(change, usable))
    if ball.residual > MAX_RESIDUAL and (centre_px is None or contact_radius_px is None):
        top = np.nanpercentile(
            np.abs(change.reshape(-1, 3) if usable is None else change[usable]), TOP_PERCENTILE, axis=0
        )
        with suppress(InputError):
            equalised = refined(first_guess(np.asarray(change / np.maximum(top, TINY), np.float32), usable))
            ball = min(ball, equalised, key=lambda fit: fit.residual)
    return ball


def first_guess(change: Array, usable: Bools | None = None, *, hull: bool = False) -> Circle:
    """Return centre x, y and radius (px) of the largest blob of `change` (H, W, 3) above the noise.

    `hull`: of the blob's convex hull. A flat punch changes only a ring, of less area than the contact.
    """
    from skimage.measure import label, regionprops

    blurred = cv2.GaussianBlur(np.nan_to_num(change), (0, 0), 1.5)
    size = np.asarray(np.sqrt(np.mean(np.square(blurred), axis=2)))
    if usable is not None:
        size = np.where(usable, size, 0.0)
    typical = float(np.median(size))
    top = float(np.percentile(size, TOP_PERCENTILE))
    if not top > 6 * typical:
        raise InputError(
            "no contact exceeds the noise",
            where="ball press",
            value=round(top / max(typical, TINY), 1),
            remedy="Leave the frame out of reference/ball, or press deeper.",
        )
    blob = (size > max(0.35 * top, 4 * typical)).astype(np.uint8)
    blob = cv2.morphologyEx(blob, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    best = max(regionprops(label(blob)), key=lambda region: region.area)
    if hull:
        moments = cv2.moments(cv2.convexHull(best.coords[:, ::-1].astype(np.int32)))
        area = max(moments["m00"], 1.0)
        return moments["m10"] / area, moments["m01"] / area, float(np.sqrt(area / np.pi))
    y, x = best.centroid
    return float(x), float(y), float(np.sqrt(best.area / np.pi))


@dataclass(frozen=True, slots=True)
class _Search:
    """Search for the contact of a ball of `radius_mm` in `change` (H, W, 3), in the mask `usable` (H, W)."""

    change: Array
    mm_per_px: Pair
    radius_mm: float
    usable: Bools | None

    def check_size(self, contact_px: float) -> None:
        """Raise InputError where the ball cannot make a contact of radius `contact_px`."""
        ball_px = self.radius_mm / self.mm_per_px[0]
        stated = f"ball_radius_mm = {self.radius_mm:g}, mm_per_px = {self.mm_per_px[0]:.3g}"
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

    def fit(self, start: Circle, most_px: float = np.inf) -> Ball:
        """Fit centre and contact radius, at most `most_px`, in a window that follows the circle until it stays.

        A wide window shows gel that slopes as no half-space does, and enlarges the circle.
        """
        for _ in range(MAX_WINDOWS):
            ball = self._fit_in_window(start, most_px)
            moved = np.hypot(*np.subtract(ball.centre_px, start[:2])), ball.contact_radius_px - start[2]
            if np.abs(moved).max() < WINDOW_TOL * start[2]:
                break
            start = (*ball.centre_px, ball.contact_radius_px)
        return ball

    def _fit_in_window(self, start: Circle, most_px: float) -> Ball:
        """Fit centre and contact radius by damped Gauss-Newton steps."""
        changes, x_mm, y_mm = self._window(start)
        radius_mm, pixel_mm, contact_mm = self.radius_mm, self.mm_per_px[0], start[2] * self.mm_per_px[0]
        lowest = np.array([-contact_mm, -contact_mm, 0.3 * contact_mm])
        highest = np.array([contact_mm, contact_mm, min(MAX_SLOPING_SHARE * radius_mm, most_px * pixel_mm)])

        def misfit(unknown: Floats) -> Floats:
            x, y, contact = x_mm - unknown[0], y_mm - unknown[1], unknown[2]
            slopes = ball_slopes(x, y, contact_mm=contact, radius_mm=radius_mm, pixel_mm=pixel_mm)
            return _unexplained(changes, *slopes)

        unknown = np.array([0.0, 0.0, min(contact_mm, MAX_RADIUS_SHARE * highest[2])])
        residual, damping, step = misfit(unknown), 1e-3, 1e-3 * contact_mm
        for _ in range(MAX_ITERATIONS):
            slope = np.stack([(misfit(unknown + step * axis) - residual) / step for axis in np.eye(3)], axis=-1)
            normal = slope.T @ slope
            if not normal.any():
                raise InputError(
                    "no colour that is known changes with the slopes of a ball",
                    where="ball press",
                    value=f"a contact at ({start[0]:.0f}, {start[1]:.0f}) px",
                    remedy="Leave the frame out of reference/ball, or check its place in ball.csv.",
                )
            held = damping * np.maximum(np.diag(normal), TINY)
            move = -np.linalg.solve(normal + np.diag(held), slope.T @ residual)
            trial = np.clip(unknown + move, lowest, highest)
            after = misfit(trial)
            if after @ after < residual @ residual:
                unknown, residual, damping = trial, after, 0.3 * damping
                if np.abs(move).max() < STEP_TOL * contact_mm:
                    break
            else:
                damping *= 10
        centre = (start[0] + unknown[0] / pixel_mm, start[1] + unknown[1] / self.mm_per_px[1])
        share = np.sqrt(np.mean(residual**2) / np.mean(np.nan_to_num(changes) ** 2))
        return Ball((float(centre[0]), float(centre[1])), float(unknown[2] / pixel_mm), radius_mm, float(share))

    def _window(self, start: Circle) -> tuple[Floats, Floats, Floats]:
        """Return changes (N, 3) and places x, y (N,) from the start in mm, of pixels within WINDOW radii."""
        (height, width), (x_scale, y_scale) = self.change.shape[:2], self.mm_per_px
        reach = WINDOW * start[2]
        reach_y = reach * x_scale / y_scale
        step = max(1, int(np.sqrt(np.pi * reach * reach_y / MAX_PIXELS)))
        rows = np.arange(max(0, int(start[1] - reach_y)), min(height, int(start[1] + reach_y) + 1), step)
        columns = np.arange(max(0, int(start[0] - reach)), min(width, int(start[0] + reach) + 1), step)
        y, x = np.meshgrid((rows - start[1]) * y_scale, (columns - start[0]) * x_scale, indexing="ij")
        take = np.hypot(x, y) <= reach * x_scale
        if self.usable is not None:
            pixels, take = int(take.sum()), take & self.usable[np.ix_(rows, columns)]
            if take.sum() < MIN_USABLE * pixels:
                raise InputError(
                    "the ball was pressed where the light is saturated or too dark",
                    where="ball press",
                    value=f"{100 * take.sum() / max(pixels, 1):.0f} % of its place is usable",
                    remedy="Press it elsewhere, or dim the light.",
                )
        return np.asarray(self.change[np.ix_(rows, columns)][take], np.float64), x[take], y[take]


def _unexplained(changes: Floats, p: Floats, q: Floats) -> Floats:
    """Return residuals (3 N,) of changes (N, 3) from a quadratic of the slopes; 0 where a change is unknown."""
    terms = np.stack([p, q, p * p, p * q, q * q], axis=1)
    if not (known := np.isfinite(changes)).all():
        residual = np.zeros(changes.shape)
        for c, at in enumerate(known.T):
            if at.any():
                residual[at, c] = _unexplained(changes[at, c, None], p[at], q[at])
        return residual.ravel()
    normal = terms.T @ terms
    normal[np.diag_indices(5)] += TINY * np.trace(normal)
    return np.asarray((changes - terms @ np.linalg.solve(normal, terms.T @ changes)).ravel())
