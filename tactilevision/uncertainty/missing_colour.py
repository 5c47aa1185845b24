"""The term of missing colours: slopes that two colours tell are further off, and depth with them.

    variance(x, y) = < e >^2 max(depth^2, < depth^2 >)      < >: means over REACH_MM, and over a thickness of gel

e: relative error of a slope without that colour beyond that of a slope by all colours, 0 where all are known
(photometric/methods/two_colours.py). A few pixels without a colour, in gel that is told by all, hardly change
what is integrated over them. What is integrated over many carries their error on, as under leakage.py.
Vanishes where all colours are known, and where the depth is 0. Assumes slopes that err in proportion.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Pair
from tactilevision.uncertainty.leakage import leaked_variance

Picture = npt.NDArray[np.float32]
BLUR = 4.0  # deviations to which OpenCV follows a blur
REACH_MM = 1.0  # mm over which errors of integrated slopes hang together: half of a usual contact


def missing_colour_variance(depth_mm: Picture, lost_share: Picture, *, every: int, mm_per_px: Pair) -> Picture:
    """Variance (h, w) mm² of `depth_mm` (h, w) mm; `lost_share` (h, w) is e, no unit.

    Both hold every `every`th pixel of a picture at `mm_per_px` (x, y).
    """
    reach = [REACH_MM / (every * px) for px in mm_per_px]
    left, top, width, height = cv2.boundingRect(cv2.compare(lost_share, 0.0, cv2.CMP_NE))
    down, across = (int(BLUR * one) + 2 for one in reach[::-1])  # as far as the blur carries anything
    rows = slice(max(top - down, 0), top + height + down)
    columns = slice(max(left - across, 0), left + width + across)
    share = cv2.GaussianBlur(lost_share[rows, columns], (0, 0), reach[0], sigmaY=reach[1])
    square = np.square(depth_mm)
    square = cv2.max(leaked_variance(square, 1.0, every=every, mm_per_px=mm_per_px), square)
    variance = np.zeros(depth_mm.shape, np.float32)
    np.multiply(np.square(share), square[rows, columns], out=variance[rows, columns])
    return variance
