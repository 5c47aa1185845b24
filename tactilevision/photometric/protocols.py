"""Interfaces of photometric methods, colour laws, and their evaluators."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.colour_change import Window, strips
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bytes, Floats, Picture


class Progress(Protocol):
    """Callback with the progress of a calibration: `done` of `total` steps of a pass, and what the pass does."""

    def __call__(self, done: int, total: int, what: str = "") -> None: ...


def silent(done: int, total: int, what: str = "") -> None:
    """Ignore the progress."""


class PhotometricMethod(Protocol):
    """Photometric method; PHOTOMETRIC lists the built-in ones."""

    name: str

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap: ...


class Evaluator(ABC):
    """A colour law prepared for one picture size; the intermediate arrays of a strip stay in the cache."""

    @abstractmethod
    def strip(self, change: Picture, window: Window, out: Picture) -> None:
        """Write slopes (2, h, w) of the changes (3, h, w) of a window, one of `strips`, to `out`."""

    @abstractmethod
    def noise(self, noise: Picture) -> Picture:
        """Return the standard deviation (H, W) of a slope on untouched gel from that of the changes (3, H, W)."""

    def __call__(self, change: Picture) -> tuple[Picture, Picture]:
        """Return slopes (H, W) and (H, W) of changes (3, H, W)."""
        out = np.empty((2, *change.shape[1:]), np.float32)
        for window in strips((slice(0, change.shape[1]), slice(0, change.shape[2]))):
            self.strip(change[:, window[0]], window, out[:, window[0]])
        return out[0], out[1]


@dataclass(frozen=True)
class Stored:
    """A dataclass of numbers and arrays that is stored by the names of its fields."""

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {one.name: np.asarray(getattr(self, one.name)) for one in fields(self)}


class ColourLaw(Protocol):
    """Slope as a function of colour change and place, without a reference picture."""

    @property
    def name(self) -> str: ...

    def at(self, change: Floats, place: Floats) -> Floats: ...

    def averaged(self, noise: Floats) -> ColourLaw:
        """Return the law of mean slopes for colours with `noise` (3,)."""

    def evaluator(self, shape: tuple[int, int]) -> Evaluator: ...

    def arrays(self) -> dict[str, npt.NDArray[Any]]: ...
