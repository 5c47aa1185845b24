"""Calls of a private effect: they end in time, and what they print goes to stderr, not between the results.

The timer is the system's own (SIGALRM): it also ends a call that sleeps. It belongs to a program's main thread;
in another thread, and on Windows, a call has no limit.
"""

from __future__ import annotations

import contextlib
import functools
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, NoReturn

from calibration.model.stages import EffectBase
from tactilevision.door.limits import limit
from tactilevision.errors import InputError

METHODS = ("parameters_on", "missing", "starts", "apply", "absent", "supposed", "freed", "richer", "in_picture")


@contextlib.contextmanager
def within_time(what: str) -> Iterator[None]:
    """Let the block run for MAX_EFFECT_SECONDS and print to stderr.

    Raises InputError, which names `what`, where it takes longer.
    """
    with contextlib.redirect_stdout(sys.stderr):
        if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
            yield
            return
        seconds = limit("MAX_EFFECT_SECONDS")

        def end(_number: int, _frame: FrameType | None) -> NoReturn:
            raise InputError(
                f"did not end within {seconds} s",
                where=what,
                remedy="Look for a loop without end. A slow effect: set TACTILEVISION_MAX_EFFECT_SECONDS.",
            )

        before = signal.signal(signal.SIGALRM, end)
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


def limited(kind: type[EffectBase]) -> type[EffectBase]:
    """The class of a private effect, each of its own METHODS within the time."""
    own = {name: _limited(method, kind.__name__) for name in METHODS if (method := vars(kind).get(name))}
    return type(kind.__name__, (kind,), own)


def _limited(method: Callable[..., Any], of: str) -> Callable[..., Any]:
    @functools.wraps(method)
    def call(*given: Any, **named: Any) -> Any:
        with within_time(f"{of}.{method.__name__}"):
            return method(*given, **named)

    return call
