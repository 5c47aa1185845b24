"""Beyond the outermost balls: how fast the depth scale is lost with the distance from them.

    sigma(X, Y) = min(s d(X, Y), 1)
    s^2 = (m s_0^2 <d_i^2> + sum max(e_i^2 - f^2, 0)) / (m <d_i^2> + sum d_i^2)

d is the distance from the convex hull of the samples under the balls, X and Y from -1 to 1. The outer fifth of the
balls on each of four sides is left out, and read by a law of the others: e_i is how far the depth scale is off at
ball i, d_i how far that lies beyond the others, f how far balls of the fit are off. s_0 counts as m = PRIOR_BALLS.
None has a unit. Vanishes among the balls. Assumes that light goes on changing outside as it does at the sides.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball.samples import Samples
from tactilevision.records import Floats

OUTER_SHARE = 0.2  # of the balls, left out on each side; real_frames.md, beyond the outermost balls
PRIOR_RATE = 0.5  # of the scale for each half picture; eight sets have .3 to 1.4: real_frames.md
PRIOR_BALLS = 4  # balls that PRIOR_RATE is worth; 2 to 8 cover alike on nine sets
MAX_STD = 1.0  # of the scale: more says no more


def sides_of(contact: Samples) -> list[npt.NDArray[np.int64]]:
    """The numbers (balls,) of the outermost balls on the right, left, bottom and top, one array per side."""
    numbers = np.unique(contact.press)
    centres = np.array([contact.place[contact.press == number].mean(axis=0) for number in numbers])
    count = max(1, round(OUTER_SHARE * len(numbers)))
    return [numbers[np.argsort(sign * along)[-count:]] for along in centres.T for sign in (1, -1)]


def distance_beyond(places: Floats, at: Floats) -> Floats:
    """Distance (N,), in any unit, of points `at` (N, 2) from the convex hull of `places` (M, 2); 0 inside."""
    hull = cv2.convexHull(np.asarray(places, np.float32))
    inwards = [cv2.pointPolygonTest(hull, (float(x), float(y)), measureDist=True) for x, y in at]
    return np.asarray(np.maximum(0.0, -np.array(inwards)))


def growth_rate(errors: Floats, beyond: Floats, *, inside_std: float) -> float:
    """s: relative error of the depth scale for each half picture, of `errors` (n,) at distances `beyond` (n,).

    `inside_std` is how far balls of the fit are off. None has a unit.
    """
    square = beyond**2
    prior = PRIOR_BALLS * float(square.mean())
    if prior == 0.0:
        return PRIOR_RATE
    excess = float(np.maximum(errors**2 - inside_std**2, 0.0).sum())
    return float(np.sqrt((prior * PRIOR_RATE**2 + excess) / (prior + square.sum())))


def extrapolated_std(rate: float, beyond: Floats) -> Floats:
    """Deviation (n,) of the depth scale, relative, at distances `beyond` (n,) from the hull."""
    return np.asarray(np.minimum(rate * beyond, MAX_STD))
