"""How far errors of slope under a contact spread to the gel beside it, where there is no depth to hide them.

What leaving out balls changes of a map (`photometric/jackknife.py`) is known everywhere in it. Its variance beside
the ball, as a part of the mean over a thickness of gel of what the depths there answer for,

    spread = <std^2> / < <gain^2 depth^2> >          from the contact's rim to a thickness of gel away from it

is what the deviation of a height map takes for the gel beside any contact (`depth_error.py`). Both means are over
all balls: the ratio at one ball alone is anything where little depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.integration.zero_plane import USUAL_THICKNESS_MM
from tactilevision.photometric import BallPicture
from tactilevision.photometric.ball.detection import Ball
from tactilevision.photometric.ball.jackknife import jackknife_std
from tactilevision.photometric.ball.samples import radii_from
from tactilevision.records import Bytes, Pair

Depth = npt.NDArray[np.floating[Any]]
Reader = Callable[[Bytes], Depth]
RIM = 1.15  # contact radii: beyond it the gel is free
MOST = 8  # balls; more tell no more


def leakage_std(
    maps: Sequence[Reader],
    pictures: Sequence[BallPicture],
    *,
    balls: Sequence[Ball | None],
    gain: Depth,
    mm_per_px: Pair,
) -> float:
    """The spread of a calibration's errors; 1 where no ball tells it.

    `maps` make the depth (H, W) of a rectified picture, the first by the calibration, the others by one without a
    group of balls each; `gain` (h, w) is what that changes of the depth scale (`photometric.jackknife.gain_map`).
    """
    found, answered = 0.0, 0.0
    kept = [(picture.rgb, ball) for picture, ball in zip(pictures, balls, strict=True) if ball is not None]
    for rgb, ball in kept[:: max(1, -(-len(kept) // MOST))]:
        depth, *others = (make(rgb) for make in maps)
        variance = np.square(jackknife_std([other - depth for other in others]))
        answers = np.square(cv2.resize(np.asarray(gain, np.float32), depth.shape[::-1]) * depth)
        reach = [USUAL_THICKNESS_MM / step for step in mm_per_px]
        nearby = cv2.GaussianBlur(answers, (0, 0), reach[0], sigmaY=reach[1])
        radii = radii_from(ball, depth.shape, mm_per_px)
        away_mm = (radii - 1.0) * ball.contact_radius_px * mm_per_px[0]
        beside = (radii > RIM) & (away_mm < USUAL_THICKNESS_MM)
        found, answered = found + float(variance[beside].mean()), answered + float(nearby[beside].mean())
    return found / answered if answered else 1.0
