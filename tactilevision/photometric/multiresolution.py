"""Evaluate gentle gel in means of several pixels, and contacts at full resolution.

Where the surface hardly slopes, means of 2 by 2 to 4 by 4 pixels carry the same information at a fraction of the
work. The whole picture is evaluated in such means, and pixel by pixel in windows around slopes above
DETECTION_SIGMA deviations of a pixel's noise, or where neighbouring means differ by more than noise. Means have
their own noise and so their own bias: a method is evaluated so only if untouched frames evaluated so determined
it. The smoothing of a law by the noise of single pixels is applied to the law instead. Not for gel with marks,
which are filled in the whole picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.colour_change import ChangeMaps, FrameChange, Planes, strips
from tactilevision.photometric.protocols import PixelMethod, SlopeReading
from tactilevision.photometric.reference import noise_bias
from tactilevision.photometric.windows import Patch, Window, means, tile_px_of
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Bytes
from tactilevision.robust import median

DETECTION_SIGMA = 4  # deviations of a pixel's noise; less refines noise, more misses gentle contacts
SCATTER_SIGMA = 3.5  # deviations of the noise (or typical scatter) of 3 by 3 means
STRIDE = 4  # of the means that determine the typical scatter
BLOCK = 8  # approximate pixels of the grid of windows
MAX_WINDOW_SHARE = 0.5  # of the picture in windows; above, all of it is evaluated in full
MIN_SIDE_PX = 64  # shorter side of the picture below which nothing is saved

PAIR, ROUND = np.ones((2, 2), np.uint8), np.ones((3, 3), np.uint8)

Picture = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class TiledSlopes:
    """What one frame says, gentle gel in means: slopes `coarse` (2, h, w), and `fine` (2, rows, columns) for
    each of the `windows` of the whole picture; the rest as in `SlopeReading`."""

    coarse: Planes
    windows: list[Window]
    fine: list[Planes]
    valid: Bools
    frame: FrameChange
    steepest: float
    lost_share: Patch | None = None


def tile_px_for(method: PixelMethod) -> int:
    """Return the pixels along each side of the means of gentle gel; 1 for evaluation pixel by pixel."""
    side = min(method.reference.shape)
    if method.reference.marks is not None or side < MIN_SIDE_PX:
        return 1
    return tile_px_of(method.reference)


class TiledEvaluator:
    """Evaluate frames by one method in means of `px` by `px` pixels."""

    def __init__(self, method: PixelMethod, px: int) -> None:
        self.method, self.px = method, px
        height, width = method.reference.shape
        self.size = width // px, height // px
        self.even = slice(0, px * self.size[1]), slice(0, px * self.size[0])
        full = method.change.maps
        x, y = (
            np.asarray(places[:end].reshape(-1, px).mean(axis=1))
            for places, end in ((full.x, self.even[1].stop), (full.y, self.even[0].stop))
        )
        self.maps = ChangeMaps(self._over(full.mean), x, y, dark=full.dark)
        noise = self._over(method.change.noise)
        missing = np.sqrt(1.0 - 1.0 / px**2) * np.median(noise, axis=(1, 2)).astype(np.float64)
        self.evaluate = method.law.averaged(missing).evaluator((len(y), len(x)))
        self.kept_share = self._over(method.kept_share[None])[0]
        extra = np.stack(noise_bias(self.evaluate, noise / np.float32(px)))
        extra -= self._over(np.stack(method.noise_bias))
        self.bias = self._over(method.bias) + extra * self.kept_share
        noise = self._over(method.noise[None])[0]
        self.slope_threshold = DETECTION_SIGMA * noise
        self.per_noise = np.where(self.kept_share > 0.5, noise / np.float32(px), np.float32(np.inf)) ** -2
        self.block = round(BLOCK / px)
        blocks = [-(-n // self.block) for n in self.kept_share.shape]
        self.padded = self.block * blocks[0], self.block * blocks[1]

    def follow(self, rgb: Bytes, share: float) -> None:
        """Move the reference towards `rgb` by `share` of the difference."""
        self.maps.mean += np.float32(share) * (means(rgb, self.px) - self.maps.mean)
        self.maps.update_scale()

    def read(self, rgb: Bytes) -> SlopeReading:
        """As the method's own reading, gentle gel in means."""
        tiles = self.read_tiles(rgb)
        return SlopeReading(self.full_map(tiles), tiles.frame, tiles.steepest, tiles.lost_share)

    def read_tiles(self, rgb: Bytes) -> TiledSlopes:
        """What a frame says; less work than `read`. Raises as the method does."""
        frame = self.method.change.take(rgb)
        slopes, lost_share = self._read(frame), self.method.lost_share(frame)
        told = frame.missing
        missing = None if lost_share is None or told is None else told.tiles(self.px, self.size)
        if missing is not None:
            slopes[:, missing > 0] = 0.0
        steepest = cv2.norm(cv2.magnitude(*slopes), cv2.NORM_INF)
        windows, fine = self.windows(slopes, missing=missing), []
        for window in windows:
            seen, steep = self.method.read_window(frame, window)
            steepest = max(steepest, steep)
            fine.append(seen)
        return TiledSlopes(slopes, windows, fine, self.method.valid(frame), frame, steepest, lost_share)

    def full_map(self, tiles: TiledSlopes) -> SlopeMap:
        """Return the slopes of `tiles` pixel by pixel."""
        down, across = (side.stop for side in self.even)
        slopes: Planes = np.empty((2, *self.method.reference.shape), np.float32)
        for plane, mean in zip(slopes, tiles.coarse, strict=True):
            cv2.resize(mean, (across, down), dst=plane[:down, :across], interpolation=cv2.INTER_LINEAR)
        slopes[:, down:] = slopes[:, down - 1, None]
        slopes[..., across:] = slopes[..., across - 1, None]
        for window, fine in zip(tiles.windows, tiles.fine, strict=True):
            slopes[:, *window] = fine
        return SlopeMap(slopes[0], slopes[1], tiles.valid)

    def _read(self, frame: FrameChange) -> Planes:
        """Return the slopes (2, h, w) of a frame in means."""
        greys, light = frame.means(self.px), self.maps.light(frame.drift.gains)
        slopes: Planes = np.empty((2, *self.kept_share.shape), np.float32)
        for window in strips((slice(0, self.size[1]), slice(0, self.size[0]))):
            part = slopes[:, window[0]]
            change = np.empty((3, *part.shape[1:]), np.float32)
            self.evaluate.strip(self.maps.changes(greys[:, window[0]], window, light, out=change), window, part)
            part *= self.kept_share[window]
            part -= self.bias[:, window[0]]
        return slopes

    def windows(self, slopes: Planes, *, missing: Bytes | None = None) -> list[Window]:
        """Return windows of the picture around steep or scattered `slopes` (2, h, w), with a margin of a block.

        Means where `missing` (h, w) is not 0 are included. Single steep means are noise.
        """
        height, width = self.method.reference.shape
        steepest = cv2.max(np.abs(slopes[0]), np.abs(slopes[1]))
        whole = np.zeros(self.padded, np.uint8)
        active = whole[: self.size[1], : self.size[0]]
        cv2.compare(steepest, self.slope_threshold, cv2.CMP_GT, dst=active)  # 255 where it is
        cv2.morphologyEx(active, cv2.MORPH_OPEN, PAIR, dst=active)
        scatter = cv2.multiply(_scatter(slopes), self.per_noise)
        typical_scatter = float(median(scatter[::STRIDE, ::STRIDE].ravel()))
        active |= cv2.compare(scatter, SCATTER_SIGMA**2 * max(1.0, typical_scatter), cv2.CMP_GT)
        if missing is not None:
            active |= missing
        size = self.padded[1] // self.block, self.padded[0] // self.block
        blocks = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)  # not 0 where any pixel is not
        _, _, stats, _ = cv2.connectedComponentsWithStats(cv2.dilate(blocks, ROUND))
        step, boxes = self.px * self.block, []
        for left, top, right, bottom in _merged_boxes(stats[1:, :4].tolist()):
            boxes.append(
                (slice(step * top, min(step * bottom, height)), slice(step * left, min(step * right, width)))
            )
        area = sum((rows.stop - rows.start) * (columns.stop - columns.start) for rows, columns in boxes)
        return boxes if area < MAX_WINDOW_SHARE * height * width else [(slice(0, height), slice(0, width))]

    def _over(self, planes: Planes) -> Planes:
        """Return means (n, h, w) of planes (n, H, W)."""
        return means(planes.transpose(1, 2, 0), self.px)


def _scatter(slopes: Planes) -> Picture:
    """Return the variance (h, w) of slopes (2, h, w) over 3 by 3 of them, the sum of both."""
    p, q = slopes
    total = cv2.blur(cv2.add(cv2.multiply(p, p), cv2.multiply(q, q)), (3, 3))
    for mean in (cv2.blur(p, (3, 3)), cv2.blur(q, (3, 3))):
        total = cv2.subtract(total, cv2.multiply(mean, mean, dst=mean), dst=total)
    return np.asarray(total)


def _merged_boxes(boxes: Sequence[Sequence[int]]) -> list[tuple[int, int, int, int]]:
    """Return boxes (left, top, right, bottom) of (left, top, width, height), with overlapping ones merged."""
    merged: list[tuple[int, int, int, int]] = []
    for left, top, width, height in boxes:
        right, bottom = left + width, top + height
        while overlapping := [b for b in merged if left < b[2] and b[0] < right and top < b[3] and b[1] < bottom]:
            merged.remove(overlapping[0])
            left, top = min(left, overlapping[0][0]), min(top, overlapping[0][1])
            right, bottom = max(right, overlapping[0][2]), max(bottom, overlapping[0][3])
        merged.append((left, top, right, bottom))
    return merged
