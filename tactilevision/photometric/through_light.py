"""The polynomial by way of the light: how colours answer to slope is fitted, and slope read out of that.

    (1 + u_c) sqrt(1 + p^2 + q^2) - 1 = sum_ij L_cij(X, Y) p^i q^j        1 <= i + j <= 4

A matt surface under one far light makes the left side a plane through 0; the higher terms are shine, shadow and
several lights in one channel. L is a polynomial in place, of order 2, 1, 1, 0 for i + j = 1, 2, 3, 4, since near
lights turn over the picture. Slopes of balls are known and colours noisy, so this is the well-posed direction: a
few balls fix it where a polynomial of slope in colours has too much freedom. The law is then drawn all over slopes
and places, without noise, which would pull slopes towards 0, and `Polynomial` fitted to that; frames are read as
fast as before.

On simulated sensors with 8 to 16 balls the depth of balls left out is off by half as much as with the direct fit
(24 and 24 for 63 and 54 um). Real light may obey no such law (direction 6.1 degrees for 4.0 on a GelSlim 3.0):
balls left out decide which is used, one recording at a time (`EitherWay`; so do `depth`, `force` and `view`).
"""

from __future__ import annotations

import numpy as np

from tactilevision.photometric.method import ColourLaw
from tactilevision.photometric.polynomial import Polynomial, fit_polynomial
from tactilevision.photometric.samples import Samples
from tactilevision.records import Floats

PLACE_ORDER = {1: 2, 2: 1, 3: 1, 4: 0}
TERMS = np.array(
    [
        (i, order - i, k, n - k)
        for order, most in PLACE_ORDER.items()
        for i in range(order + 1)
        for n in range(most + 1)
        for k in range(n + 1)
    ]
)  # powers of p, q, X, Y
DRAWN = 8000
BEYOND = 1.1  # of the steepest slope seen
FREE = 1e-7  # of a term's power: keeps the fit solvable where balls say nothing
HUSH = 0.01  # weight of untouched gel: ten times that pulls slopes down by 2 %, none lets noise through
SMOOTH = 1e-6  # ridge of the polynomial through the drawn samples, which leave nothing open
RIDGES = (1e-3, 1e-2, 1e-1)


def fit_through_light(contact: Samples, quiet: Samples, *, ridge: float) -> Polynomial:
    """The polynomial that undoes the light's law; `ridge` penalises its change over the picture and its bends."""
    law = _fit_light(contact, ridge)
    return fit_polynomial(_drawn(law, contact), quiet, ridge=SMOOTH, hush=HUSH)


class EitherWay:
    """A Fitter: slopes of colours, or colours of slopes, whichever tells balls that it never saw better."""

    ways = tuple((fit, ridge) for fit in (fit_polynomial, fit_through_light) for ridge in RIDGES)

    def __call__(self, contact: Samples, quiet: Samples, *, ridge: float) -> ColourLaw:
        return fit_polynomial(contact, quiet, ridge=ridge)


def _fit_light(contact: Samples, ridge: float) -> Floats:
    """L (terms, 3) of samples."""
    design = _design(contact.slopes, contact.place)
    left = (1.0 + contact.change) * np.sqrt(1.0 + np.sum(contact.slopes**2, axis=1))[:, None] - 1.0
    scale = np.sqrt(np.mean(design**2, axis=0)) + 1e-12
    design /= scale
    normal = design.T @ design / len(design)
    normal[np.diag_indices_from(normal)] += FREE + ridge * (TERMS.sum(axis=1) - 1)
    return np.asarray(np.linalg.solve(normal, design.T @ left / len(design)) / scale[:, None])


def _drawn(law: Floats, contact: Samples) -> Samples:
    """Samples of the law, spread evenly over slopes and places."""
    even = _evenly(DRAWN, 4)
    steep = BEYOND * np.hypot(*contact.slopes.T).max() * even[:, 0] ** 0.75
    angle, place = 2 * np.pi * even[:, 1], 2.0 * even[:, 2:4] - 1.0
    slopes = np.stack([steep * np.cos(angle), steep * np.sin(angle)], axis=1)
    change = (1.0 + _design(slopes, place) @ law) / np.sqrt(1.0 + steep**2)[:, None] - 1.0
    return Samples(change, place, slopes, np.zeros(DRAWN, np.int64))


def _evenly(count: int, dimensions: int) -> Floats:
    """Places (count, dimensions) in the unit cube, evener than random: Roberts' sequence, x^(d+1) = x + 1."""
    root = 1.5
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)


def _design(slopes: Floats, place: Floats) -> Floats:
    values = np.concatenate([slopes, place], axis=1)
    powers = values[:, :, None] ** np.arange(5)
    return np.asarray(np.prod(powers[:, np.arange(4), TERMS], axis=2))
