"""The term of the photometric scale: depths are all too large, or too small, by a part g of themselves.

    variance(x, y) = g(x, y)^2 depth(x, y)^2          g^2 = g_seen^2 + g_place(x, y)^2 + g_beyond(x, y)^2

g_seen: how far the scale of balls scatters that are in the calibration, which no map escapes. g_place: what other
balls would have made of it, place by place (photometric/ball/jackknife.py). g_beyond: what lying beyond the
outermost balls adds (photometric/ball/extrapolation.py). All stand in the method's card; older ones lack the last.
Vanishes where the depth is 0, and where every ball gives one scale. Assumes slopes that err in proportion.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.card import MethodCard
from tactilevision.records import Floats

Picture = npt.NDArray[np.float32]


def scale_variance(depth_mm: Picture, gain_square: Picture) -> Picture:
    """Variance (h, w) mm² of `depth_mm` (h, w) by its scale, of relative variance `gain_square` (h, w)."""
    square = cv2.multiply(depth_mm, depth_mm)
    square *= gain_square
    return np.asarray(square)


def gain_variance(card: MethodCard, relative_error: float, *, shape: tuple[int, ...]) -> Picture:
    """Relative variance of the depth scale over a picture of `shape` (h, w), as a method's card tells it."""
    squares = place_gain_std(card, relative_error) ** 2, extrapolated_gain_std(card) ** 2
    place, beyond = (np.asarray(cv2.resize(np.asarray(one, np.float32), shape[::-1])) for one in squares)
    return np.asarray(place + beyond)


def extrapolated_gain_std(card: MethodCard) -> Floats:
    """Deviation (h, w) of the depth scale beyond the balls, a ratio; 0 where a card tells none."""
    return np.array(card.extrapolated_gain_std or [[0.0]], np.float64)


def place_gain_std(card: MethodCard, relative_error: float) -> Floats:
    """Deviation (h, w) of the depth scale over the picture, relative, but for what lies beyond the balls."""
    return np.hypot(gain_std(card, relative_error), np.array(card.place_gain_std or [[0.0]], np.float64))


def gain_std(card: MethodCard, relative_error: float) -> float:
    """Relative deviation of the depth scale from ball to ball, which no map escapes; of slopes where not told.

    A card that does not say what other balls would have changed has it mixed with balls held out.
    """
    held_out = relative_error if card.held_out_gain_std is None else card.held_out_gain_std
    if card.seen_gain_std is None:
        return held_out
    seen = card.seen_gain_std
    return seen if card.place_gain_std is not None else float(np.sqrt(seen * (held_out + seen)))
