"""Polynomial regularised by the shading law.

    (1 + u_c) sqrt(1 + p^2 + q^2) - 1 = sum_ij L_cij(X, Y) p^i q^j        1 <= i + j <= 4

A matt surface under one far light makes the left side a plane through 0; higher terms are highlights, shadows and
several lights in one channel. Fitting colours to the known slopes of balls is well-posed where a polynomial of
slope in noisy colours has too much freedom. The law is then sampled over all slopes and places, and `Polynomial`
is fitted to the balls and, with a share of the weight, to these samples.

On five simulated sensors with 8 or 14 balls the depth of held-out balls is off by 7 9 13 16 30 um, with the direct
fit by 19 14 15 27 38. As real light may deviate from the law, held-out balls choose the fit (`AutoMethod`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactilevision.photometric.ball_samples import KEPT, Samples
from tactilevision.photometric.methods.polynomial import RIDGES, Polynomial, fit_fourth_order, fit_polynomial
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.photometric.shading_law import PLACE_PENALTIES, colours_of, fit_light
from tactilevision.records.measured import Floats

SHARES = (0.1, 0.5)  # of the weight on the shading law; held-out balls choose
LAW_SAMPLES = 8000  # of the law, about as many as of the balls (CONTACT)
MAX_SLOPE_SHARE = 1.1  # of the steepest slope of the balls
LAW_RIDGE = 1e-6  # of the polynomial through samples of the law, which cover all slopes and places


@dataclass(frozen=True)
class InverseShading:
    """Fitter of a polynomial to balls and to samples of the shading law, which have `share` of the weight.

    `uneven` penalises the change of the law over the picture.
    """

    uneven: float
    share: float

    ridges = (LAW_RIDGE,)

    @property
    def __name__(self) -> str:
        return f"through_light: uneven {self.uneven:g}, share {self.share:g}"

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> Polynomial:
        simulated = _law_samples(contact, self.uneven)
        return fit_polynomial(contact, untouched_samples, ridge=ridge, simulated=simulated, share=self.share)


class AutoMethod:
    """Fitters among which held-out balls choose: polynomials of third or fourth order, or `InverseShading`."""

    ways = (
        *((fit, ridge) for fit in (fit_polynomial, fit_fourth_order) for ridge in RIDGES),
        *((InverseShading(uneven, share), LAW_RIDGE) for uneven in PLACE_PENALTIES for share in SHARES),
    )

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> ColourLaw:
        return fit_polynomial(contact, untouched_samples, ridge=ridge)


@lru_cache(maxsize=KEPT)
def _law_samples(contact: Samples, uneven: float) -> Samples:
    """Return samples of the shading law of `contact`, spread evenly over slopes and places."""
    law = fit_light(contact, uneven)
    even = _evenly(LAW_SAMPLES, 4)
    steep = MAX_SLOPE_SHARE * np.hypot(*contact.slopes.T).max() * even[:, 0] ** 0.75
    angle, place = 2 * np.pi * even[:, 1], 2.0 * even[:, 2:4] - 1.0
    slopes = np.stack([steep * np.cos(angle), steep * np.sin(angle)], axis=1)
    return Samples(colours_of(law, slopes, place=place), place, slopes, np.zeros(LAW_SAMPLES, np.int64))


def _evenly(count: int, dimensions: int) -> Floats:
    """Return points (count, dimensions) in the unit cube by Roberts' sequence, x^(d+1) = x + 1."""
    root = 1.5
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
