"""Cancellation of work that nobody waits for any more, by a signal within it.

A signal cancels work by raising `Dropped` in the main thread, within a fit; in another thread, and on Windows,
work continues to its end. `Dropping.whole` protects what must be complete.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNAL = getattr(signal, "SIGUSR1", None)


class Dropped(BaseException):
    """Work was cancelled; not an Exception, so that a fit does not handle it as a failure."""


class Dropping:
    """Cancellation of one piece of work at a time, by its name."""

    def __init__(self) -> None:
        self._at, self._what, self._wanted, self._armed = "", "", False, False

    @contextmanager
    def armed(self) -> Iterator[None]:
        """Allow cancellation while the block runs, where the system supports it."""
        if SIGNAL is None or threading.current_thread() is not threading.main_thread():
            yield
            return

        def end(_number: int, _frame: FrameType | None) -> None:
            if self._at:
                raise Dropped
            self._wanted = True

        before = signal.signal(SIGNAL, end)
        self._armed = True
        try:
            yield
        finally:
            self._armed = False
            signal.signal(SIGNAL, before)

    def run(self, what: str, job: Callable[[], None]) -> bool:
        """Run a job; return False where it was cancelled."""
        try:
            self._wanted, self._what, self._at = False, what, what
            job()
            self._at = ""
        except Dropped:
            return False
        finally:
            self._at = self._what = ""
        return True

    @contextmanager
    def whole(self) -> Iterator[None]:
        """Complete the block, then cancel the work if that was requested meanwhile."""
        if threading.current_thread() is not threading.main_thread() or not self._at:
            yield
            return
        at, self._at = self._at, ""
        yield
        self._at = at
        if self._wanted:
            self._wanted = False
            raise Dropped

    def keep(self) -> None:
        """Protect the rest of the current work, which stores its result."""
        self._at = self._what = ""

    @property
    def what(self) -> str:
        """Name of the current work that can be cancelled; empty where there is none."""
        return self._what if self._armed else ""

    def drop(self, *what: str) -> None:
        """Cancel the current work if it has one of these names. May be called from any thread."""
        if self._armed and SIGNAL is not None and self._what in what:
            _thread.interrupt_main(SIGNAL)
