"""Colours that a frame does not tell: they are overexposed in it, or in the picture of the untouched gel.

Mostly few pixels lack one, close together: all that is asked of them is asked in the window that holds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.photometric.reference import SATURATED, Reference
from tactilevision.photometric.windows import Window, common, inside, window_of
from tactilevision.records import Bools, Bytes


@dataclass(frozen=True, slots=True)
class MissingColours:
    """In a `window` of a picture: which colours are `missing` (3, h, w), and the `count` (h, w) of them.

    `partly` (h, w): two are left, and light enough to tell slopes; `blind` (h, w): fewer do.
    """

    window: Window
    missing: Bools
    count: Bytes
    partly: Bools
    blind: Bools

    def tiles(self, px: int, size: tuple[int, int]) -> Bytes:
        """Tiles of `px` by `px` pixels, `size` (w, h) of them, of which some lack a colour: 255 there."""
        tiles = np.zeros(size[::-1], np.uint8)
        if (both := common(self.window, (slice(0, px * size[1]), slice(0, px * size[0])))) is not None:
            lacking = self.count[inside(both, self.window)]
            seen = [slice(along.start // px, -(-along.stop // px)) for along in both]
            for axis, (tile, along) in enumerate(zip(seen, both, strict=True)):
                starts = np.maximum(px * np.arange(tile.start, tile.stop) - along.start, 0)
                lacking = np.maximum.reduceat(lacking, starts, axis=axis)
            tiles[*seen] = np.where(lacking > 0, 255, 0)
        return tiles


class MissingColoursFinder:
    """Finds them in frames against one reference, whose own are known."""

    def __init__(self, reference: Reference) -> None:
        self.overexposed, self.lit_by_two = reference.overexposed, reference.lit_by_two
        over = self.overexposed
        self.window = None if over is None else window_of(np.asarray(over.any(axis=0)))

    def find(self, rgb: Bytes) -> MissingColours | None:
        """The colours that a frame (H, W, 3) or its reference lacks; None: it tells all of them."""
        windows = [window for window in (_overexposed_window(rgb), self.window) if window is not None]
        if not windows:
            return None
        rows, columns = (
            slice(min(one.start for one in along), max(one.stop for one in along))
            for along in zip(*windows, strict=True)
        )
        missing = np.ascontiguousarray((rgb[rows, columns] >= SATURATED).transpose(2, 0, 1))
        if self.overexposed is not None:
            missing |= self.overexposed[:, rows, columns]
        red, green, blue = missing.view(np.uint8)
        count = red + green + blue
        partly = self.lit_by_two[rows, columns] & (count == 1)
        return MissingColours((rows, columns), missing, count, partly, count > partly)


def _overexposed_window(rgb: Bytes) -> Window | None:
    if rgb.max() < SATURATED:
        return None
    rows = np.flatnonzero(rgb.reshape(len(rgb), -1).max(axis=1) >= SATURATED)
    down = slice(int(rows[0]), int(rows[-1]) + 1)
    columns = np.flatnonzero(rgb[down].max(axis=0).max(axis=1) >= SATURATED)
    return down, slice(int(columns[0]), int(columns[-1]) + 1)
