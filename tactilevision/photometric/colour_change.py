"""Colour change relative to the untouched gel, and the colours lost to overexposure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.drift import (
    SOFTENING_GREY,
    Drift,
    DriftTracker,
    Response,
    means,
    undo_drift,
)
from tactilevision.photometric.markers import fill_marks, marked
from tactilevision.photometric.reference import SATURATED, Reference, darkest_grey
from tactilevision.records.measured import Bools, Bytes, Floats, Picture

# Windows of a picture.

Window = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True, slots=True)
class Patch:
    """`values` (h, w) in the `window` of a picture that is 0 elsewhere."""

    window: Window
    values: Picture


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


# Colours that are overexposed in a frame or in the reference, in the window that holds all of them.


@dataclass(frozen=True, slots=True)
class MissingColours:
    """The colours `missing` (3, h, w) in a `window` of a picture, and their `count` (h, w).

    `partly` (h, w): two colours with enough light remain; `blind` (h, w): fewer do.
    """

    window: Window
    missing: Bools
    count: Bytes
    partly: Bools
    blind: Bools

    def tiles(self, px: int, size: tuple[int, int]) -> Bytes:
        """Return `size` (w, h) tiles of `px` by `px` pixels: 255 where a colour is missing, else 0."""
        tiles = np.zeros(size[::-1], np.uint8)
        if (both := common(self.window, (slice(0, px * size[1]), slice(0, px * size[0])))) is not None:
            lacking = self.count[inside(both, self.window)]
            seen = [slice(along.start // px, -(-along.stop // px)) for along in both]
            for axis, (tile, along) in enumerate(zip(seen, both, strict=True)):
                starts = np.maximum(px * np.arange(tile.start, tile.stop) - along.start, 0)
                lacking = np.maximum.reduceat(lacking, starts, axis=axis)
            tiles[*seen] = np.where(lacking > 0, 255, 0)
        return tiles


def _overexposed_window(rgb: Bytes) -> Window | None:
    if rgb.max() < SATURATED:
        return None
    rows = np.flatnonzero(rgb.reshape(len(rgb), -1).max(axis=1) >= SATURATED)
    down = slice(int(rows[0]), int(rows[-1]) + 1)
    columns = np.flatnonzero(rgb[down].max(axis=0).max(axis=1) >= SATURATED)
    return down, slice(int(columns[0]), int(columns[-1]) + 1)


# Colour change against the untouched gel, from which slope follows:
#
#     u_c = (I_c / (1 + drift_c) - I0_c) / (I0_c + s)
#
# Stray light and separately fading lamps are corrected first, in light (`drift.py`). Division by the local
# brightness makes u nearly the same function of slope all over the picture; the softening s limits the noise of
# dark places. The mean drift divides, its gradient is applied to first order. Marks on the gel are filled in I0
# and in each u. Colours that are overexposed in the frame or in I0 are missing at a pixel. One that is dark all
# over the untouched gel counts as unchanged: u_c = 0.

SHADOW_PX = 4  # step of the search for shadows
STRIP_PX = 25000  # pixels processed at once, so that intermediate arrays stay in the cache

Light = tuple[Picture, Picture]  # down and across: the factor of grey at a place is their product


class ChangeMaps:
    """Colour changes against an untouched picture `mean` (3, h, w), at places x (w,), y (h,)."""

    def __init__(self, mean: Picture, x: Picture, y: Picture, *, dark: int | None) -> None:
        """`dark`: number of the colour that counts as unchanged, or None."""
        self.mean, self.x, self.y, self.dark = mean, x, y, dark
        self.scale: Picture = np.empty_like(mean)
        self.update_scale()

    def update_scale(self) -> None:
        """Update the scale after a change of `mean`."""
        np.add(self.mean, np.float32(SOFTENING_GREY), out=self.scale)
        np.reciprocal(self.scale, out=self.scale)
        if self.dark is not None:
            self.scale[self.dark] = 1.0 / SOFTENING_GREY

    def light(self, gains: Floats) -> Light:
        """Return down (3, h, 2) and across (3, 2, w) of a drift's `gains` (3, 3).

        The factor of grey, a plane over the picture, is the product of these thin matrices.
        """
        down, across = np.ones((3, len(self.y), 2), np.float32), np.ones((3, 2, len(self.x)), np.float32)
        share = 1.0 / (1.0 + gains[:, 0, None])
        down[:, :, 0] = share * (1.0 - share * gains[:, 2, None] * self.y)
        across[:, 1] = -share * share * gains[:, 1, None] * self.x
        if self.dark is not None:
            down[self.dark] = 0.0  # of its grey nothing counts: (0 + s) / s - 1 = 0
        return down, across

    def changes(
        self,
        greys: Sequence[npt.NDArray[Any]] | Picture,
        window: Window,
        light: Light,
        *,
        out: Picture | None = None,
    ) -> Picture:
        """Return changes (I gain + s) / (I0 + s) - 1 of a window's channels (3, h, w) in this light."""
        rows, columns = window
        down, across = light
        out = np.matmul(down[:, rows], across[..., columns], out=out)
        for grey, plane in zip(greys, out, strict=True):
            cv2.multiply(grey, plane, dst=plane, dtype=cv2.CV_32F)
        out += np.float32(SOFTENING_GREY)
        out *= self.scale[:, rows, columns]
        out -= np.float32(1.0)
        return out


