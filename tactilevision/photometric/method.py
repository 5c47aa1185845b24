"""Calibrated photometric methods: slopes of a rectified frame.

Where the surface hardly slopes, means of 2 by 2 to 4 by 4 pixels carry the same information at a fraction of the
work. The whole picture is evaluated in such means, and pixel by pixel in windows around slopes above
DETECTION_SIGMA deviations of a pixel's noise, or where neighbouring means differ by more than noise. Means have
their own noise and so their own bias: a method is evaluated so only if untouched frames evaluated so determined
it. The smoothing of a law by the noise of single pixels is applied to the law instead. Not for gel with marks,
which are filled in the whole picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.colour_change import (
    ChangeMaps,
    ColourChange,
    FrameChange,
    MissingColours,
    Patch,
    Window,
    common,
    inside,
    outside,
    strips,
    window_of,
)
from tactilevision.photometric.cross_validation import LightLaw
from tactilevision.photometric.drift import means, response_from_card, tile_px_of
from tactilevision.photometric.markers import fill
from tactilevision.photometric.methods.polynomial import PolynomialEvaluator
from tactilevision.photometric.methods.two_colours import COLOURS, UNKNOWN, TwoColourLaws
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.photometric.reference import (
    NOISE_LIMIT,
    BackgroundSums,
    Reference,
    background_over,
    damping,
    darkness,
    noise_bias,
)
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Bytes, Floats, Picture
from tactilevision.robust import median

DETECTION_SIGMA = 4  # deviations of a pixel's noise; less refines noise, more misses gentle contacts
SCATTER_SIGMA = 3.5  # deviations of the noise (or typical scatter) of 3 by 3 means
STRIDE = 4  # of the means that determine the typical scatter
BLOCK = 8  # approximate pixels of the grid of windows
MAX_WINDOW_SHARE = 0.5  # of the picture in windows; above, all of it is evaluated in full
MIN_SIDE_PX = 64  # shorter side of the picture below which nothing is saved

PAIR, ROUND = np.ones((2, 2), np.uint8), np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class SlopeReading:
    """The slopes of one frame: `fine` (2, rows, columns) in each of its `windows`.

    One window is the whole picture, unless gentle gel is read in means of `px` by `px` pixels, `coarse` (2, h, w).
    `valid` (H, W) where slopes are known; `frame` is the picture compared with the untouched gel, None for a
    method without a reference; `steepest` the greatest |slope|; `lost_share` the relative error of slopes where
    colours are missing, None where none is.
    """

    windows: Sequence[Window]
    fine: Sequence[Picture]
    valid: Bools
    frame: FrameChange | None = None
    steepest: float = np.inf
    lost_share: Patch | None = None
    coarse: Picture | None = None
    px: int = 1

    @cached_property
    def slopes(self) -> SlopeMap:
        """Return the slopes (H, W) of every pixel, those of gentle gel interpolated between means."""
        if self.coarse is None:
            return SlopeMap(self.fine[0][0], self.fine[0][1], self.valid)
        down, across = (self.px * count for count in self.coarse.shape[1:])
        slopes: Picture = np.empty((2, *self.valid.shape), np.float32)
        for plane, mean in zip(slopes, self.coarse, strict=True):
            cv2.resize(mean, (across, down), dst=plane[:down, :across], interpolation=cv2.INTER_LINEAR)
        slopes[:, down:] = slopes[:, down - 1, None]
        slopes[..., across:] = slopes[..., across - 1, None]
        for window, fine in zip(self.windows, self.fine, strict=True):
            slopes[:, *window] = fine
        return SlopeMap(slopes[0], slopes[1], self.valid)


@dataclass
class CalibratedMethod:
    """A colour law with its reference.

    `relative_error` is the law's own held-out error as a part of the slope; `card` is its provenance.
    `two_colours` read the pixels of which a colour is overexposed, which are invalid without them. `light_law` are
    the colours that slopes should have; None where balls did not determine them. `walls` is the wall law of
    certified faces; None where there were none.

    The slope of a pixel is `kept_share` (0 to 1) times that of the law, minus `bias` (2, H, W), of which
    `noise_bias` are the parts by noise; `noise` (H, W) is the deviation of a slope. `trusted_blocks` (h, w) are
    the blocks of the picture where the law holds, for the zero plane.
    Threads may share one, as long as none makes it `follow` the gel.
    """

    law: ColourLaw
    reference: Reference
    relative_error: float = 0.0
    background: Picture | None = None
    card: MethodCard = field(default_factory=MethodCard)
    two_colours: TwoColourLaws | None = None
    light_law: LightLaw | None = None
    walls: TaughtWalls | None = None

    def __post_init__(self) -> None:
        self.name = self.law.name
        self.change = ColourChange(self.reference, response_from_card(self.card.response))
        self.evaluate = self.law.evaluator(self.reference.shape)
        self._linear_noise = self.evaluate.noise(self.change.noise)
        self._dark = self.evaluate.noise(self.change.scale * darkness(self.change.maps.mean))
        self._damp()

    def _damp(self) -> None:
        """Compute what depends on the background."""
        noise = self._linear_noise
        background = np.stack([0 * noise, 0 * noise, noise])
        if self.background is not None:
            background = background_over(self.background, self.reference.shape)
        self.kept_share: Picture = np.asarray(1.0 / (1.0 + damping(background, self._dark) ** 2), np.float32)
        self._mean_bias = background[:2]
        self.noise: Picture = background[2] * self.kept_share
        self.readable: Bools = self.reference.usable & (self.kept_share > 0.5)
        kept_share = cv2.resize(self.kept_share, self.change.tracker.size, interpolation=cv2.INTER_AREA)
        self.trusted_blocks: Bools = np.asarray(kept_share > 0.95)

    @cached_property
    def noise_bias(self) -> tuple[Picture, Picture]:
        """Return the part of the bias by noise."""
        return noise_bias(self.evaluate, self.change.noise)

    @cached_property
    def bias(self) -> Picture:
        """Return what is subtracted from slopes, (2, H, W)."""
        return np.stack([(q + r) * self.kept_share for q, r in zip(self._mean_bias, self.noise_bias, strict=True)])

    @property
    def current_background(self) -> Picture:
        """Bias and noise on untouched gel, by blocks, also without ball pictures."""
        if self.background is not None:
            return self.background
        return BackgroundSums(self.reference.shape).result(self._linear_noise)

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
        """Return slopes (H, W) of a rectified frame (H, W, 3) uint8. Raises InputError if it cannot be read."""
        reading = self.read(rgb_rectified)
        slopes, lost = reading.slopes, reading.lost_share
        size = np.abs(slopes.dz_dx) + np.abs(slopes.dz_dy)
        std = np.float32(self.relative_error) * size + self.noise
        if lost is not None:
            at, error = lost.window, np.hypot(lost.values, np.float32(self.relative_error))
            std[at] = error * size[at] + self.noise[at]
        return replace(slopes, std=std)

    def read(self, rgb_rectified: Bytes) -> SlopeReading:
        """The slopes, without their deviation, and what was found on the way."""
        height, width = self.reference.shape
        whole = slice(0, height), slice(0, width)
        frame = self.change.take(rgb_rectified)
        slopes, steepest = self.read_window(frame, whole)
        return SlopeReading([whole], [slopes], self.valid(frame), frame, steepest, self.lost_share(frame))

    def at(self, change: Floats, place: Floats) -> Floats:
        """Return slopes (N, 2) of changes (N, 3) at places (N, 2), by two colours where a change is NaN."""
        if self.two_colours is None or np.isfinite(change).all():
            return self.law.at(change, place)
        return self.two_colours.at(change, place, otherwise=self.law)

    @cached_property
    def tiled_evaluator(self) -> TiledEvaluator | None:
        """Evaluator of gentle gel in means; None where the method was not calibrated for it (card)."""
        px = self.card.tile_px or 1
        return TiledEvaluator(self, px) if 1 < px <= tile_px_for(self) else None

    def read_window(self, frame: FrameChange, window: Window) -> tuple[Picture, float]:
        """Return the slopes (2, h, w) of a window of a frame, and the greatest |slope|.

        Where fewer than two colours are known, they are filled from around.
        """
        rows, columns = window
        slopes: Picture = np.empty((2, rows.stop - rows.start, columns.stop - columns.start), np.float32)
        steepest, missing = 0.0, frame.missing
        reader = self.two_colour_reader if missing else None
        both = common(window, missing.window) if reader and missing else None
        for part in strips(window):
            change, out = frame.strip(part), slopes[:, part[0].start - rows.start : part[0].stop - rows.start]
            self.evaluate.strip(change, part, out)
            out *= self.kept_share[part]
            out -= self.bias[:, *part]
            if both and reader and missing:
                reader.read_into(out, change, part, missing)
            steepest = max(steepest, cv2.norm(cv2.magnitude(out[0], out[1]), cv2.NORM_INF))
        if both and missing and (blind := missing.blind[inside(both, missing.window)]).any():
            mask = np.zeros(slopes.shape[1:], np.uint8)
            mask[inside(both, window)] = blind
            fill(slopes, mask)
        return slopes, steepest

    @cached_property
    def two_colour_reader(self) -> TwoColourReader | None:
        """What reads the pixels of which a colour is missing."""
        return None if self.two_colours is None else TwoColourReader(self.two_colours, self.change.noise)

    def valid(self, frame: FrameChange) -> Bools:
        """Return where (H, W) slopes of a frame are known: by all colours, or by two of them."""
        valid = frame.valid & self.readable
        if frame.missing is not None and self.two_colour_reader is not None:
            self.two_colour_reader.add_readable(valid, frame.missing)
        return valid

    def lost_share(self, frame: FrameChange) -> Patch | None:
        """Relative error of slopes of a frame, by missing colours; None where none is."""
        if frame.missing is None or self.two_colour_reader is None:
            return None
        return self.two_colour_reader.lost_share(frame.missing)

    def follow(self, rgb_rectified: Bytes, share: float) -> None:
        """Move the reference towards a picture of the untouched gel by `share` of the difference."""
        self.change.follow(rgb_rectified, share)
        if self.tiled_evaluator:
            self.tiled_evaluator.follow(rgb_rectified, share)

    def noted(self, **changes: Any) -> CalibratedMethod:
        """Return a copy with another `card` (of the same response), `light_law`, `walls` or `background`.

        Only what depends on the background is computed again. Both share what `follow` moves, except where the
        background or the tile differs: take such a copy before `follow`.
        """
        noted = copy(self)
        noted.__dict__.update(changes)
        if "background" in changes or noted.card.tile_px != self.card.tile_px:
            noted.__dict__.pop("bias", None)
            noted.__dict__.pop("tiled_evaluator", None)
            noted._damp()
        return noted

    def with_reference(self, reference: Reference) -> CalibratedMethod:
        """Return the method with another reference; by two colours if the third is dark only there."""
        dark, two = reference.dark_colour, self.two_colours
        if dark is None or dark == self.reference.dark_colour or two is None:
            return replace(self, reference=reference)
        error = float(np.hypot(self.relative_error, two.errors[dark]))
        return replace(self, reference=reference, law=two.laws[dark], relative_error=error, light_law=None)


class TwoColourReader:
    """Reader of slopes where a colour is missing (methods/two_colours.py), for pictures (H, W) of one size."""

    def __init__(self, laws: TwoColourLaws, noise: Picture) -> None:
        """`noise` (3, H, W) is the relative deviation of the changes."""
        self.laws = laws
        self.evaluators: list[PolynomialEvaluator] = [law.evaluator(noise.shape[1:]) for law in laws.laws]
        self.noise: list[Picture] = []
        for colour, evaluate in enumerate(self.evaluators):
            known = noise.copy()
            known[colour] = 0.0
            self.noise.append(evaluate.noise(known))
        self.kept_share: list[Picture] = [
            np.asarray(1.0 / (1.0 + (noise / NOISE_LIMIT) ** 2), np.float32) for noise in self.noise
        ]
        self.clear = [kept > 0.5 for kept in self.kept_share]

    def add_readable(self, valid: Bools, of: MissingColours) -> None:
        """Set `valid` (H, W) where two colours give slopes above their noise."""
        for colour in range(COLOURS):
            if self.laws.errors[colour] < UNKNOWN:
                valid[of.window] |= of.missing[colour] & of.partly & self.clear[colour][of.window]

    def read_into(self, slopes: Picture, change: Picture, window: Window, of: MissingColours) -> None:
        """Set `slopes` (2, h, w) of a window from changes (3, h, w) where one colour is missing, else 0."""
        if (both := common(window, of.window)) is None:
            return
        seen, part = inside(both, of.window), (slice(None), *inside(both, window))
        slopes, change = slopes[part], change[part]
        slopes[:, of.blind[seen]] = 0.0
        lacking = of.missing[:, *seen] & of.partly[seen]
        for colour, (where, box) in enumerate(zip(lacking, list(map(window_of, lacking)), strict=True)):
            if box is None:
                continue
            known, whole = change[:, *box].copy(), outside(box, both)
            known[colour] = 0.0
            read = np.empty((2, *known.shape[1:]), np.float32)
            self.evaluators[colour].strip(known, whole, read)
            read *= self.kept_share[colour][whole]
            np.copyto(slopes[:, *box], read, where=where[box])

    def lost_share(self, of: MissingColours) -> Patch:
        """Return the relative error of slopes where colours are missing."""
        errors = np.zeros(of.count.shape, np.float32)
        for colour in range(COLOURS):
            errors[of.missing[colour]] = self.laws.errors[colour]
        errors[of.count > 1] = UNKNOWN
        return Patch(of.window, errors)


# Gentle gel in means of pixels.


def tile_px_for(method: CalibratedMethod) -> int:
    """Return the pixels along each side of the means of gentle gel; 1 for evaluation pixel by pixel."""
    side = min(method.reference.shape)
    if method.reference.marks is not None or side < MIN_SIDE_PX:
        return 1
    return tile_px_of(method.reference)


class TiledEvaluator:
    """Evaluate frames by one method in means of `px` by `px` pixels."""

    def __init__(self, method: CalibratedMethod, px: int) -> None:
        self.method, self.px, self.shape = method, px, method.reference.shape
        height, width = self.shape
        self.size, full = (width // px, height // px), method.change.maps
        x, y = (
            np.asarray(places[: px * count].reshape(-1, px).mean(axis=1))
            for places, count in zip((full.x, full.y), self.size, strict=True)
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
        """Return the slopes of a frame, gentle gel in means. Raises as the method does."""
        frame = self.method.change.take(rgb)
        missing = frame.missing.tiles(self.px, self.size) if frame.missing and self.method.two_colours else None
        greys, light = frame.means(self.px), self.maps.light(frame.drift.gains)
        slopes: Picture = np.empty((2, *self.kept_share.shape), np.float32)
        for window in strips((slice(0, self.size[1]), slice(0, self.size[0]))):
            part = slopes[:, window[0]]
            self.evaluate.strip(self.maps.changes(greys[:, window[0]], window, light), window, part)
            part *= self.kept_share[window]
            part -= self.bias[:, window[0]]
        if missing is not None:
            slopes[:, missing > 0] = 0.0
        steepest = cv2.norm(cv2.magnitude(*slopes), cv2.NORM_INF)
        windows, fine = self.windows(slopes, missing=missing), []
        for window in windows:
            seen, steep = self.method.read_window(frame, window)
            steepest = max(steepest, steep)
            fine.append(seen)
        valid, lost_share = self.method.valid(frame), self.method.lost_share(frame)
        return SlopeReading(windows, fine, valid, frame, steepest, lost_share, slopes, self.px)

    def windows(self, slopes: Picture, *, missing: Bytes | None = None) -> list[Window]:
        """Return windows of the picture around steep or scattered `slopes` (2, h, w), with a margin of a block.

        Means where `missing` (h, w) is not 0 are included. Single steep means are noise.
        """
        height, width = self.shape
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

    def _over(self, planes: Picture) -> Picture:
        """Return means (n, h, w) of planes (n, H, W)."""
        return means(planes.transpose(1, 2, 0), self.px)


def _scatter(slopes: Picture) -> Picture:
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
