"""The term of missing colours: slopes that two colours tell are further off, and depth with them.

    variance(x, y) = max(v, < v >),  v = e^2 depth^2          < >: mean over a thickness of gel

e: relative error of a slope without that colour beyond that of a slope by all (photometric/methods/two_colours.py).
What is integrated over such a place carries its error on, as under leakage.py.
Vanishes where all colours are known, and where the depth is 0. Assumes slopes that err in proportion.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Pair
from tactilevision.uncertainty.leakage import leaked_variance

Picture = npt.NDArray[np.float32]


def missing_colour_variance(
    depth_mm: Picture, lost_share: Picture, *, every: int, mm_per_px: Pair
) -> Picture:
    """Variance (h, w) mm² of `depth_mm` (h, w) mm; `lost_share` (h, w) is e, no unit.

    Both hold every `every`th pixel of a picture at `mm_per_px` (x, y).
    """
    variance = np.asarray(np.square(lost_share * depth_mm), np.float32)
    return np.asarray(cv2.max(leaked_variance(variance, 1.0, every=every, mm_per_px=mm_per_px), variance))
