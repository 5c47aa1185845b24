"""What the parts of `photometric` ask of each other: methods, colour laws, and laws made ready for a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.colour_change import ColourChange, FrameChange, Planes
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.reference import Reference
from tactilevision.photometric.windows import Patch, Window
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Bytes, Floats

Picture = npt.NDArray[np.float32]


class PhotometricMethod(Protocol):
    """Anything with these members works everywhere; PHOTOMETRIC only lists the ones that come along."""

    name: str

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap: ...


class Evaluator(Protocol):
    """A colour law made ready for one picture size."""

    def __call__(self, change: Planes) -> tuple[Picture, Picture]: ...

    def strip(self, change: Planes, window: Window, out: Planes) -> None:
        """Slopes (2, h, w), into `out`, of the changes (3, h, w) of a window of the picture, STRIP_PX at most."""

    def noise(self, noise: Planes) -> Picture: ...


class ColourLaw(Protocol):
    """Slope as a function of colour change and place, free of any one sensor's reference picture."""

    @property
    def name(self) -> str: ...

    def at(self, change: Floats, place: Floats) -> Floats: ...

    def averaged(self, noise: Floats) -> ColourLaw:
        """The law that says of a colour what this one says, on the mean, of that colour with `noise` (3,)."""
        ...

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
    """A method that reads colour changes from a reference, pixel by pixel; pictures are (H, W) float32.

    `kept_share` of the law's slope is kept, 0 to 1; `bias` (2, H, W) is taken off it. `noise_bias` are the two
    parts of the bias that noise makes; `noise` is the deviation of a slope, without unit.
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
