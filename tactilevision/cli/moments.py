"""Which of many frames are worth a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactilevision.recording import Recording


def telling(recording: Recording, size: Sequence[float], *, most: int) -> list[int]:
    """Numbers of at most `most` frames, in order: the one of greatest `size` (NaN: none) of each press, the
    greatest of these; where no presses or times are known, of each of `most` stretches of the frames."""
    values = np.asarray(size, dtype=float)
    best = []
    for part in _parts(recording, max(min(most, len(values)), 1)):
        known = part[np.isfinite(values[part])]
        if known.size:
            best.append(int(known[np.argmax(values[known])]))
    best.sort(key=lambda number: -values[number])
    return sorted(best[:most])


def _parts(recording: Recording, most: int) -> list[np.ndarray[tuple[int], np.dtype[np.intp]]]:
    times = recording.frame_times_s
    presses = [np.flatnonzero((times >= press.start_s) & (times <= press.end_s)) for press in recording.presses]
    if any(part.size for part in presses):
        return presses
    return np.array_split(np.arange(len(recording.frame_names)), most)
