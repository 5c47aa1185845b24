"""Calibrated photometric methods: slopes of a rectified frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.colour_change import ColourChange, FrameChange, Planes
from tactilevision.photometric.cross_validation import LightLaw
from tactilevision.photometric.drift import response_from_card
from tactilevision.photometric.markers import fill
from tactilevision.photometric.methods.two_colours import TwoColourLaws, TwoColourReader
from tactilevision.photometric.multiresolution import TiledEvaluator, tile_px_for
from tactilevision.photometric.protocols import ColourLaw, PhotometricMethod, PixelMethod, SlopeReading
from tactilevision.photometric.reference import (
    BackgroundSums,
    Reference,
    SlopeBackground,
    damping,
    darkness,
    noise_bias,
)
from tactilevision.photometric.windows import Patch, Window, common, inside
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Bytes, Floats

Picture = npt.NDArray[np.float32]
Array = npt.NDArray[np.floating[Any]]


@runtime_checkable
class ReferencedMethod(PhotometricMethod, PixelMethod, Protocol):
    """A method that compares a frame with a reference, follows its light, and has a known error.

    `trusted_blocks` (h, w): blocks of the picture where the law holds, for the zero plane.
    """

    relative_error: float
    background: SlopeBackground | None
    card: MethodCard
    two_colours: TwoColourLaws | None
    light_law: LightLaw | None
    trusted_blocks: Bools

    @property
    def tiled_evaluator(self) -> TiledEvaluator | None: ...

    def read(self, rgb_rectified: Bytes) -> SlopeReading: ...

    def follow(self, rgb_rectified: Bytes, share: float) -> None: ...

    def with_reference(self, reference: Reference) -> ReferencedMethod: ...

    def with_card(self, card: MethodCard) -> ReferencedMethod: ...


def as_referenced(method: object) -> ReferencedMethod | None:
    """Return the method if it has a reference, else None."""
    return method if isinstance(method, ReferencedMethod) else None


@dataclass
class CalibratedMethod:
    """A colour law with its reference.

    `relative_error` is the law's own held-out error as a part of the slope. `card` says what it was made from.
    `two_colours` read the pixels of which a colour is overexposed; None: nothing does, and they are not valid.
    `light_law` says which colours slopes should have; None where no ball told it. `walls` are what certified
    faces taught; None where there were none.
    Threads may share one, as long as none makes it `follow` the gel.
    """

    law: ColourLaw
    reference: Reference
    relative_error: float = 0.0
    background: SlopeBackground | None = None
    card: MethodCard = field(default_factory=MethodCard)
    two_colours: TwoColourLaws | None = None
    light_law: LightLaw | None = None
    walls: TaughtWalls | None = None

    def __post_init__(self) -> None:
        self.name = self.law.name
        self.change = ColourChange(self.reference, response_from_card(self.card.response))
        self.evaluate = self.law.evaluator(self.reference.shape)
        noise = self.evaluate.noise(self.change.noise)
        background = (
            self.background.over(self.reference.shape) if self.background else (0 * noise, 0 * noise, noise)
        )
        dark = self.evaluate.noise(self.change.scale * darkness(self.change.level))
        self.kept_share: Picture = np.asarray(1.0 / (1.0 + damping(background, dark) ** 2), np.float32)
        self.noise_bias = noise_bias(self.evaluate, self.change.noise)
        self.bias: Planes = np.stack(
            [(q + r) * self.kept_share for q, r in zip(background[:2], self.noise_bias, strict=True)]
        )
        self.noise: Picture = background[2] * self.kept_share
        self.readable: Bools = self.reference.usable & (self.kept_share > 0.5)
        kept_share = cv2.resize(self.kept_share, self.change.tracker.size, interpolation=cv2.INTER_AREA)
        self.trusted_blocks: Bools = np.asarray(kept_share > 0.95)

    @property
    def current_background(self) -> SlopeBackground:
        """Bias and noise on untouched gel, by blocks, also without ball pictures."""
        if self.background is not None:
            return self.background
        return BackgroundSums(self.reference.shape).result(self.evaluate.noise(self.change.noise))

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
        """Return slopes (H, W) of a rectified frame (H, W, 3) uint8. Raises InputError if it cannot be read."""
        reading = self.read(rgb_rectified)
        slopes = reading.slopes
        return replace(slopes, std=self._std(slopes.dz_dx, slopes.dz_dy, reading.lost_share))

    def read(self, rgb_rectified: Bytes) -> SlopeReading:
        """The slopes, without their deviation, and what was found on the way."""
        height, width = self.reference.shape
        whole = slice(0, height), slice(0, width)
        frame = self.change.take(rgb_rectified)
        slopes, steepest = self.read_window(frame, whole)
        return SlopeReading(
            SlopeMap(slopes[0], slopes[1], self.valid(frame)), frame, steepest, self.lost_share(frame)
        )

    def at(self, change: Floats, place: Floats) -> Floats:
        """Return slopes (N, 2) of changes (N, 3) at places (N, 2), by two colours where a change is NaN."""
        if self.two_colours is None or np.isfinite(change).all():
            return self.law.at(change, place)
        return self.two_colours.at(change, place, otherwise=self.law)

    def evaluate_tiled(self, rgb_rectified: Bytes) -> SlopeReading:
        """As `read`, gentle gel in means of pixels: for surfaces, in which single pixels do not matter."""
        reader = self.tiled_evaluator
        return reader.read(rgb_rectified) if reader else self.read(rgb_rectified)

    @cached_property
    def tiled_evaluator(self) -> TiledEvaluator | None:
        """Evaluator of gentle gel in means; None where the method was not calibrated for it (card)."""
        px = self.card.tile_px or 1
        return TiledEvaluator(self, px) if 1 < px <= tile_px_for(self) else None

    def read_window(self, frame: FrameChange, window: Window) -> tuple[Planes, float]:
        """Slopes (2, h, w) of a window of a frame, and the greatest |slope|."""
        rows, columns = window
        slopes: Planes = np.empty((2, rows.stop - rows.start, columns.stop - columns.start), np.float32)
        steepest = 0.0
        for part, change in frame.within(window):
            out = slopes[:, part[0].start - rows.start : part[0].stop - rows.start]
            self.evaluate.strip(change, part, out)
            out *= self.kept_share[part]
            out -= self.bias[:, *part]
            if frame.missing is not None and self.two_colour_reader is not None:
                self.two_colour_reader.read_into(out, change, part, frame.missing)
            steepest = max(steepest, cv2.norm(cv2.magnitude(out[0], out[1]), cv2.NORM_INF))
        self._fill_blind(slopes, window, frame)
        return slopes, steepest

    @cached_property
    def two_colour_reader(self) -> TwoColourReader | None:
        """What reads the pixels of which a colour is missing."""
        return None if self.two_colours is None else TwoColourReader(self.two_colours, self.change.noise)

    def valid(self, frame: FrameChange) -> Bools:
        """Where (H, W) slopes of a frame are told: by all colours, or by two of them."""
        valid = frame.valid & self.readable
        if frame.missing is not None and self.two_colour_reader is not None:
            self.two_colour_reader.add_readable(valid, frame.missing)
        return valid

    def lost_share(self, frame: FrameChange) -> Patch | None:
        """Relative error of slopes of a frame, by missing colours; None where none is."""
        if frame.missing is None or self.two_colour_reader is None:
            return None
        return self.two_colour_reader.lost_share(frame.missing)

    def _fill_blind(self, slopes: Planes, window: Window, frame: FrameChange) -> None:
        """Fill the slopes (2, h, w) of a window from around where fewer than two colours tell them."""
        missing = frame.missing
        if missing is None or self.two_colours is None or (both := common(window, missing.window)) is None:
            return
        blind = missing.blind[inside(both, missing.window)]
        if blind.any():
            mask = np.zeros(slopes.shape[1:], np.uint8)
            mask[inside(both, window)] = blind
            fill(slopes, mask)

    def follow(self, rgb_rectified: Bytes, share: float) -> None:
        """Move the reference towards a picture of the untouched gel by `share` of the difference."""
        self.change.follow(rgb_rectified, share)
        if self.tiled_evaluator:
            self.tiled_evaluator.follow(rgb_rectified, share)

    def with_reference(self, reference: Reference) -> CalibratedMethod:
        """Return the method with another reference; by two colours if the third is dark only there."""
        dark, two = reference.dark_colour, self.two_colours
        if dark is None or dark == self.reference.dark_colour or two is None:
            return replace(self, reference=reference)
        error = float(np.hypot(self.relative_error, two.errors[dark]))
        return replace(self, reference=reference, law=two.laws[dark], relative_error=error, light_law=None)

    def with_card(self, card: MethodCard) -> CalibratedMethod:
        """Return the method with another card."""
        return replace(self, card=card)

    def _std(self, dz_dx: Array, dz_dy: Array, lost: Patch | None) -> Array:
        size = np.abs(dz_dx) + np.abs(dz_dy)
        std = np.float32(self.relative_error) * size + self.noise
        if lost is not None:
            at, error = lost.window, np.hypot(lost.values, np.float32(self.relative_error))
            std[at] = error * size[at] + self.noise[at]
        return std
