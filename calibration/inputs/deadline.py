"""How long an analysis may take, and who is told how far it is."""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import inf
from typing import Protocol


class Progress(Protocol):
    """Told how far a long job is: `done` of `total` steps, and what it is at."""

    def __call__(self, done: int, total: int, what: str = "") -> None: ...


@dataclass(frozen=True, slots=True)
class Deadline:
    """A moment on the monotonic clock, in s, after which nothing new is begun; what was begun is ended."""

    at_s: float

    @classmethod
    def after(cls, seconds: float | None) -> Deadline:
        """So many seconds from now; never for None."""
        return cls(inf if seconds is None else time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether the moment is over."""
        return time.monotonic() > self.at_s


def _silent(done: int, total: int, what: str = "") -> None:
    """Nobody is told."""


NEVER = Deadline(inf)
SILENT: Progress = _silent


class Watch:
    """Both at once for a job whose steps are not counted beforehand: each is told as one more."""

    def __init__(self, progress: Progress = SILENT, deadline: Deadline = NEVER) -> None:
        self._progress, self._deadline, self._done = progress, deadline, 0

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return self._deadline.passed

    def tell(self, what: str) -> None:
        """Say what is begun."""
        self._progress(self._done, self._done + 1, what)
        self._done += 1


UNWATCHED = Watch()
