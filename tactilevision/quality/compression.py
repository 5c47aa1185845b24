"""How strongly pictures were compressed, by the steps that JPEG and video codes leave between their blocks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.records import Bytes

BLOCK = 8  # px of a block of JPEG and of most video codes


def blocks_grey(rgb: Bytes) -> float:
    """Grey levels by which neighbours differ more across blocks of a picture (H, W, 3) than within; 0 at least."""
    picture = rgb.astype(np.float32)
    return max(0.0, _across(picture), _across(picture.transpose(1, 0, 2)))


def _across(picture: npt.NDArray[np.float32]) -> float:
    steps = np.abs(np.diff(picture, axis=1)).mean(axis=(0, 2))
    border = np.arange(1, len(steps) + 1) % BLOCK == 0
    return float(np.median(steps[border]) - np.median(steps[~border])) if border.any() else 0.0
