"""The polynomial by way of the light: how colours answer to slope is fitted, and slope read out of that.

    (1 + u_c) sqrt(1 + p^2 + q^2) - 1 = sum_ij L_cij(X, Y) p^i q^j        1 <= i + j <= 4

A matt surface under one far light makes the left side a plane through 0; the higher terms are shine, shadow and
several lights in one channel. L is a polynomial in place, of order 3, 1, 1, 0 for i + j = 1, 2, 3, 4, since near
lights turn over the picture. Slopes of balls are known and colours noisy, so this is the well-posed direction: a
few balls fix it where a polynomial of slope in colours has too much freedom, and noise pulls nothing down. The law
is then drawn all over slopes and places, and `Polynomial` fitted to the balls and, with a share of the weight, to
what was drawn: the law says how light goes on between the balls, the balls what the law leaves out. Frames are
read as fast as before.

On five simulated sensors with 8 or 14 balls the depth of balls left out is off by 7 9 13 16 30 um, with the direct
fit alone by 19 14 15 27 38. Lamps as near as the pad is wide need the third order: among 14 balls slopes are off
by 1.8 % (rms over places and directions, mean of nine drawn lights), with the second by 2.2. Real light may obey
no such law: balls left out decide which is used, one recording at a time (`AutoMethod`; so do `depth`, `force` and
`view`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactilevision.photometric.ball_samples import KEPT, Samples
from tactilevision.photometric.methods.polynomial import Polynomial, fit_fourth_order, fit_polynomial
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.photometric.shading_law import PLACE_PENALTIES, colours_of, fit_light
from tactilevision.records.measured import Floats

RIDGES = (1e-4, 1e-3, 1e-2, 1e-1)  # of the direct fit
SHARES = (0.1, 0.5)  # of the weight on the drawn law; balls held out choose
DRAWN = 8000  # samples of the law, about as many as of the balls (CONTACT); more only slow the fit down
MAX_SLOPE_SHARE = 1.1  # of the steepest slope seen
DRAWN_RIDGE = 1e-6  # ridge of the polynomial through the drawn samples, which leave nothing open


@dataclass(frozen=True)
class InverseShading:
    """A Fitter of the polynomial that undoes the light's law.

    `uneven` penalises the law's change over the picture; `share` of the weight is on what the law says, the rest
    on the balls themselves.
    """

    uneven: float
    share: float

    ridges = (DRAWN_RIDGE,)

    @property
    def __name__(self) -> str:
        return f"through_light: uneven {self.uneven:g}, share {self.share:g}"

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> Polynomial:
        drawn = _drawn(contact, self.uneven)
        return fit_polynomial(contact, untouched_samples, ridge=ridge, drawn=drawn, share=self.share)


class AutoMethod:
    """A Fitter: slopes of colours, to third or fourth order, or colours of slopes.

    It is whichever tells balls that it never saw best.
    """

    ways = (
        *((fit, ridge) for fit in (fit_polynomial, fit_fourth_order) for ridge in RIDGES),
        *((InverseShading(uneven, share), DRAWN_RIDGE) for uneven in PLACE_PENALTIES for share in SHARES),
    )

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> ColourLaw:
        return fit_polynomial(contact, untouched_samples, ridge=ridge)


@lru_cache(maxsize=KEPT)
def _drawn(contact: Samples, uneven: float) -> Samples:
    """Samples of the law that tells `contact`, spread evenly over slopes and places."""
    law = fit_light(contact, uneven)
    even = _evenly(DRAWN, 4)
    steep = MAX_SLOPE_SHARE * np.hypot(*contact.slopes.T).max() * even[:, 0] ** 0.75
    angle, place = 2 * np.pi * even[:, 1], 2.0 * even[:, 2:4] - 1.0
    slopes = np.stack([steep * np.cos(angle), steep * np.sin(angle)], axis=1)
    return Samples(colours_of(law, slopes, place=place), place, slopes, np.zeros(DRAWN, np.int64))


def _evenly(count: int, dimensions: int) -> Floats:
    """Places (count, dimensions) in the unit cube, evener than random: Roberts' sequence, x^(d+1) = x + 1."""
    root = 1.5
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