@dataclass(frozen=True, eq=False)
class FrameChange:
    """One rectified frame (H, W, 3) compared with the untouched gel of `reference`.

    `drift` of its light; the colours `missing` from it, None where all are known; `valid` (H, W) where all are.
    """

    reference: ColourChange
    rgb: Bytes
    drift: Drift
    missing: MissingColours | None
    valid: Bools

    @cached_property
    def light(self) -> Light:
        """The factors of grey by the drift of the light."""
        return self.reference.maps.light(self.drift.gains)

    def strip(self, window: Window) -> Picture:
        """Return the changes (3, h, w) of a window, one of `strips`; with marks, a part of `changes`."""
        if self.reference.reference.marks is not None:
            return self.changes[:, *window]
        return self.reference.maps.changes(self.greys(window), window, self.light)

    @cached_property
    def changes(self) -> Picture:
        """The changes (3, H, W), marks filled from around."""
        whole: Picture = np.empty_like(self.reference.maps.mean)
        for window in strips((slice(0, self.rgb.shape[0]), slice(0, self.rgb.shape[1]))):
            self.reference.maps.changes(self.greys(window), window, self.light, out=whole[:, window[0]])
        if self.reference.reference.marks is not None:
            fill_marks(whole, marked(self.rgb, self.reference.reference.marks))
        return whole

    def greys(self, window: Window) -> Sequence[npt.NDArray[Any]]:
        """Channels (3, h, w) of a window."""
        greys, undo = cv2.split(self.rgb[window]), self.drift.undo
        return greys if undo is None else list(undo_drift(greys, undo, power=self.reference.tracker.power))

    def means(self, px: int) -> Picture:
        """Channels (3, H // px, W // px) in means of `px` by `px` pixels.

        Light is mixed in them as in pixels: what that misses goes with the noise squared, by the little mixed.
        """
        tracker, undo = self.reference.tracker, self.drift.undo
        known = self.drift.means if px == tracker.px else None
        planes = means(self.rgb, px) if known is None else known
        return planes if undo is None else undo_drift(planes, undo, power=tracker.power)


