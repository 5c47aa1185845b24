"""Work that can be dropped: what nobody waits for any more ends where it stands, so that a click need not wait.

A signal raises `Dropped` in the main thread, in the midst of a fit. In another thread, and on Windows, work goes
on to its end. What must be whole (what the page is shown) is done with `whole`.
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
    """Work was dropped; no `except Exception` of a fit takes it for a failure."""


class Dropping:
    """One piece of work at a time, by what it is: it can be dropped by that name."""

    def __init__(self) -> None:
        self._at, self._what, self._wanted, self._armed = "", "", False, False

    @contextmanager
    def armed(self) -> Iterator[None]:
        """While the block runs work can be dropped, where the system lets it."""
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
        """Do a piece of work; False where it was dropped."""
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
        """Let the block be done whole, then drop the work if that was asked meanwhile."""
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
        """From here on the work at hand is not dropped: what it came to is being kept."""
        self._at = self._what = ""

    @property
    def what(self) -> str:
        """The work at hand that can be dropped; empty where there is none."""
        return self._what if self._armed else ""

    def drop(self, *what: str) -> None:
        """Drop the work at hand where it is one of these. May be called from any thread."""
        if self._armed and SIGNAL is not None and self._what in what:
            _thread.interrupt_main(SIGNAL)
