"""Which part of a press each reading belongs to: free, load, hold, unload, free.

The threshold of contact and the tolerance of the hold come from the noise of the readings: contact is what stands
5 sigma out of the zero and does so again and again, the hold what lies within 4 sigma (or 2 %) of the top.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools, Floats
from tactilevision.records.contact_thresholds import CONTACT, reading_limit
from tactilevision.robust import second_difference_std


@dataclass(frozen=True, slots=True)
class Phases:
    """Places (into the readings): the first of contact, the first and last of the hold, the first free one after.

    `noise` of one reading, in its unit.
    """

    onset: int
    hold: int
    release: int
    end: int
    noise: float

    def names(self, count: int) -> npt.NDArray[np.str_]:
        """The phase (N,) of each of `count` readings."""
        place = np.arange(count)
        names = np.full(count, "free", dtype="<U6")
        names[(place >= self.onset) & (place < self.hold)] = "load"
        names[(place >= self.hold) & (place <= self.release)] = "hold"
        names[(place > self.release) & (place < self.end)] = "unload"
        return names


def find_phases(reading: Floats) -> Phases | None:
    """Phases of one press from its depths or forces (N,), zero when free; None where there is no contact."""
    noise = noise_of(reading)
    known = np.where(np.isfinite(reading), reading, -np.inf)
    top = float(np.median(np.sort(known)[-max(3, known.size // 20) :])) if known.size >= 5 else 0.0
    if not top > CONTACT.reading_top_sigma * noise or top <= 0:
        return None
    contact = known > reading_limit(noise, top)
    firm = contact & np.r_[contact[1:], contact[-1]]  # twice running: one wild reading is no contact
    if not firm.any():
        return None
    main = _main_run(contact, np.where(contact, known, 0.0))
    high = np.flatnonzero(main & (known >= top - max(4 * noise, 0.02 * top)))
    if not high.size:
        return None
    hold, release = int(high[0]), int(high[-1])
    before = np.flatnonzero(~firm[:hold])
    after = np.flatnonzero(~contact[release:])
    return Phases(
        int(before[-1]) + 1 if before.size else 0,
        hold,
        release,
        release + int(after[0]) if after.size else known.size,
        noise,
    )


def _main_run(contact: Bools, reading: Floats) -> Bools:
    """The contact that matters: the run of the largest sum, not a jolt at the window's end."""
    edges = np.flatnonzero(np.diff(np.r_[0, contact.astype(np.int8), 0]))
    runs = list(zip(edges[::2], edges[1::2], strict=True))
    first, last = max(runs, key=lambda run: float(reading[run[0] : run[1]].sum()))
    chosen = np.zeros(contact.size, dtype=bool)
    chosen[first:last] = True
    return chosen


def noise_of(reading: Floats) -> float:
    """Noise of one reading of (N,), in its unit.

    From second differences: a ramp does not count, nor do its few corners.
    """
    known = reading[np.isfinite(reading)]
    if known.size < 5:
        return 0.0
    return second_difference_std(known)
