"""Follows the light: how brightness has drifted since the reference was taken, seen on the untouched gel.

    I = I_0 (1 + g_0 + g_x X + g_y Y)      per channel; X, Y from -1 to 1 over the picture

fitted by iteratively reweighted least squares on block means, so that a contact (whose colours leave the
pattern) and what lies close to it do not count. The gel's gentle slopes round a contact look much like an
uneven drift; so the plane terms are held to a part of the constant one.
Valid while less than about half of the picture is touched.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.middle import median
from tactilevision.photometric.reference import Reference
from tactilevision.records import Bools, Bytes, Floats

BLOCKS = 600  # blocks over the picture, about
ROUNDS = 3
SAMPLED = 16  # pixels at most along each side of a block that stand for it
USUAL = 1.5382  # median length of three standard normal numbers
LEAST_BLOCKS = 30
UNEVEN = 0.3  # a lamp that fades does so all over its picture: its plane is a part of its mean
LEAST_UNEVEN = 2e-4
CORRELATED = 20.0  # blocks whose errors (gentle slopes of the gel) hang together


@dataclass(frozen=True, slots=True)
class Drift:
    """`gains` (3 channels, 3): constant, x, y.

    `untouched` (h, w): blocks that follow it; `strangeness` (h, w) in noise.
    """

    gains: Floats
    untouched: Bools
    strangeness: Floats


class DriftTracker:
    """Measures the drift of frames against one reference; what depends on the reference alone is made once."""

    def __init__(self, reference: Reference) -> None:
        height, width = reference.shape
        block = max(4, int(np.sqrt(height * width / BLOCKS)))
        self.size = (max(2, width // block), max(2, height // block))
        self.inside = min(SAMPLED, block)
        share = cv2.resize(reference.usable.astype(np.float32), self.size, interpolation=cv2.INTER_AREA)
        self.usable = (share > 0.5).ravel()
        noise = np.asarray(reference.noise_grey)[:, None]
        # of a block's mean; rounding does not average out
        self.noise = np.sqrt(noise**2 / self.inside**2 + 0.3**2)
        x, y = np.meshgrid(_centres(self.size[0], width), _centres(self.size[1], height))
        self.basis = np.stack([np.ones_like(x), x, y], axis=-1).reshape(-1, 3)
        self.level = self._planes(reference.rgb)
        self.squares = (self.basis[:, :, None] * self.basis[:, None, :]).reshape(-1, 9)
        self.shown = self.level / self.noise, self.basis.T.copy()

    def follow(self, rgb: Bytes, share: float) -> None:
        """Count from a picture moved towards `rgb` by `share`: what the reference follows is drift no more."""
        self.level += share * (self._planes(rgb) - self.level)
        np.divide(self.level, self.noise, out=self.shown[0])

    def measure(self, rgb: Bytes) -> Drift:
        """The drift of a rectified frame. Raises InputError where it cannot be one of this sensor's."""
        blocks = self._planes(rgb)
        change = blocks - self.level
        self._check(blocks, change)
        usable = self.usable
        gains = np.zeros((3, 3))
        gains[:, 0] = median((change / np.maximum(self.level, 1.0))[:, usable])
        scale = 1.0
        for _ in range(ROUNDS):
            size = self._strangeness(change, gains)
            scale = max(1.0, float(median(size[usable])) / USUAL)
            touched = usable & (size > 4.0 * scale)
            fitting = usable / np.square(1.0 + np.square(size / (3.0 * scale)))
            weights = fitting * ~self._beside(touched)
            if np.count_nonzero(weights) < LEAST_BLOCKS:
                weights = fitting
            gains = self._fit(change, weights, gains[:, 0])
        size = self._strangeness(change, gains)
        shape = (self.size[1], self.size[0])
        return Drift(gains, (usable & (size < 4.0 * scale)).reshape(shape), size.reshape(shape))

    def _beside(self, touched: Bools) -> Bools:
        """Blocks near enough to a contact for its slopes to pass for drift; a lone noisy block is none."""
        picture = touched.reshape(self.size[1], self.size[0]).astype(np.uint8)
        solid = cv2.morphologyEx(picture, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
        return np.asarray(cv2.dilate(solid, np.ones((7, 7), np.uint8)).ravel() > 0)

    def _planes(self, picture: Bytes | npt.NDArray[np.float32]) -> Floats:
        """Means (3, h * w) over SAMPLED by SAMPLED pixels, evenly spread, of each block of a picture (H, W, 3)."""
        few = (self.size[0] * self.inside, self.size[1] * self.inside)
        sampled = cv2.resize(picture, few, interpolation=cv2.INTER_NEAREST)
        blocks = cv2.resize(sampled, self.size, interpolation=cv2.INTER_AREA)
        return np.array(blocks.reshape(-1, 3).T, np.float64, order="C")

    def _strangeness(self, change: Floats, gains: Floats) -> Floats:
        """Distance of each block from the drift, in standard deviations of its noise, over the channels."""
        level, basis = self.shown
        left = change / self.noise
        left -= level * (gains @ basis)
        left *= left
        return np.asarray(np.sqrt(left[0] + left[1] + left[2]))

    def _fit(self, change: Floats, weights: Floats, constant: Floats) -> Floats:
        """Weighted ridge regression: the steeper the drift's plane against its mean, the less it is believed."""
        heavy = (self.shown[0] / self.noise) * weights
        normal = ((heavy * self.level) @ self.squares).reshape(3, 3, 3)
        likely = UNEVEN * np.abs(constant) + LEAST_UNEVEN
        normal[:, (1, 2), (1, 2)] += (CORRELATED / likely**2)[:, None]
        normal[:, 0, 0] += 1e-9
        right = (heavy * change) @ self.basis
        return np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0])

    def _check(self, blocks: Floats, change: Floats) -> None:
        usable = self.usable
        level = float(blocks[:, usable].mean())
        usual = float(self.level[:, usable].mean())
        brightest = np.maximum(np.maximum(blocks[0], blocks[1]), blocks[2])[usable]
        if level < 0.1 * usual or float(median(brightest)) > 252.0 > usual + 20.0:
            raise InputError(
                "the frame is " + ("black" if level < 0.1 * usual else "saturated"),
                where="frame",
                value=f"mean grey {level:.0f}, the reference has {usual:.0f}",
                remedy="Leave the frame out; check lights and exposure.",
            )
        off = float(median(np.abs(change[:, usable]).ravel()))
        if off > 12.0 and float(median(np.abs((blocks[::-1] - self.level)[:, usable]).ravel())) < 0.4 * off:
            raise InputError(
                "the frame's colours are in the order blue, green, red",
                where="frame",
                remedy="Hand frames over as red, green, blue.",
            )
        if off > 0.5 * usual:
            raise InputError(
                "the frame is nothing like the reference",
                where="frame",
                value=f"median difference {off:.0f} grey levels",
                remedy="Use a reference of the same sensor and light.",
            )


def _centres(blocks: int, pixels: int) -> Floats:
    """Middles of the blocks on a line of pixels whose ends are at -1 and 1."""
    return np.asarray((2.0 * (np.arange(blocks) + 0.5) * pixels / blocks - pixels) / (pixels - 1))
