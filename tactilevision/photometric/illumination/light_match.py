"""Has a method been made in the light that it is to be used in?

Slope is read from colour change over brightness, so exposure and white balance cancel out. What remains is how the
light falls: where lamps stand otherwise, the brightness of the untouched gel has another pattern, and the gain of
slope changes by about as much as that pattern does.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.reference import Reference
from tactilevision.records import Floats

BLOCKS = (8, 6)  # across, down: coarse enough that neither marks nor noise tell
MIN_CHANGE = 0.1  # of brightness: lamps age and gels wear by half of it
SAME_SHAPE = 0.02  # of the ratio of width to height: what a resized picture loses by whole pixels


def light_of(reference: Reference) -> Floats:
    """Mean grey (6, 8, 3) of the untouched gel in blocks, NaN where a block is mostly unusable."""
    usable = reference.usable.astype(np.float32)
    share = cv2.resize(usable, BLOCKS, interpolation=cv2.INTER_AREA)[..., None]
    mean = cv2.resize(reference.rgb * usable[..., None], BLOCKS, interpolation=cv2.INTER_AREA)
    return np.where(share > 0.5, mean / np.maximum(share, 1e-6), np.nan).astype(np.float64)


def change_of_light(before: npt.ArrayLike, after: npt.ArrayLike) -> float:
    """Rms by which the pattern of the light changed, as a share of brightness; gains cancel out."""
    ratio = np.log(np.maximum(np.asarray(after, float), 1.0) / np.maximum(np.asarray(before, float), 1.0))
    if not np.isfinite(ratio).any():
        return float("nan")
    return float(np.sqrt(np.nanmean((ratio - np.nanmedian(ratio, axis=(0, 1))) ** 2)))


def other_light(before: npt.ArrayLike, reference: Reference, *, scale_error: float) -> tuple[str, ...]:
    """A warning where the scale of slope is off by more for the light than it was on balls of its own sensor.

    `scale_error` is the latter, relatively, of whole balls: that of single pixels is mostly their noise.
    """
    change = change_of_light(before, light_of(reference))
    if not change > max(MIN_CHANGE, scale_error):
        return ()
    return (
        "the method was made in another light: over the picture brightness differs by "
        f"{100 * change:.0f} %, exposure allowed for, and so does the scale of slopes (error in its own light: "
        f"{100 * scale_error:.0f} %); depths are not to be trusted, train a method on this sensor's balls",
    )


def check_view(before: tuple[int, int], after: tuple[int, int]) -> None:
    """Raises InputError where two pictures (height, width) cannot be one view at two sizes."""
    if abs(before[1] * after[0] / (before[0] * after[1]) - 1) > SAME_SHAPE:
        raise InputError(
            "the method was made for pictures of another shape",
            where="method",
            value=f"{before[1]} x {before[0]}, the recording's are {after[1]} x {after[0]}",
            remedy="Rectify alike, or train a method on this sensor's balls.",
        )
