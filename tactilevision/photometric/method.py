"""Calibrated photometric methods: slopes of a rectified frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.colour_change import ColourChange, Planes, strips
from tactilevision.photometric.cross_validation import LightLaw
from tactilevision.photometric.drift import response_from_card
from tactilevision.photometric.markers import fill
from tactilevision.photometric.methods.two_colours import TwoColourLaws, TwoColourReader
from tactilevision.photometric.multiresolution import TiledEvaluator, tile_px_for
from tactilevision.photometric.protocols import ColourLaw, PhotometricMethod, PixelMethod, Reading
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

    def read(self, rgb_rectified: Bytes) -> Reading: ...

    def follow(self, rgb_rectified: Bytes, share: float) -> None: ...

    def with_reference(self, reference: Reference) -> ReferencedMethod: ...

    def with_card(self, card: MethodCard) -> ReferencedMethod: ...


def as_referenced(method: object) -> ReferencedMethod | None:
    """Return the method if it has a reference, else None."""
    return method if isinstance(method, ReferencedMethod) else None


@dataclass
class CalibratedMethod:
    """A colour law with its reference.

    `relative_error`: held-out error relative to the slope. `card`: provenance and errors. `two_colours`: laws for
    pixels with an overexposed colour, which are not valid without. `light_law`: the shading law, None without
    balls. `walls`: corrections learned from certified faces, None without. Not thread-safe: buffers are reused;
    make one for each thread.
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

    def read(self, rgb_rectified: Bytes) -> Reading:
        """Return the slopes without their deviation, the drift, and the missing colours."""
        height, width = self.reference.shape
        whole = slice(0, height), slice(0, width)
        if self.reference.marks is None:
            drift, valid = self.change.take(rgb_rectified)
            parts = self.change.within(whole)
        else:
            changes, drift, valid = self.change.measure(rgb_rectified)
            parts = ((window, changes[:, window[0]]) for window in strips(whole))
        slopes: Planes = np.empty((2, height, width), np.float32)
        steepest = self._read_into(slopes, parts)
        self._fill_blind(slopes, whole)
        return Reading(SlopeMap(slopes[0], slopes[1], self.valid(valid)), drift, steepest, self.lost_share())

    def at(self, change: Floats, place: Floats) -> Floats:
        """Return slopes (N, 2) of changes (N, 3) at places (N, 2), by two colours where a change is NaN."""
        if self.two_colours is None or np.isfinite(change).all():
            return self.law.at(change, place)
        return self.two_colours.at(change, place, otherwise=self.law)

    def evaluate_tiled(self, rgb_rectified: Bytes) -> Reading:
        """Return as `read`, gentle gel in means of pixels, for surfaces without detail of single pixels."""
        reader = self.tiled_evaluator
        return reader.read(rgb_rectified) if reader else self.read(rgb_rectified)

    @cached_property
    def tiled_evaluator(self) -> TiledEvaluator | None:
        """Evaluator of gentle gel in means; None where the method was not calibrated for it (card)."""
        px = self.card.tile_px or 1
        return TiledEvaluator(self, px) if 1 < px <= tile_px_for(self) else None

    def read_window(self, window: Window) -> tuple[Planes, float]:
        """Return slopes (2, h, w) of a window of the current frame of `change`, and the greatest |slope|."""
        rows, columns = window
        slopes: Planes = np.empty((2, rows.stop - rows.start, columns.stop - columns.start), np.float32)
        steepest = self._read_into(slopes, self.change.within(window), top=rows.start)
        self._fill_blind(slopes, window)
        return slopes, steepest

    @cached_property
    def two_colour_reader(self) -> TwoColourReader | None:
        """Reader of pixels with a missing colour."""
        return None if self.two_colours is None else TwoColourReader(self.two_colours, self.change.noise)

    def valid(self, complete: Bools) -> Bools:
        """Return the mask (H, W) of known slopes: `complete` where all colours are known, or by two colours."""
        valid = complete & self.readable
        if self.change.missing is not None and self.two_colour_reader is not None:
            self.two_colour_reader.add_readable(valid, self.change.missing)
        return valid

    def lost_share(self) -> Patch | None:
        """Return the relative error of slopes of the current frame by missing colours; None without any."""
        if self.change.missing is None or self.two_colour_reader is None:
            return None
        return self.two_colour_reader.lost_share(self.change.missing)

    def _read_into(self, slopes: Planes, parts: Iterable[tuple[Window, Planes]], top: int = 0) -> float:
        """Set `slopes`, from row `top` on, from strips of changes (3, h, w), and return the greatest |slope|."""
        steepest = 0.0
        for window, change in parts:
            part = slopes[:, window[0].start - top : window[0].stop - top]
            self.evaluate.strip(change, window, part)
            part *= self.kept_share[window]
            part -= self.bias[:, *window]
            if self.change.missing is not None and self.two_colour_reader is not None:
                self.two_colour_reader.read_into(part, change, window, self.change.missing)
            steepest = max(steepest, cv2.norm(cv2.magnitude(part[0], part[1]), cv2.NORM_INF))
        return steepest

    def _fill_blind(self, slopes: Planes, window: Window) -> None:
        """Fill the slopes (2, h, w) of a window from around where fewer than two colours are known."""
        missing = self.change.missing
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
