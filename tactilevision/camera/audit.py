"""Is a camera to be trusted? Rate, lost and repeated frames, exposure, compression, asked of its first frames.

Exposure: the median over the picture of a frame's brightness over the first one's. Untouched gel under steady
lamps keeps it; so do small contacts, as most of the picture stays.
Compression: JPEG and video code blocks of 8 pixels. By how much neighbours differ more across the borders of
blocks than within, in grey levels, is what compression put there.
It tells that there is compression, not how much depth loses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from tactilevision.camera.sources import Shot
from tactilevision.errors import InputError
from tactilevision.quality.compression import blocks_grey
from tactilevision.records import Bytes

FRAMES = 60  # frames of an audit: a second or two
LOST = 1.5  # usual steps of time after which a frame is missing
MAX_LOST = 0.02  # share of lost or repeated frames that is told of; a few are no matter
MAX_BRIGHTNESS = 0.02  # relative change of brightness; lamps that are warm keep within a third of it
MAX_BLOCKS_GREY = 0.2  # grey levels: raw pictures have below .05, JPEG of any quality .3 to .7, video 1.3
STEP = 4  # px apart that brightness is looked at


@dataclass(frozen=True, slots=True)
class Audit:
    """What some frames that came one after the other tell; `rate_Hz` is NaN where their times tell nothing."""

    frames: int
    rate_Hz: float
    lost: int
    repeated: int
    brightness_change: float
    blocks_grey: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against the camera, a sentence each."""
        said, many = [], MAX_LOST * self.frames
        if self.lost > many:
            said.append(f"{self.lost} frames were lost between {self.frames}: the camera or its bus is busy")
        if self.repeated > many:
            said.append(f"{self.repeated} of {self.frames} frames repeat the one before: the camera is slower")
        if self.brightness_change > MAX_BRIGHTNESS:
            said.append(
                f"brightness changed by {100 * self.brightness_change:.1f} % over {self.frames} frames: is the "
                "exposure automatic, or are the lamps still warming up?"
            )
        if self.blocks_grey > MAX_BLOCKS_GREY:
            said.append(
                f"pictures are compressed: blocks differ by {self.blocks_grey:.2f} grey levels, which read as "
                "slopes; take raw frames, or calibrate with frames compressed alike"
            )
        return tuple(said)

    def as_json(self) -> dict[str, Any]:
        """For a program."""
        return {
            "frames": self.frames,
            "rate_Hz": self.rate_Hz,
            "lost": self.lost,
            "repeated": self.repeated,
            "brightness_change": self.brightness_change,
            "blocks_grey": self.blocks_grey,
            "warnings": list(self.warnings),
        }


def audit(shots: Sequence[Shot], *, timed: bool = True) -> Audit:
    """The audit of shots that came one after the other; not `timed`, when they came tells nothing of a camera.

    Raises InputError for fewer than two.
    """
    if len(shots) < 2:
        raise InputError("an audit needs frames", where="audit", value=len(shots))
    steps = np.diff([shot.time_s for shot in shots])
    usual = float(np.median(steps)) if timed else 0.0
    lost = int(np.sum(np.maximum(np.rint(steps / usual) - 1, 0)[steps > LOST * usual])) if usual > 0 else 0
    alike = [np.array_equal(a.rgb, b.rgb) for a, b in pairwise(shots)]
    return Audit(
        len(shots),
        1.0 / usual if usual > 0 else float("nan"),
        lost,
        int(np.sum(alike)),
        brightness_change([shot.rgb for shot in shots]),
        blocks_grey(shots[0].rgb),
    )


def brightness_change(frames: Sequence[Bytes]) -> float:
    """By how much the brightness of frames (H, W, 3), grey levels, varies: a relative share of the first's."""
    levels = [rgb[::STEP, ::STEP].sum(axis=2, dtype=np.float64) for rgb in frames]
    lit = levels[0] > 0
    if not lit.any():
        return 0.0
    shares = [float(np.median(level[lit] / levels[0][lit])) for level in levels]
    return max(shares) - min(shares)
