"""Distance to the nearest place outside a mask, the same bits in every run.

OpenCV's precise transform is exact but for its last square root, whose bits depend on where in memory a row lies.
The square of a distance in pixels is a whole number: it is rounded, and the root is numpy's. (A hundredth of a
micrometre in a height map was all it made, but two runs are to write the same bytes.)
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt


def distance_px(inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Distance (H, W) in px of each place inside the mask (H, W) to the nearest one outside; 0 outside.

    float32, for masks of less than 2896 px across (squares to 2^24).
    """
    distance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distance *= distance
    np.rint(distance, out=distance)
    rooted: npt.NDArray[np.float32] = np.sqrt(distance, out=distance)
    return rooted
