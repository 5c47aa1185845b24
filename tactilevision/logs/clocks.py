"""Which clock the headers of a topic run on, as far as a log can tell.

The log itself has one clock: when each message was written. A header's time less that is the delay, which is
small and steady on one clock. It is large where a device counts from when it was switched on.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import InputError
from tactilevision.records import Floats

if TYPE_CHECKING:
    from tactilevision.logs.messages import Stamp

MAX_DELAY_S = 0.5  # s: pictures reach a log within some tenths of a second; another clock is off by far more


class Clock(StrEnum):
    """Whose time is taken: that in the headers, or the log's own."""

    HEADER = "header"
    LOG = "log"


def check_clock(stamps: Sequence[Stamp], where: str) -> float:
    """Median of header less log time, s, of one topic.

    Raises InputError where headers hold no time, and where their clock was set anew within the log.
    """
    if any(one.header_ns == 0 for one in stamps):
        raise InputError("a header holds no time", where=where, remedy="Take the log's own with --clock log.")
    ahead_s = np.array([one.header_ns - one.log_ns for one in stamps]) * 1e-9
    middle = float(np.median(ahead_s))
    off = np.flatnonzero(np.abs(ahead_s - middle) > MAX_DELAY_S)
    if off.size > 1 or (off.size and len(stamps) < 3):
        raise InputError(
            "the headers' clock was set anew within the log",
            where=f"{where}, message {off[0] + 1}",
            value=f"{ahead_s[off[0]] - middle:+.3f} s",
            remedy="Cut the log there, or take its own time with --clock log.",
        )
    return middle


def check_same_clock(frames_s: float, wrench_s: float, *, where: object) -> None:
    """Raise InputError where two topics' headers, this far ahead of the log in s, run on two clocks."""
    if abs(frames_s - wrench_s) > MAX_DELAY_S:
        raise InputError(
            "frames and wrench are on two clocks",
            where=where,
            value=f"headers are {frames_s:+.3f} s and {wrench_s:+.3f} s from the log's time",
            remedy="Take the log's own time with --clock log.",
        )


def times_s(stamps: Sequence[Stamp], clock: Clock, *, origin_ns: int) -> Floats:
    """Times (n,) in s after `origin_ns`, on the clock that was chosen."""
    return np.array([_time_ns(one, clock) - origin_ns for one in stamps], dtype=float) * 1e-9


def first_ns(stamps: Sequence[Stamp], clock: Clock) -> int:
    """The earliest time, ns, down to a whole second."""
    return min(_time_ns(one, clock) for one in stamps) // 10**9 * 10**9


def _time_ns(stamp: Stamp, clock: Clock) -> int:
    return stamp.log_ns if clock is Clock.LOG else stamp.header_ns