class ColourChange:
    """Turns rectified frames into colour changes (3, H, W) float32."""

    def __init__(self, reference: Reference, response: Response | None = None) -> None:
        self.reference = reference
        self.tracker = DriftTracker(reference, response or Response())
        mean: Picture = np.array(reference.rgb.transpose(2, 0, 1), np.float32, order="C")
        if reference.marks is not None:
            fill_marks(mean, reference.marks.mask)
        x, y = (np.linspace(-1, 1, n, dtype=np.float32) for n in reference.shape[::-1])
        self.maps = ChangeMaps(mean, x, y, dark=reference.dark_colour)
        self.noise: Picture = self.scale * np.asarray(reference.noise_grey, np.float32)[:, None, None]
        self.darkest = int(darkest_grey(reference.noise_grey))  # of whole numbers
        self.overexposed, self.lit_by_two = reference.overexposed, reference.lit_by_two
        self._overexposed_window = (
            None if self.overexposed is None else window_of(np.asarray(self.overexposed.any(axis=0)))
        )

    def measure(self, rgb: Bytes) -> tuple[Picture, Drift, Bools]:
        """Changes (3, H, W), drift, and validity (H, W) of a frame."""
        frame = self.take(rgb)
        return frame.changes, frame.drift, frame.valid

    def measure_known(self, rgb: Bytes) -> tuple[Picture, Drift, Bools]:
        """As `measure`, changes that are not known NaN, and valid (H, W) where two colours are known."""
        frame = self.take(rgb)
        changes, valid = frame.changes, frame.valid
        if frame.missing is not None:
            window, valid = frame.missing.window, valid.copy()
            changes[:, *window][frame.missing.missing] = np.nan
            valid[window] |= frame.missing.partly
        return changes, frame.drift, valid

    def take(self, rgb: Bytes) -> FrameChange:
        """Compare a frame with the untouched gel. Raises InputError for one that cannot be of this sensor."""
        self._check(rgb)
        missing, valid = self.find_missing(rgb), self.reference.usable
        if self.in_shadow(rgb, missing):
            valid = valid & (brightest(rgb) > self.darkest)
        if missing is not None:
            valid = valid.copy()
            valid[missing.window] &= missing.count == 0
        return FrameChange(self, rgb, self.tracker.measure(rgb), missing, valid)

    def find_missing(self, rgb: Bytes) -> MissingColours | None:
        """Return the colours missing in a frame (H, W, 3) or its reference; None for none."""
        windows = [window for window in (_overexposed_window(rgb), self._overexposed_window) if window is not None]
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

    def in_shadow(self, rgb: Bytes, missing: MissingColours | None) -> bool:
        """Whether shadows are to be looked for in all of a frame: few of its pixels tell, unless it is bright."""
        line = rgb.ravel()
        if np.maximum(line[1:], line[:-1]).min() > self.darkest:  # no two adjacent colours are dark
            return False
        return missing is not None or bool(brightest(rgb[::SHADOW_PX, ::SHADOW_PX]).min() <= self.darkest)

    def follow(self, rgb: Bytes, share: float) -> None:
        """Move the reference towards `rgb` by `share` of the difference, in place."""
        marks = self.reference.marks
        gel = None if marks is None else np.asarray(1 - marked(rgb, marks), np.uint8)
        for mean, grey in zip(self.maps.mean, cv2.split(rgb), strict=True):
            cv2.accumulateWeighted(grey, mean, share, mask=gel)
        self.tracker.follow(rgb, share)
        self.maps.update_scale()

    @property
    def scale(self) -> Picture:
        """Change (3, H, W) per grey level; 0 for a colour that counts as unchanged."""
        scale = self.maps.scale
        if self.maps.dark is not None:
            scale = scale.copy()
            scale[self.maps.dark] = 0.0
        return scale

    def _check(self, rgb: Bytes) -> None:
        if rgb.shape != self.reference.rgb.shape or rgb.dtype != np.uint8:
            raise InputError(
                "the frame does not match the reference in size or type",
                where="frame",
                value=f"{rgb.shape} {rgb.dtype}, the reference has {self.reference.rgb.shape} uint8",
                remedy="Use frames and reference of the same sensor and stream.",
            )


def brightest(rgb: Bytes) -> Bytes:
    """Return the maximum (H, W) over the channels of a picture (H, W, 3)."""
    red, green, blue = cv2.split(rgb)
    return np.asarray(cv2.max(cv2.max(red, green), blue))


def strips(window: Window) -> list[Window]:
    """Return the window in strips of whole rows, of STRIP_PX at most (but one row at least)."""
    rows, columns = window
    step = max(1, STRIP_PX // (columns.stop - columns.start))
    return [(slice(top, min(top + step, rows.stop)), columns) for top in range(rows.start, rows.stop, step)]
