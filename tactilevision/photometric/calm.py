"""Calm gel read at half the resolution, and what is pressed in full.

Where the surface hardly slopes its colours change slowly from pixel to pixel, and four pixels' mean says as much
of it as the four do: a quarter of the work. So the whole picture is read in means of 2 by 2 pixels, and windows
round all that stands out there by LOUD deviations of a single pixel's noise once more, pixel by pixel.
The halved reading has its own noise, and so its own mean slope of noise in the dark (`quiet.py`): a method is read
so only where frames of untouched gel, read so, have told what to take off. Not for gel with marks,
which are filled in the whole picture first, nor for laws with steps, which the noise of single pixels must blur.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.change import ChangeMaps, Planes, Window, strips
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.quiet import rest_bias
from tactilevision.records import Bytes, SlopeMap

if TYPE_CHECKING:
    from tactilevision.photometric.method import CalibratedMethod

LOUD = 4.0
BLOCK = 4  # halved pixels: grid on which windows are cut
MOST = 0.5  # of the picture in windows; above that all of it is read in full
LEAST = 64  # pixels along the shorter side of the picture, below which nothing is saved

Picture = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Reading:
    """What one frame says: its slopes, the drift of its light, and the greatest |slope| along x or y."""

    slopes: SlopeMap
    drift: Drift
    steepest: float


def can_halve(method: CalibratedMethod) -> bool:
    """Whether calm gel may be read at half the resolution, and something is saved by it."""
    shape = method.reference.shape
    return method.reference.marks is None and method.evaluate.smooth and min(shape) >= LEAST


class CalmReader:
    """Reads frames for one method; what depends on the method alone is made once."""

    def __init__(self, method: CalibratedMethod) -> None:
        self.method = method
        height, width = method.reference.shape
        self.size = width // 2, height // 2
        self.even = slice(0, 2 * self.size[1]), slice(0, 2 * self.size[0])
        full = method.change.maps
        x, y = (np.asarray(0.5 * (places[0:end:2] + places[1:end:2]))
                for places, end in ((full.x, 2 * self.size[0]), (full.y, 2 * self.size[1])))  # fmt: skip
        self.maps = ChangeMaps(np.stack([self._halved(plane) for plane in full.mean]), x, y)
        self.evaluate = method.law.evaluator((len(y), len(x)))
        self.calm = self._halved(method.calm)
        noise = np.stack([self._halved(plane) for plane in method.change.noise])
        rest = np.stack(rest_bias(self.evaluate, 0.5 * noise)) - np.stack([self._halved(r) for r in method.rest])
        self.bias = np.stack([self._halved(plane) for plane in method.bias]) + rest * self.calm
        self.loud = LOUD * self._halved(method.noise)
        self._change = np.empty_like(self.maps.mean)
        self._slopes: Planes = np.empty((2, *self.calm.shape), np.float32)
        blocks = [-(-n // BLOCK) for n in self.calm.shape]
        self._seen = np.zeros((BLOCK * blocks[0], BLOCK * blocks[1]), np.uint8)

    def follow(self) -> None:
        """To be called when the method's reference has moved."""
        for halved, plane in zip(self.maps.mean, self.method.change.level, strict=True):
            halved[...] = self._halved(plane)
        self.maps.settle()

    def read(self, rgb: Bytes) -> Reading:
        """As the method's own reading, calm gel at half the resolution."""
        method = self.method
        drift, valid = method.change.take(rgb)
        self.maps.light(drift.gains)
        self._read()
        slopes: Planes = np.empty((2, *method.reference.shape), np.float32)
        rows, columns = self.even
        for whole, half in zip(slopes, self._slopes, strict=True):
            cv2.resize(half, (columns.stop, rows.stop), dst=whole[self.even], interpolation=cv2.INTER_LINEAR)
        slopes[:, rows.stop :], slopes[..., columns.stop :] = slopes[:, -2:-1], slopes[..., -2:-1]
        steepest = max(cv2.norm(half, cv2.NORM_INF) for half in self._slopes)
        for window in self.windows(self._slopes):
            steepest = max(steepest, method.read_into(slopes, method.change.within(window)))
        valid &= method.readable
        return Reading(SlopeMap(slopes[0], slopes[1], valid), drift, steepest)

    def _read(self) -> None:
        """The slopes (2, h, w) of the frame taken in, at half the resolution."""
        greys = [self._halved(grey) for grey in self.method.change.greys]
        for window in strips((slice(0, self.size[1]), slice(0, self.size[0]))):
            change, part = self._change[:, window[0]], self._slopes[:, window[0]]
            self.evaluate.strip(self.maps.changes(greys, window, change), window, part)
            part *= self.calm[window]
            part -= self.bias[:, window[0]]

    def windows(self, slopes: Planes) -> list[Window]:
        """Windows of the whole picture round what is not calm in its halved `slopes`, a block to spare.

        Lone pixels are noise.
        """
        height, width = self.method.reference.shape
        loud = np.abs(slopes[0]) > self.loud
        loud |= np.abs(slopes[1]) > self.loud
        self._seen[: self.size[1], : self.size[0]] = loud
        seen = cv2.morphologyEx(self._seen, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
        blocks = seen.reshape(seen.shape[0] // BLOCK, BLOCK, -1, BLOCK).any(axis=(1, 3)).view(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(cv2.dilate(blocks, np.ones((3, 3), np.uint8)))
        step, found = 2 * BLOCK, []
        for left, top, columns, rows, _ in stats[1:].tolist():
            found.append((slice(step * top, min(step * (top + rows), height)),
                          slice(step * left, min(step * (left + columns), width))))  # fmt: skip
        area = sum((rows.stop - rows.start) * (columns.stop - columns.start) for rows, columns in found)
        return found if area < MOST * height * width else [(slice(0, height), slice(0, width))]

    def _halved(self, plane: npt.NDArray[np.generic]) -> Picture:
        single = np.asarray(plane[self.even], np.float32)  # means of whole numbers would be rounded up
        return np.asarray(cv2.resize(single, self.size, interpolation=cv2.INTER_AREA))
