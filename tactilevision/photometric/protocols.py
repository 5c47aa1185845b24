"""Interfaces of photometric methods, colour laws, and their evaluators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.colour_change import ColourChange, FrameChange, Planes, strips
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.reference import Reference
from tactilevision.photometric.windows import Patch, Window
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Bytes, Floats

Picture = npt.NDArray[np.float32]


class PhotometricMethod(Protocol):
    """Photometric method; PHOTOMETRIC lists the built-in ones."""

    name: str

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap: ...


class Evaluator(Protocol):
    """A colour law prepared for one picture size."""

    def __call__(self, change: Planes) -> tuple[Picture, Picture]: ...

    def strip(self, change: Planes, window: Window, out: Planes) -> None:
        """Write slopes (2, h, w) of the changes (3, h, w) of a window, of STRIP_PX at most, to `out`."""

    def noise(self, noise: Planes) -> Picture: ...


class StripEvaluator:
    """Evaluator of a whole picture by `strip`, so that intermediate arrays stay in the cache."""

    def strip(self, change: Planes, window: Window, out: Planes) -> None:
        raise NotImplementedError

    def __call__(self, change: Planes) -> tuple[Picture, Picture]:
        """Return slopes (H, W) and (H, W) of changes (3, H, W)."""
        out = np.empty((2, *change.shape[1:]), np.float32)
        for window in strips((slice(0, change.shape[1]), slice(0, change.shape[2]))):
            self.strip(change[:, window[0]], window, out[:, window[0]])
        return out[0], out[1]


class ColourLaw(Protocol):
    """Slope as a function of colour change and place, without a reference picture."""

    @property
    def name(self) -> str: ...

    def at(self, change: Floats, place: Floats) -> Floats: ...

    def averaged(self, noise: Floats) -> ColourLaw:
        """Return the law of mean slopes for colours with `noise` (3,)."""

    def evaluator(self, shape: tuple[int, int]) -> Evaluator: ...

    def arrays(self) -> dict[str, Floats]: ...


@dataclass(frozen=True, slots=True)
class SlopeReading:
    """The slopes of one frame, the frame beside the untouched gel, and the greatest |slope|.

    `lost_share`: relative error of a slope where colours are missing; None where none is.
    """

    slopes: SlopeMap
    frame: FrameChange
    steepest: float
    lost_share: Patch | None = None

    @property
    def drift(self) -> Drift:
        """Of the frame's light."""
        return self.frame.drift


class PixelMethod(Protocol):
    """A method that evaluates colour changes against a reference pixel by pixel; pictures are (H, W) float32.

    slope = `kept_share` (0 to 1) times that of the law, minus `bias` (2, H, W), of which `noise_bias` are the
    parts by noise; `noise` is the deviation of a slope.
    """

    law: ColourLaw
    evaluate: Evaluator
    reference: Reference
    change: ColourChange
    kept_share: Picture
    noise_bias: tuple[Picture, Picture]
    bias: Planes
    noise: Picture
    readable: Bools

    def valid(self, frame: FrameChange) -> Bools: ...

    def lost_share(self, frame: FrameChange) -> Patch | None: ...

    def read_window(self, frame: FrameChange, window: Window) -> tuple[Planes, float]: ...
