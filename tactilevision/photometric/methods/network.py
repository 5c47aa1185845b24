"""Slope out of a small network, run by onnxruntime.

    (p, q) = M(u, X, Y) u        u (3,) the colour change, X, Y the place from -1 to 1

M (2, 3) is a perceptron's output, the same at every pixel: convolutions of one pixel, so that the ONNX file takes
a picture (1, 5, h, w) of any size. No change of colour is no slope, whatever the weights. A picture is run in
strips of rows whose layers stay in the cache, on one core: up to half as long as the whole at once.
Valid for slopes the balls reached; the result is held to REACH times the steepest slope seen.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.illumination.colour_change import STRIP_PX, strips
from tactilevision.photometric.methods.onnx_file import open_bytes, run_network
from tactilevision.photometric.methods.polynomial import REACH
from tactilevision.photometric.windows import Window
from tactilevision.records import Floats

CHANGE_STEP = 0.05  # colour change over which the slope of the law at rest is taken

Picture = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Network:
    """`content` of an ONNX file; `steepest` slope among the samples; `source`, the file, for what errors say."""

    content: bytes
    steepest: float
    source: Path = Path("network.onnx")

    name = "network"

    def __reduce__(self) -> tuple[type[Network], tuple[bytes, float, Path]]:
        """For other processes: each opens the file itself."""
        return Network, (self.content, self.steepest, self.source)

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.content).hexdigest()

    @cached_property
    def session(self) -> Any:
        return open_bytes(self.content, self.sha256, where=self.source)

    def at(self, change: Floats, place: Floats) -> Floats:
        """Slopes (N, 2) for changes (N, 3) at places (N, 2)."""
        inputs = np.concatenate([change, place], axis=1).astype(np.float32)
        bound = REACH * self.steepest
        slopes = run_network(self.session, np.ascontiguousarray(inputs.T)[None, :, None])
        return np.asarray(np.clip(slopes[0, :, 0].T, -bound, bound), np.float64)

    def averaged(self, noise: Floats) -> Network:
        """Itself: it is as smooth as a polynomial."""
        return self

    def evaluator(self, shape: tuple[int, int]) -> NetworkEvaluator:
        return NetworkEvaluator(self, shape)

    def arrays(self) -> dict[str, Floats]:
        return {"steepest": np.array(self.steepest)}


class NetworkEvaluator:
    """The network over a whole picture, strip by strip."""

    def __init__(self, network: Network, shape: tuple[int, int]) -> None:
        self.network, self.session, self.shape, self.content = network, network.session, shape, network.content
        self.bound = np.float32(REACH * network.steepest)
        x, y = (np.linspace(-1, 1, n, dtype=np.float32) for n in shape[::-1])
        self.place = np.stack(np.meshgrid(x, y))
        self._inputs = np.empty(5 * max(STRIP_PX, shape[1]), np.float32)

    def __reduce__(self) -> tuple[type[NetworkEvaluator], tuple[Network, tuple[int, int]]]:
        return NetworkEvaluator, (self.network, self.shape)

    def __call__(self, change: Picture) -> tuple[Picture, Picture]:
        """Slopes (H, W) and (H, W) of changes (3, H, W)."""
        out = np.empty((2, *self.shape), np.float32)
        for window in strips((slice(0, self.shape[0]), slice(0, self.shape[1]))):
            self.strip(change[:, window[0]], window, out[:, window[0]])
        return out[0], out[1]

    def strip(self, change: Picture, window: Window, out: Picture) -> None:
        """Slopes (2, h, w), into `out`, of the changes (3, h, w) of a window, one of `strips`."""
        inputs = self._inputs[: 5 * change[0].size].reshape(1, 5, *change.shape[1:])
        inputs[0, :3], inputs[0, 3:] = change, self.place[:, *window]
        slopes = run_network(self.session, inputs)[0]
        np.minimum(slopes, self.bound, out=slopes)
        np.maximum(slopes, -self.bound, out=out)

    def noise(self, noise: Picture) -> Picture:
        """Standard deviation (H, W) of a slope on untouched gel, from that of the changes (3, H, W)."""
        total = np.zeros(self.shape, np.float32)
        for colour in range(3):
            step = np.zeros((3, *self.shape), np.float32)
            step[colour] = CHANGE_STEP
            up, down = self(step), self(-step)
            for above, below in zip(up, down, strict=True):
                total += (noise[colour] * (above - below) / np.float32(2.0 * CHANGE_STEP)) ** 2
        return np.asarray(np.sqrt(0.5 * total), np.float32)
