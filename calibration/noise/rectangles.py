"""Samples of presses as rectangles, one row a press: one for all, unless presses much longer than most would make
it mostly padding.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.inputs.observations import Ints, Observations
from tactilevision.records import Bools, Floats

KEPT = 8  # data sets of which the rectangles are kept: a fit asks for them at every step
ROOMY = 200_000  # cells that one rectangle may have, however much of it is padding
MOST_PADDED = 2  # times as long as the shortest press of its rectangle is the longest, beyond that


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Some presses as (m, t): `rows` indices into all samples, `real` False where padded."""

    rows: Ints
    real: Bools

    def padded(self, values: Floats) -> Floats:
        """Columns (N, k) as (m, t, k), 0 where there is no sample."""
        return np.asarray(values[self.rows] * self.real[:, :, None])


@lru_cache(maxsize=KEPT)
def rectangles(data: Observations) -> tuple[Rectangle, ...]:
    """All presses, each in one of them, padded at its end by its last sample."""
    first = data.first
    length = np.diff(np.append(first, data.size))
    if length.max() * length.size <= max(ROOMY, MOST_PADDED * data.size):
        return (_rectangle(first, length),)
    order, parts = np.argsort(-length, kind="stable"), []
    while order.size:
        count = int(np.count_nonzero(length[order] * MOST_PADDED >= length[order[0]]))
        parts.append(_rectangle(first[order[:count]], length[order[:count]]))
        order = order[count:]
    return tuple(parts)


def _rectangle(first: Ints, length: Ints) -> Rectangle:
    offset = np.arange(int(length.max()))
    rows = first[:, None] + np.minimum(offset, (length - 1)[:, None])
    return Rectangle(rows, offset < length[:, None])
