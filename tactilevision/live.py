"""One frame at a time, for a control loop: frame in; height map, contact and footprint out.

Everything is held in buffers made once; nothing is kept of a frame but the drift of the light, whose history is a
running mean, so that a stream may run for days. Where there is a GPU, frames are read there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.gpu.device import find_gpu
from tactilevision.reconstruct import Reconstructor
from tactilevision.records import Floats, Footprint, Frame, HeightMap, Indenter

SIGMAS = 5.0  # depth over its deviation at which there is contact
LEAST_PIXELS = 20  # that reach it; fewer are noise
EDGES_MS = np.array([0.5, 1, 1.5, 2, 3, 4, 6, 8, 11, 16, 32, 64, np.inf])


@dataclass(frozen=True, slots=True)
class Moment:
    """What one frame says. `contact` is True where the gel is pressed; `peak_mm` its greatest depth there, else 0.

    `footprint` is None without contact or without an indenter to look for; `latency_ms` from frame to result.
    """

    height: HeightMap
    contact: bool
    peak_mm: float
    footprint: Footprint | None
    latency_ms: float


@dataclass
class Stream:
    """Turns frames into moments. Not thread-safe.

    `indenter`: what to look for, None for contact alone. `renew` is the share by which each frame without contact
    renews the reference, so that slow changes of light and temperature are followed; 0 leaves it as it is.
    """

    reconstructor: Reconstructor
    indenter: Indenter | None = None
    renew: float = 0.0
    latencies: Floats = field(default_factory=lambda: np.zeros(len(EDGES_MS)))
    frames: int = 0
    _last: Footprint | None = None

    def __post_init__(self) -> None:
        device = find_gpu()
        if device is not None:
            self.reconstructor.use(device)

    def take(self, frame: Frame) -> Moment:
        """The next frame. Raises InputError for one that cannot be read; the stream goes on with the one after."""
        began = time.perf_counter()
        height = self.reconstructor.height_map(frame)
        contact, peak_mm = self._contact(height)
        self._last = self._footprint(height) if contact else None
        if not contact and self.renew > 0:
            self._follow(frame)
        latency_ms = 1e3 * (time.perf_counter() - began)
        self.latencies[np.searchsorted(EDGES_MS, latency_ms)] += 1
        self.frames += 1
        return Moment(height, contact, peak_mm, self._last, latency_ms)

    def histogram(self) -> list[tuple[float, int]]:
        """(upper edge in ms, frames) of the latencies so far."""
        return [(float(edge), int(count)) for edge, count in zip(EDGES_MS, self.latencies, strict=True)]

    def _contact(self, height: HeightMap) -> tuple[bool, float]:
        # every second pixel of every second row
        depth, spread = height.depth_mm[::2, ::2], 0.02 if height.std_mm is None else height.std_mm[::2, ::2]
        pressed = (depth > SIGMAS * spread) & height.valid[::2, ::2]
        if 4 * np.count_nonzero(pressed) < LEAST_PIXELS:
            return False, 0.0
        return True, float(depth[pressed].max())

    def _footprint(self, height: HeightMap) -> Footprint | None:
        if self.indenter is None:
            return None
        return find_footprint(height, self.indenter, prior=self._last)

    def _follow(self, frame: Frame) -> None:
        self.reconstructor.follow(self.reconstructor.rectified(frame), self.renew)
