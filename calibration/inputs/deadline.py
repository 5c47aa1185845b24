"""Deadline and progress of an analysis, and how its independent steps are executed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Protocol, TypeVar

Given = TypeVar("Given")
Made = TypeVar("Made")


class Progress(Protocol):
    """Callback with the progress of a long job: `done` of `total` steps, and the present one."""

    def __call__(self, done: int, total: int, what: str = "") -> None: ...


@dataclass(frozen=True, slots=True)
class Deadline:
    """Time on the monotonic clock, in s, after which no new step begins; the present one is completed."""

    at_s: float

    @classmethod
    def after(cls, seconds: float | None) -> Deadline:
        """Return the deadline so many seconds from now; never for None."""
        return cls(inf if seconds is None else time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() > self.at_s


class Each(Protocol):
    """Executor of independent steps `act(one)`: yields calls in the order given, each with its result or error."""

    def __call__(self, act: Callable[[Given], Made], given: Sequence[Given]) -> Iterator[Callable[[], Made]]: ...


def in_turn(act: Callable[[Given], Made], given: Sequence[Given]) -> Iterator[Callable[[], Made]]:
    """Execute each step here, when its call is made."""
    return (partial(act, one) for one in given)


def _silent(done: int, total: int, what: str = "") -> None:
    """Ignore the progress."""


NEVER = Deadline(inf)
SILENT: Progress = _silent


class Watch:
    """Progress, deadline and executor of a job whose number of steps is not known beforehand."""

    def __init__(self, progress: Progress = SILENT, deadline: Deadline = NEVER, each: Each = in_turn) -> None:
        self._progress, self._deadline, self.each, self._done = progress, deadline, each, 0

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return self._deadline.passed

    def tell(self, what: str, done: int = 0, of: int = 0) -> None:
        """Report the step that begins; of a pass whose number of steps is known, `done` of so many."""
        self._progress(*((done, of) if of else (self._done, self._done + 1)), what)
        self._done += not of


UNWATCHED = Watch()
