"""The term of leakage: errors of slope under a contact spread to the gel beside it, with no depth to hide them.

    variance(x, y) = max(k <g^2 depth^2> - g^2 depth^2, 0)      < >: mean over a thickness of gel

g^2 depth^2 is the term of the depth scale. The share k is measured once, when a method is made. What leaving out
balls changes of a map (photometric/ball/jackknife.py) is known everywhere in it, so that beside the balls

    k = <std^2> / < <g^2 depth^2> >          from the contact's rim to a thickness of gel away from it

Both means are over all balls: the ratio at one ball alone is anything where little depends on it.
Vanishes where nothing within a thickness of gel is deep, and with the scale's own error.
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

Picture = npt.NDArray[np.float32]
Depth = npt.NDArray[np.floating[Any]]
Reader = Callable[[Bytes], Depth]
RIM = 1.15  # contact radii: beyond it the gel is free
MAX_BALLS = 8  # balls; more tell no more
COARSE = 4  # points to a thickness of gel on which the mean is taken: it is smooth


def leaked_variance(scale_mm2: Picture, share: float, *, every: int, mm_per_px: Pair) -> Picture:
    """Variance (h, w) mm² that the scale's, `scale_mm2` (h, w) mm², makes within a thickness of gel.

    This term and that of the scale together are the larger of both. `scale_mm2` holds every `every`th pixel of a
    picture at `mm_per_px` (x, y); `share` is k.
    """
    step = max(1, round(USUAL_THICKNESS_MM / (COARSE * every * max(mm_per_px))))
    coarse = scale_mm2[::step, ::step]
    reach = [USUAL_THICKNESS_MM / (step * every * px) for px in mm_per_px]
    coarse = np.asarray(cv2.GaussianBlur(coarse, (0, 0), reach[0], sigmaY=reach[1]))
    coarse *= np.float32(share)
    return np.asarray(cv2.resize(coarse, scale_mm2.shape[::-1], interpolation=cv2.INTER_LINEAR))


def leakage_share(
    maps: Sequence[Reader],
    pictures: Sequence[BallPicture],
    *,
    balls: Sequence[Ball | None],
    gain: Depth,
    mm_per_px: Pair,
) -> float:
    """The share k of a calibration; 1 where no ball tells it.

    `maps` make the depth (H, W) mm of a rectified picture, the first by the calibration, the others by one without
    a group of balls each; `gain` (h, w) is what that changes of the depth scale, relative.
    """
    beside_sum, nearby_sum = 0.0, 0.0
    kept = [(picture.rgb, ball) for picture, ball in zip(pictures, balls, strict=True) if ball is not None]
    for rgb, ball in kept[:: max(1, -(-len(kept) // MAX_BALLS))]:
        depth, *others = (make(rgb) for make in maps)
        variance = np.square(jackknife_std([other - depth for other in others]))
        scale = np.square(cv2.resize(np.asarray(gain, np.float32), depth.shape[::-1]) * depth)
        reach = [USUAL_THICKNESS_MM / step for step in mm_per_px]
        nearby = cv2.GaussianBlur(scale, (0, 0), reach[0], sigmaY=reach[1])
        radii = radii_from(ball, depth.shape, mm_per_px=mm_per_px)
        away_mm = (radii - 1.0) * ball.contact_radius_px * mm_per_px[0]
        beside = (radii > RIM) & (away_mm < USUAL_THICKNESS_MM)
        beside_sum += float(variance[beside].mean())
        nearby_sum += float(nearby[beside].mean())
    return beside_sum / nearby_sum if nearby_sum else 1.0
