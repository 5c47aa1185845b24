"""One frame at a time, for a control loop: frame in; height map, contact and footprint out.

Everything is held in buffers made once; nothing is kept of a frame but the drift of the light, whose history is a
running mean, so that a stream may run for days. Where there is a GPU, frames are read there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.contact.region import at_border, in_question, strong_evidence
from tactilevision.errors import InputError
from tactilevision.quality.fitness import check_fit
from tactilevision.reconstruct import Reconstructor
from tactilevision.reconstruct.gpu.device import find_gpu
from tactilevision.records import Bools, Floats, Footprint, Frame, HeightMap, Indenter
from tactilevision.records.contact_thresholds import CONTACT, live_limit_mm
from tactilevision.records.flags import BORDER, add
from tactilevision.robust import median
from tactilevision.uncertainty.untouched_noise import untouched_std

SAMPLE_PX = 2  # pixels along each side, of which one is looked at
RENEW = 0.002  # share a frame: five seconds at 90 frames a second: lamps warm in minutes, presses take less
# ms: upper edges of the histogram of latencies
EDGES_MS = np.array([0.5, 1, 1.5, 2, 3, 4, 6, 8, 11, 16, 32, 64, np.inf])


@dataclass(frozen=True, slots=True)
class Moment:
    """What one frame says. `contact` is True where the gel is pressed; `peak_mm` its greatest depth there, else 0.

    `least_mm` is the depth from which a contact would be seen in half of the picture: where none is seen, one less
    deep may be there. `height.flags` (flags.py) say what makes all of it doubtful. `footprint` is None without
    contact or without an indenter to look for; `latency_ms` from frame to result.
    """

    height: HeightMap
    contact: bool
    peak_mm: float
    footprint: Footprint | None
    latency_ms: float
    least_mm: float


@dataclass
class Stream:
    """Turns frames into moments. Not thread-safe.

    `indenter`: what to look for, None for contact alone. `renew` is the share by which each frame without contact
    renews the reference, so that slow changes of light and temperature are followed; 0 leaves it as it is. The
    larger it is the sooner a press that comes slowly is taken for untouched gel: one that moves by v mm a frame is
    seen late, or never, where v / renew is less than what noise hides (some 10 um).

    Raises InputError for a calibration that fails its own balls, unless it is to be used `even_so`.
    """

    reconstructor: Reconstructor
    indenter: Indenter | None = None
    renew: float = RENEW
    even_so: bool = False
    latencies: Floats = field(default_factory=lambda: np.zeros(len(EDGES_MS)))
    frames: int = 0
    _last: Footprint | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.renew <= 1.0:
            raise InputError("is a share, from 0 to 1", where="Stream renew", value=self.renew)
        method = self.reconstructor.referenced
        if method is not None and not self.even_so:
            check_fit(method.card, remedy="Stream(..., even_so=True)")
        device = find_gpu()
        if device is not None:
            self.reconstructor.use(device)

    def take(self, frame: Frame) -> Moment:
        """The next frame. Raises InputError for one that cannot be read; the stream goes on with the one after."""
        if not isinstance(frame, Frame):
            raise InputError(
                "a stream takes frames",
                where="Stream.take",
                value=type(frame).__name__,
                remedy="Hand over Frame(rgb).",
            )
        began = time.perf_counter()
        if self.frames == 0:  # for all that come: it takes longer than a frame
            self.reconstructor.look([self.reconstructor.rectified(frame)])
        height = self.reconstructor.height_map(frame)
        contact, peak_mm, least_mm, cut = self._contact(height)
        if cut:
            height = replace(height, flags=add(height.flags, [BORDER]))
        self._last = self._footprint(height) if contact else None
        if not contact and least_mm < CONTACT.live_blind_mm and self.renew > 0:
            self._follow(frame)
        latency_ms = 1e3 * (time.perf_counter() - began)
        self.latencies[np.searchsorted(EDGES_MS, latency_ms)] += 1
        self.frames += 1
        return Moment(height, contact, peak_mm, self._last, latency_ms, least_mm)

    def histogram(self) -> list[tuple[float, int]]:
        """(upper edge in ms, frames) of the latencies so far."""
        return [(float(edge), int(count)) for edge, count in zip(EDGES_MS, self.latencies, strict=True)]

    def _contact(self, height: HeightMap) -> tuple[bool, float, float, bool]:
        """Whether there is a contact, its depth, the depth that would show as one in half of the picture, and
        whether the contact reaches the picture's border."""
        depth, valid = height.depth_mm[::SAMPLE_PX, ::SAMPLE_PX], height.valid[::SAMPLE_PX, ::SAMPLE_PX]
        spread = untouched_std(height, self.reconstructor.error, every=SAMPLE_PX)
        if spread is None:
            spread = np.full(depth.shape, CONTACT.live_unknown_std_mm)
        least_mm = CONTACT.live_sigma * float(median(np.where(valid, spread, np.inf)[::4, ::4].ravel()))
        pressed = (depth > live_limit_mm(spread)) & valid
        if SAMPLE_PX**2 * np.count_nonzero(pressed) < CONTACT.live_min_px:
            pressed = _strongly_pressed(height)
        if SAMPLE_PX**2 * np.count_nonzero(pressed) < CONTACT.live_min_px:
            return False, 0.0, least_mm, False
        return True, float(depth[pressed].max()), least_mm, at_border(pressed)

    def _footprint(self, height: HeightMap) -> Footprint | None:
        if self.indenter is None:
            return None
        return find_footprint(height, self.indenter, prior=self._last)

    def _follow(self, frame: Frame) -> None:
        self.reconstructor.follow(self.reconstructor.rectified(frame), self.renew)


def _strongly_pressed(height: HeightMap) -> Bools:
    """Mask (h, w) of every SAMPLE_PXth pixel that slopes or colours show to be pressed, whatever its deviation."""
    x, y = height.mm_per_px
    sampled = replace(
        height,
        depth_mm=height.depth_mm[::SAMPLE_PX, ::SAMPLE_PX],
        valid=height.valid[::SAMPLE_PX, ::SAMPLE_PX],
        mm_per_px=(SAMPLE_PX * x, SAMPLE_PX * y),
        std_mm=None if height.std_mm is None else height.std_mm[::SAMPLE_PX, ::SAMPLE_PX],
    )
    deep = in_question(sampled)
    return deep & strong_evidence(sampled) if deep.any() else deep
