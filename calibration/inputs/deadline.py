"""How long an analysis may take, who is told how far it is, and who does its independent steps."""

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


class Each(Protocol):
    """Independent steps `act(one)`, in the order given: each is fetched by a call, which raises what it raised."""

    def __call__(self, act: Callable[[Given], Made], given: Sequence[Given]) -> Iterator[Callable[[], Made]]: ...


def in_turn(act: Callable[[Given], Made], given: Sequence[Given]) -> Iterator[Callable[[], Made]]:
    """Done here, one after the other, each when it is fetched."""
    return (partial(act, one) for one in given)


def _silent(done: int, total: int, what: str = "") -> None:
    """Nobody is told."""


NEVER = Deadline(inf)
SILENT: Progress = _silent


class Watch:
    """All at once for a job whose steps are not counted beforehand: each is told as one more."""

    def __init__(self, progress: Progress = SILENT, deadline: Deadline = NEVER, each: Each = in_turn) -> None:
        self._progress, self._deadline, self.each, self._done = progress, deadline, each, 0

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return self._deadline.passed

    def tell(self, what: str) -> None:
        """Say what is begun."""
        self._progress(self._done, self._done + 1, what)
        self._done += 1


UNWATCHED = Watch()
