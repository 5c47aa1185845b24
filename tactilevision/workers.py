"""Processes beside this one, that end with it, and at once, whether it is done, interrupted or killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any

from tactilevision.errors import TactilevisionError


@contextmanager
def worker_pool(count: int, start: Callable[..., None] | None = None, *given: Any) -> Iterator[Executor]:
    """So many processes on this machine; `start(*given)` is called once in each.

    They hear no Ctrl-C: the parent does, and its workers end with it, in the midst of what they were at. What
    they write must therefore be whole at every moment.
    """
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    pool = _DeafPool(count, context, initializer=_start, initargs=(reader, start, given))
    try:
        with pool:
            try:
                yield pool
            except BaseException:
                writer.close()
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    except BrokenExecutor as fault:
        raise TactilevisionError(
            "a worker process was ended from outside, or ran out of memory. What is done is kept: run the same "
            "command again, perhaps with fewer workers."
        ) from fault
    finally:
        writer.close()
        reader.close()


class _DeafPool(ProcessPoolExecutor):
    """Its processes are started deaf to Ctrl-C, which a terminal sends to every process of a command."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        if sys.platform == "win32":
            return super().submit(fn, *args, **kwargs)
        # both wait until a new process has read what it is to do: cut off there, it would end with a traceback
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})  # processes inherit it
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start(parent: Connection, start: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if start is not None:
        start(*given)


def _end_with(parent: Connection) -> None:
    """The pipe closes where the parent ends, even killed: each worker watches for itself."""
    wait([parent])
    os._exit(1)
