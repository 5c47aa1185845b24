"""Has the picture moved against its reference? A camera that was knocked, a sensor that was opened.

Colour change is counted pixel by pixel, so a picture that lies 10 px beside its reference shows up to a
millimetre of depth that is not there. Light is too smooth to tell a shift from drift; the gel's grain, dirt and
marks tell it:

    c(d) = sum_x g_0(x) g(x + d)        g: detail of 1 to 3 px of the logarithm of brightness, of even strength

has its peak where the picture lies. A contact carries little of the gel with it and blurs the peak, no more.
Noise on the chip stays in its place and keeps a peak at 0, so a shift counts where its peak stands clearly above
that one. Shifts of up to REACH_PX are looked for: marks on a lattice look alike farther on. A gel without grain
tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Bytes, Floats, Pair
from tactilevision.robust import mad_std

FINE_PX = 0.8  # px: sigma of the finer blur; detail is its difference from the coarser
COARSE_PX = 3.0  # px: sigma of the coarser blur
EVEN_PX = 15.0  # px: sigma of the blur over which the strength of detail is taken
DARK_GREY = 30.0  # of three channels together, below which noise would be most of the detail
MAX_DETAIL = 3.0  # of the detail's strength: one scratch is not all there is to see
REACH_PX = 16  # px: the largest shift that is looked for
# deviations of the correlation by which its peak stands out; unmoved real frames have 15 and more
DETECTION_SIGMA = 12.0
MIN_PEAK_RATIO = 1.5  # times the correlation of a picture that has not moved
MIN_PX = 1.5  # gel that is pressed sideways moves by as much
ALIKE_PX = 1.5  # px from the middle shift, within which shifts count as alike
MAX_FRAMES = 8  # frames that are looked at, at most, spread evenly

Single = npt.NDArray[np.float32]


def image_shift(reference: npt.NDArray[Any], pictures: Sequence[Bytes]) -> Pair | None:
    """Shift (right, down) in px by which most `pictures` (H, W, 3) lie beside the `reference` (H, W, 3).

    None where they do not, or where it cannot be seen. At most MAX_FRAMES of them are looked at, spread evenly.
    """
    chosen = np.unique(np.linspace(0, len(pictures) - 1, min(MAX_FRAMES, len(pictures))).astype(int))
    spectrum = _spectrum(reference)
    shifts = [shift for k in chosen if (shift := _shift(spectrum, pictures[k])) is not None]
    if not shifts:
        return None
    median = np.median(shifts, axis=0)
    alike = [shift for shift in shifts if np.hypot(*(shift - median)) < ALIKE_PX]
    if 2 * len(alike) <= len(chosen):
        return None
    x, y = np.mean(alike, axis=0)
    return float(x), float(y)


def _shift(spectrum: npt.NDArray[np.complex128], picture: Bytes) -> Floats | None:
    """By how much (2,) one picture has moved; None where it has not, or where it cannot be seen."""
    shape = picture.shape[:2]
    whole = np.fft.irfft2(spectrum.conj() * _spectrum(picture), s=shape)
    noise = mad_std(whole, centre=0.0) + 1e-12
    reach = min(REACH_PX, (min(shape) - 3) // 2)
    around = np.roll(whole, (reach + 1, reach + 1), axis=(0, 1))[: 2 * reach + 3, : 2 * reach + 3] / noise
    y, x = np.unravel_index(np.argmax(around[1:-1, 1:-1]), (2 * reach + 1, 2 * reach + 1))
    peak, unmoved = around[y + 1, x + 1], around[reach + 1, reach + 1]
    at: Floats = np.array([x + _vertex(around[y + 1, x : x + 3]), y + _vertex(around[y : y + 3, x + 1])]) - reach
    if peak < max(DETECTION_SIGMA, MIN_PEAK_RATIO * unmoved) or np.hypot(*at) < MIN_PX:
        return None
    return at


def _vertex(three: Floats) -> float:
    """Where the parabola through three values, a pixel apart, has its top, from the middle one."""
    curvature = float(three[0] - 2.0 * three[1] + three[2])
    return 0.0 if curvature >= 0 else float(np.clip(0.5 * (three[0] - three[2]) / curvature, -0.5, 0.5))


def _spectrum(picture: npt.NDArray[Any]) -> npt.NDArray[np.complex128]:
    grain = _grain(picture)
    window = [np.hanning(length) for length in grain.shape]
    return np.asarray(np.fft.rfft2(grain * np.outer(*window)))


def _grain(picture: npt.NDArray[Any]) -> Single:
    """Detail (H, W) of a picture, of about the same strength all over it."""
    bright = np.log(picture.sum(axis=2, dtype=np.float32) + np.float32(DARK_GREY))
    fine = cv2.GaussianBlur(bright, (0, 0), FINE_PX) - cv2.GaussianBlur(bright, (0, 0), COARSE_PX)
    strength = cv2.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), EVEN_PX)) + np.float32(1e-4)
    return np.asarray(np.clip(fine / strength, -MAX_DETAIL, MAX_DETAIL), np.float32)
