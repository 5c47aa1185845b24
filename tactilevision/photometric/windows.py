"""Windows of a picture, means over its blocks, and distances to the edge of a mask."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.reference import Reference
from tactilevision.records.measured import Bools

Window = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True, slots=True)
class Patch:
    """`values` (h, w) in the `window` of a picture that is 0 elsewhere."""

    window: Window
    values: npt.NDArray[np.float32]


def window_of(where: Bools) -> Window | None:
    """Return the rows and columns that contain a mask (h, w), None for an empty one."""
    left, top, width, height = cv2.boundingRect(where.view(np.uint8))
    return (slice(top, top + height), slice(left, left + width)) if width else None


def common(one: Window, other: Window) -> Window | None:
    """Return the intersection of two windows; None for an empty one."""
    rows, columns = (slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one, other, strict=True))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


def inside(window: Window, of: Window) -> Window:
    """Return a window of the picture relative to another that contains it."""
    rows, columns = (slice(a.start - b.start, a.stop - b.start) for a, b in zip(window, of, strict=True))
    return rows, columns


def outside(window: Window, of: Window) -> Window:
    """Return a window relative to another as one of the picture."""
    rows, columns = (slice(a.start + b.start, a.stop + b.start) for a, b in zip(window, of, strict=True))
    return rows, columns


# Means over several pixels.

Planes = npt.NDArray[np.float32]

TILES = 60  # approximate number of means along the shorter side of the picture
MIN_TILE_PX = 2  # pixels along each side of a mean at least
MAX_TILE_PX = 4  # at most: wider ones blur the smallest contacts


def tile_px_of(reference: Reference) -> int:
    """Return the pixels along each side of the means of frames, the least for gel with marks."""
    if reference.marks is not None:
        return MIN_TILE_PX
    return min(MAX_TILE_PX, max(MIN_TILE_PX, round(min(reference.shape) / TILES)))


def means(picture: npt.NDArray[np.generic], px: int, *, out: Planes | None = None) -> Planes:
    """Return means (n, H // px, W // px) over `px` by `px` pixels of a picture (H, W, n).

    Exact for integers; of 8 bits with `px` up to 16.
    """
    height, width, count = picture.shape[0] // px, picture.shape[1] // px, picture.shape[2]
    lines = picture[: px * height].reshape(height, px, -1)[..., : px * width * count]
    down = np.add.reduce(lines, axis=1, dtype=np.uint16 if picture.dtype == np.uint8 else np.float32).ravel()
    size = down.size - (px - 1) * count
    # running sums over all pixels: faster than strided sums
    total = sum((down[k * count :][:size] for k in range(1, px)), down[:size])
    if out is None:
        out = np.empty((count, height, width), np.float32)
    share = np.float32(1.0 / px)
    for c, plane in enumerate(out):
        np.multiply(total[c :: px * count].reshape(height, width), share, out=plane)
    out *= share
    return out


@lru_cache(maxsize=64)
def shares(count: int, blocks: int) -> Planes:
    """Return the shares (blocks, count) of `count` places on a line in the mean of each block."""
    return np.asarray(cv2.resize(np.eye(count, dtype=np.float32), (count, blocks), interpolation=cv2.INTER_AREA))


# Reproducible distance transform: the last bits of the square root in OpenCV's precise transform depend on memory
# alignment. Squared distances in pixels are integers, so they are rounded before numpy's square root.


def distance_px(inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Return the distance (H, W) in px of each place inside the mask (H, W) to the nearest one outside; 0 outside.

    float32, for masks of less than 2896 px across (squares to 2^24).
    """
    distance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distance *= distance
    np.rint(distance, out=distance)
    return np.asarray(np.sqrt(distance, out=distance), np.float32)
