"""How differently a calibration would have read slopes, place by place, had other balls been pressed.

A law f is fitted to all balls, and laws f_1 .. f_K each without a K-th of them. What other balls would have made
of f scatters by

    std^2 = (K - 1)/K sum_k (f_k - f)^2

(the delete-a-group jackknife; Wolter, Introduction to Variance Estimation, 2007, 4.2), which needs no truth. Of
slopes it is asked what a contact's depth rests on: with u the colours that a slope of s in the direction n gives,

    gain_k(X, Y) = mean over n and s of n . (f_k(u) - f(u)) / s

u is drawn from the light's law (`shading_fit.py`). Among the balls it is rather too large (by up to 1.6), which
balls left out show (`cross_validation.py`). Where three laws cross beyond the outermost balls it vanishes by
chance: there it is taken as at the nearest place among them. What is lost beyond them is told by sides left out
(`extrapolation.py`). What no choice of balls mends, as a light that the law cannot follow, is not in it: balls of
the fit show that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball.extrapolation import distance_beyond
from tactilevision.photometric.ball.samples import Samples
from tactilevision.photometric.ball.shading_fit import colours_of, fit_light
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.records import Floats

PLACES = (16, 12)  # places across and down the picture; gain changes slowly between them
DIRECTIONS = 12  # of slope, averaged over at each place: a contact holds all of them
CONTACT = 1.0  # places over which a contact reaches: its depth rests on the gain all over it
STEEP = (0.25, 0.5)  # of the steepest slope under the balls; most of a contact is that gentle


def jackknife_std(others: Sequence[npt.NDArray[np.floating[Any]]]) -> Floats:
    """Standard deviation of a quantity from what leaving out each of K groups adds to it.

    `others` are K arrays of one shape; the result has this shape and their unit.
    """
    return np.asarray(np.sqrt((len(others) - 1) / len(others) * np.sum(np.square(others), axis=0)), np.float64)


def gain_map(law: ColourLaw, others: Sequence[ColourLaw], *, contact: Samples) -> Floats:
    """Relative standard deviation (12, 16), over the picture, of the depth scale of `law`, a ratio.

    `others` are the laws fitted without a group of balls each, `contact` the samples under all of them.
    """
    place = places()
    light = fit_light(contact)
    gains = np.zeros((len(others), len(place)))
    for steep in np.hypot(*contact.slopes.T).max() * np.array(STEEP):
        for angle in 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            along = np.array([np.cos(angle), np.sin(angle)])
            colours = colours_of(light, np.tile(steep * along, (len(place), 1)), place=place)
            slope = law.at(colours, place) @ along
            gains += [(other.at(colours, place) @ along - slope) / steep for other in others]
    gains /= DIRECTIONS * len(STEEP)
    maps = [
        cv2.GaussianBlur(gain, (0, 0), CONTACT, borderType=cv2.BORDER_REPLICATE)
        for gain in gains.reshape(len(others), *PLACES[::-1])
    ]
    return nearest_inside(jackknife_std(maps), distance_beyond(contact.place, place))


def places() -> Floats:
    """The places (192, 2), from -1 to 1, at which gain is told; row by row."""
    x, y = (2.0 * (np.arange(count) + 0.5) / count - 1.0 for count in PLACES)
    return np.stack([grid.ravel() for grid in np.meshgrid(x, y)], axis=1)


def nearest_inside(values: Floats, beyond: Floats) -> Floats:
    """`values` (12, 16), in any unit; at a distance `beyond` (192,) from the balls the nearest among them."""
    at, inside = places(), np.flatnonzero(beyond == beyond.min())
    nearest = np.argmin(np.hypot(*(at[:, None] - at[inside]).T), axis=0)
    return np.asarray(values.ravel()[inside[nearest]].reshape(values.shape))
