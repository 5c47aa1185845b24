"""The term of the untouched gel: how far it comes out from flat, beyond what drawn noise explains.

    variance(x, y) = max(noise^2 + waves^2, untouched(x, y)^2) - noise^2

waves: rms depth of untouched gel in the calibration's pictures, where no frames of the free gel were given.
untouched: what single frames of the free gel show, place by place. Their noise is alike over many pixels (blur,
compression). Integrated, its slow waves come to several times as much as independent noise, most in dark corners.
Vanishes where free frames come out flat. Assumes that the gel is as quiet under way as it was then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Floats
from tactilevision.robust import MAD_TO_STD

Picture = npt.NDArray[np.float32]
BLOCK_PX = 16  # px: grid on which the depth of untouched gel is kept; its waves are longer


def free_variance(noise_mm2: Picture, waves_mm: float, *, untouched_std: Floats) -> Picture:
    """Variance (H, W) mm² of free gel: this term and that of noise, `noise_mm2` (H, W) mm², together.

    `waves_mm` is one deviation for all places, `untouched_std` (h, w) mm one for each block.
    """
    variance = noise_mm2 + np.float32(waves_mm**2)
    blocks = np.asarray(untouched_std, np.float32)
    untouched = cv2.resize(blocks, variance.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.maximum(variance, untouched**2))


def untouched_std_mm(depths: Sequence[npt.NDArray[np.floating[Any]]]) -> Floats:
    """Standard deviation (h, w) mm that N >= 2 depths (H, W) mm of the free gel show, in blocks of BLOCK_PX.

    The median over the frames, as in one or the other something may have touched; N/(N - 1) of the variance, as
    the mean of the same frames' slopes was taken off; smooth over neighbouring blocks, as few frames are rough.
    """
    height, width = depths[0].shape
    block_std = MAD_TO_STD * np.median(np.abs(np.stack(depths)), axis=0)
    size = (max(2, width // BLOCK_PX), max(2, height // BLOCK_PX))
    blocks = cv2.resize(np.asarray(block_std, np.float32), size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(blocks, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smooth * np.sqrt(len(depths) / (len(depths) - 1)), np.float64)
