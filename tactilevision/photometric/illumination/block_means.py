"""A frame in means of several pixels: what the light's drift is seen in, and gentle gel is read in."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.reference import Reference

Planes = npt.NDArray[np.float32]

TILES = 60  # means along the shorter side of the picture, about
MIN_TILE_PX = 2  # pixels along each side of a mean, at least
MAX_TILE_PX = 4  # pixels along each side of a mean, at most: wider ones blur the smallest contacts


def tile_px_of(reference: Reference) -> int:
    """Pixels along each side of the means in which frames are seen; marks are small, and seen finely."""
    return (
        MIN_TILE_PX
        if reference.marks is not None
        else min(MAX_TILE_PX, max(MIN_TILE_PX, round(min(reference.shape) / TILES)))
    )


def means(picture: npt.NDArray[np.generic], px: int, *, out: Planes | None = None) -> Planes:
    """Means (n, H // px, W // px) over `px` by `px` pixels of a picture (H, W, n).

    Exact for whole numbers, of 8 bits where `px` is 16 at most.
    """
    height, width, count = picture.shape[0] // px, picture.shape[1] // px, picture.shape[2]
    lines = picture[: px * height].reshape(height, px, -1)[..., : px * width * count]
    down = np.add.reduce(lines, axis=1, dtype=np.uint16 if picture.dtype == np.uint8 else np.float32).ravel()
    size = down.size - (px - 1) * count
    # the sum of every pixel and those behind it: quicker than of some, one by one
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
    """Share that each of `count` places on a line has in the mean of each block (blocks, count)."""
    return np.asarray(cv2.resize(np.eye(count, dtype=np.float32), (count, blocks), interpolation=cv2.INTER_AREA))
