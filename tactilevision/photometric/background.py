"""What a law says of gel that nobody touches: its bias and its noise over the picture.

Where a channel is nearly dark, its noise goes through the law's products and comes out as a slope that is not
there; and clipping at black moves the mean of noisy frames, by about DARK^2/(DARK^2 + I^2) grey levels, against
that of quieter ones. The ball pictures show plenty of untouched gel: the mean slope found on it is taken off,
and a place where noise, bias or darkness come to more than a slope is likely to be is damped towards flat:

    slope -> (slope - bias) / (1 + D^2)     D = (bias^2 + noise^2) / NOISE_LIMIT^2 + dark^2 / DARK_LIMIT^2

so that a place of little doubt is not touched, and one with D > 1 is marked as not readable.
The gel far from a ball still slopes a little, and always outwards at the picture's border; so a bias counts only
as far as it exceeds MIN_BIAS.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools

Picture = npt.NDArray[np.float32]
BLOCK = 8  # px along each side of a block; smaller ones hold too few pixels to tell bias from noise
# slope up to which a bias counts as the gel's own lean near a ball; less would take true slopes off
MIN_BIAS = 0.01
DARK_LIMIT = 0.01  # slope from darkness; all of a dark place's pixels share it, so that it does not average out
DARK = 6.0  # grey levels of a channel at which clipping at black moves its mean by half a grey level
PAIRS = 4  # draws of noise, each with both signs; more cost time at start, and the blur below averages as well
BLUR_PX = 8.0  # px, sigma of the blur of the drawn bias; less leaves more of the draws' own noise in it
NOISE_LIMIT = 0.1  # slope noise at which a pixel tells no more than expecting a flat gel does


@dataclass(frozen=True, slots=True)
class SlopeBackground:
    """`bias_x`, `bias_y`, `noise` (h, w) float32 in blocks of BLOCK pixels: slopes found where there are none."""

    bias_x: Picture
    bias_y: Picture
    noise: Picture

    def over(self, shape: tuple[int, int]) -> tuple[Picture, Picture, Picture]:
        """The three maps at (H, W), smooth between blocks."""
        size = (shape[1], shape[0])
        maps = [
            cv2.resize(m, size, interpolation=cv2.INTER_LINEAR) for m in (self.bias_x, self.bias_y, self.noise)
        ]
        return maps[0], maps[1], maps[2]


class BackgroundSums:
    """Gathers untouched slopes, picture by picture, block by block."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.size = (max(2, shape[1] // BLOCK), max(2, shape[0] // BLOCK))
        self.count, self.sum_x, self.sum_y, self.squares = np.zeros((4, self.size[1], self.size[0]))

    def add(self, slope_x: Picture, slope_y: Picture, untouched: Bools) -> None:
        """Count in the slopes (H, W) found where the gel is `untouched` (H, W)."""
        mask = untouched.astype(np.float32)
        self.count += self._blocks(mask)
        self.sum_x += self._blocks(slope_x * mask)
        self.sum_y += self._blocks(slope_y * mask)
        self.squares += self._blocks((slope_x**2 + slope_y**2) * mask)

    def result(self, expected: Picture) -> SlopeBackground:
        """Bias and noise; where the gel was never untouched, no bias and the `expected` noise (H, W)."""
        counted = self.count > 0.5
        count = np.where(counted, self.count, 1.0)
        bias_x, bias_y = np.where(counted, self.sum_x / count, 0.0), np.where(counted, self.sum_y / count, 0.0)
        size = np.hypot(bias_x, bias_y)
        excess_share = np.maximum(0.0, 1.0 - MIN_BIAS / np.maximum(size, 1e-9))
        variance = 0.5 * np.maximum(self.squares / count - bias_x**2 - bias_y**2, 0.0)
        noise = np.where(counted, np.sqrt(variance), self._blocks(expected))
        return SlopeBackground(_single(excess_share * bias_x), _single(excess_share * bias_y), _single(noise))

    def added_to(self, background: SlopeBackground, kept_share: Picture) -> SlopeBackground:
        """`background` with the mean slopes gathered here, which came out damped by `kept_share` (H, W), in its
        bias.

        Smooth over three blocks, over which a law's bias hardly changes and noise averages out.
        """
        count = np.where(self.count > 0.5, self.count, np.inf)
        damped = np.maximum(self._blocks(kept_share), 0.5)
        extra = [cv2.GaussianBlur(total / count / damped, (0, 0), 1.5) for total in (self.sum_x, self.sum_y)]
        return SlopeBackground(
            _single(background.bias_x + extra[0]), _single(background.bias_y + extra[1]), background.noise
        )

    def noise_over(self, noise: Picture) -> float:
        """Median ratio of the noise gathered here to `noise` (H, W), which often is that of means of pictures."""
        counted = self.count > 0.5
        count = np.where(counted, self.count, 1.0)
        variance = 0.5 * (self.squares - (self.sum_x**2 + self.sum_y**2) / count) / count
        return float(
            np.median(np.sqrt(np.maximum(variance, 0.0))[counted] / np.maximum(self._blocks(noise), 1e-9)[counted])
        )

    def _blocks(self, picture: Picture) -> npt.NDArray[np.float64]:
        return np.asarray(cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA), np.float64)


def _single(values: npt.NDArray[np.floating[Any]]) -> Picture:
    return np.asarray(values, np.float32)


def damping(background: tuple[Picture, Picture, Picture], dark: Picture) -> Picture:
    """D (H, W) out of bias in x, bias in y, noise, and the slope that darkness may pretend."""
    return _single(
        (background[0] ** 2 + background[1] ** 2 + background[2] ** 2) / NOISE_LIMIT**2 + (dark / DARK_LIMIT) ** 2
    )


def darkness(levels: Picture) -> Picture:
    """Grey levels by which clipping at black may have moved channels of mean `levels` (grey, any shape)."""
    return _single(DARK**2 / (DARK**2 + levels**2))


def noise_bias(evaluate: Callable[[Picture], tuple[Picture, Picture]], noise: Picture) -> tuple[Picture, Picture]:
    """Mean slopes (H, W) that a law finds in nothing but noise: its even part makes a slope of the noise's square.

    `noise` (3, H, W) is the standard deviation of the changes. Drawn in pairs of opposite sign, in which the odd
    part cancels; smooth over BLUR_PX pixels.
    """
    rng = np.random.default_rng(0)  # a fixed draw: a method does not change between runs
    total = np.zeros((2, *noise.shape[1:]), np.float32)
    for _ in range(PAIRS):
        drawn = rng.standard_normal(noise.shape, dtype=np.float32) * noise
        for signed in (drawn, -drawn):
            for slope, drawn_slope in zip(total, evaluate(signed), strict=True):
                slope += drawn_slope
    smooth = [cv2.GaussianBlur(slope / (2 * PAIRS), (0, 0), BLUR_PX) for slope in total]
    return _single(smooth[0]), _single(smooth[1])
