"""Frames of a video that were not seen anew: a strong compression copies what hardly changed since the one before.

A picture that grows by less than the coder's step between two frames is shown late, by as much as a frame or more,
on the way in and on the way out alike, so that no clock can tell. A frame that is coded by itself shows the
sensor's noise: few of its pixels are the same as before. What the others have alike beyond that was copied.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from tactilevision.recording import BadFrame
from tactilevision.records import Estimate, Floats, Frame

_THIN = 3  # pixels from one that is compared to the next
_MOSTLY = 0.5  # share of the picture that is copied, where the clock is no longer trusted; test_repeated_frames
_MIN_PAIRS = 12  # pairs of frames: a coder's whole group of pictures


def note_repeats(frames: Iterable[Frame | BadFrame], repeats: list[float]) -> Iterator[Frame | BadFrame]:
    """The frames as they come; `repeats` grows by the share of pixels that each has from the one before."""
    before = None
    for frame in frames:
        if not isinstance(frame, BadFrame):
            now = frame.rgb[::_THIN, ::_THIN]
            if before is not None:
                repeats.append(float((now == before).all(axis=-1).mean()))
            before = now
        yield frame


def repeated_share(repeats: Sequence[float]) -> float:
    """The share of the picture that the median frame copies; 0 where too few frames tell."""
    if len(repeats) < _MIN_PAIRS:
        return 0.0
    anew, typical_share = float(np.quantile(repeats, 0.03)), float(np.median(repeats))
    return (typical_share - anew) / (1 - anew) if anew < 1 else 0.0


def allow_for_repeats(offset: Estimate, share: float, *, times_s: Floats) -> tuple[Estimate, tuple[str, ...]]:
    """The clocks' offset (s) with a frame's interval more of uncertainty, and a warning that says so.

    Where most of each picture is a copy: `share` of it, frames at `times_s` (n,). Otherwise as it was.
    """
    if share < _MOSTLY or offset.value is None or times_s.size < 2:
        return offset, ()
    interval = float(np.median(np.diff(times_s)))
    std = float(np.hypot(offset.std or 0.0, interval))
    wide = replace(offset, std=std, interval95=(offset.value - 1.96 * std, offset.value + 1.96 * std))
    return wide, (
        f"The video is so strongly compressed that {100 * share:.0f} % of a frame is copied from the one before: "
        f"it may lag by a frame, and the clocks' uncertainty was widened by {1e3 * interval:.0f} ms.",
    )
