"""What a photometric method is: a rectified frame in, slopes out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.change import ColourChange, Planes
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.quiet import Quiet, QuietSums, darkness, doubt, rest_bias
from tactilevision.photometric.reference import Reference
from tactilevision.records import Bytes, Floats, SlopeMap

Picture = npt.NDArray[np.float32]
Array = npt.NDArray[np.floating[Any]]


class PhotometricMethod(Protocol):
    """Anything with these members works everywhere; PHOTOMETRIC only lists the ones that come along."""

    name: str

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap: ...


class Evaluator(Protocol):
    """A colour law made ready for one picture size."""

    def __call__(self, change: Planes) -> tuple[Picture, Picture]: ...

    def noise(self, noise: Planes) -> Picture: ...


class ColourLaw(Protocol):
    """Slope as a function of colour change and place, free of any one sensor's reference picture."""

    @property
    def name(self) -> str: ...

    def at(self, change: Floats, place: Floats) -> Floats: ...

    def evaluator(self, shape: tuple[int, int]) -> Evaluator: ...

    def arrays(self) -> dict[str, Floats]: ...


@dataclass(frozen=True, slots=True)
class Reading:
    """What one frame says: its slopes, the drift of its light, and how strange each block of it is."""

    slopes: SlopeMap
    drift: Drift


@dataclass
class CalibratedMethod:
    """A colour law with the reference it is used against.

    `relative_error` is the law's own held-out error as a part of the slope. `card` says what it was made from.
    Not thread-safe: buffers are reused; make one for each thread.
    """

    law: ColourLaw
    reference: Reference
    relative_error: float = 0.0
    quiet: Quiet | None = None
    card: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.name = self.law.name
        self.change = ColourChange(self.reference)
        self.evaluate = self.law.evaluator(self.reference.shape)
        noise = self.evaluate.noise(self.change.noise)
        quiet = self.quiet.over(self.reference.shape) if self.quiet else (0 * noise, 0 * noise, noise)
        dark = self.evaluate.noise(self.change.scale * darkness(self.change.level))
        self.calm: Picture = np.asarray(1.0 / (1.0 + doubt(quiet, dark) ** 2), np.float32)
        rest = rest_bias(self.evaluate, self.change.noise)
        self.bias = (quiet[0] * self.calm + rest[0] * self.calm, quiet[1] * self.calm + rest[1] * self.calm)
        self.noise: Picture = quiet[2] * self.calm
        self.readable = self.reference.usable & (self.calm > 0.5)
        self.told = cv2.resize(self.calm, self.change.tracker.size, interpolation=cv2.INTER_AREA) > 0.95

    @property
    def quiet_now(self) -> Quiet:
        """What is known of untouched gel, as blocks, also where no ball picture told it."""
        if self.quiet is not None:
            return self.quiet
        return QuietSums(self.reference.shape).result(self.evaluate.noise(self.change.noise))

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
        """Slopes (H, W) of a rectified frame (H, W, 3) uint8.

        Raises InputError for a frame that cannot be read.
        """
        slopes = self.read(rgb_rectified).slopes
        return replace(slopes, std=self._std(slopes.dz_dx, slopes.dz_dy))

    def read(self, rgb_rectified: Bytes) -> Reading:
        """The slopes, without their deviation, and what was found on the way."""
        change, drift, valid = self.change.measure(rgb_rectified)
        dz_dx, dz_dy = self.evaluate(change)
        for slope, bias in zip((dz_dx, dz_dy), self.bias, strict=True):
            slope *= self.calm
            slope -= bias
        valid &= self.readable
        return Reading(SlopeMap(dz_dx, dz_dy, valid), drift)

    def follow(self, rgb_rectified: Bytes, share: float) -> None:
        """Move the reference towards a picture of the untouched gel by `share` of their difference."""
        self.change.follow(rgb_rectified, share)

    def with_reference(self, reference: Reference) -> CalibratedMethod:
        """The same law against another picture of the untouched gel."""
        return CalibratedMethod(self.law, reference, self.relative_error, self.quiet, self.card)

    def _std(self, dz_dx: Array, dz_dy: Array) -> Array:
        std = np.abs(dz_dx)
        std += np.abs(dz_dy)
        std *= np.float32(self.relative_error)
        std += self.noise
        return std
