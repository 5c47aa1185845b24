"""Lock a folder of results for one run at a time, and end its workers with it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Self

from tactilevision.errors import OutputError, TactilevisionError
from tactilevision.files.opening import real_path
from tactilevision.files.writing import (
    PAUSE_S,
    clear_unfinished,
    make_folder,
    open_own,
    output_errors,
    process_runs,
    writes_into,
)

if sys.platform != "win32":
    import fcntl

LOCK = ".lock"  # in a folder of results while a run writes there
_ENDING_S = 10  # s: the workers of a killed run have ended long before
_LINGERING_S = 1.0  # s that a process is still listed after the system has freed its locks
_THREADS = Path("/proc/self/task")  # one entry for each thread of this process, also of libraries
_THREAD_ENDS_S = 0.1  # s after which a thread that was joined is no longer listed

_tickers: set[Ticker] = set()  # those running in this process
_held: dict[Path, tuple[int, int]] = {}  # lock files, and the process and thread that hold each


@contextmanager
def output_lock(target: Path | str, *, file: bool = False) -> Iterator[None]:
    """Lock a folder for results (or, with `file`, one file) until all is written.

    A missing folder is made, and removed if nothing was written. Unfinished files of a killed run are removed.
    The lock is a file that names the process, held by flock, which the system frees; on a disk without flock the
    file of a process that has ended is ignored. The lock is reentrant in its thread. Raises OutputError if another
    process or thread writes there.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise TactilevisionError(
            "a worker process imports the script that started it, and so starts the same run again. "
            'Put the call under `if __name__ == "__main__":`, or give workers=1.'
        )
    target = Path(target)
    folder = target.parent if file else target
    path = real_path(folder) / (f".{target.name}{LOCK}" if file else LOCK)
    here = os.getpid(), threading.get_ident()
    if _held.get(path) == here:
        yield
        return
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    make_folder(folder)
    with output_errors(target):
        handle, left = _wait_for(path, target)
    _held[path] = here
    try:
        if left:
            clear_unfinished(folder, deep=not file, wait_s=_LINGERING_S)
        with contextlib.nullcontext() if file else writes_into(folder):
            yield
    except BaseException:  # workers may have ended while writing, and the next run finds no lock
        if not file:  # next to one file others write, from other machines too, and no workers of this run
            with contextlib.suppress(OSError):
                clear_unfinished(folder, deep=True, wait_s=_LINGERING_S)
        raise
    finally:
        del _held[path]
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(handle)
        with contextlib.suppress(OSError):  # not empty
            for one in made:
                one.rmdir()


def join_lock(folder: Path) -> bool:
    """Share the lock of the parent process until this one ends; return False if the parent has lost it.

    So a folder is free only when the workers of a killed run have ended too.
    """
    try:
        handle = open_own(real_path(folder) / LOCK, os.O_RDWR)
    except FileNotFoundError:
        return False
    writes_into(folder).__enter__()  # until this process ends
    return _flock(handle, shared=True) is not False and _read_owner(handle)[:1] == [str(os.getppid())]


def _wait_for(path: Path, target: Path) -> tuple[int, bool]:
    """Return the lock's open file, and whether a killed run had left it."""
    until = time.monotonic() + _ENDING_S
    while True:
        handle, fresh = _open(path)
        owner = _read_owner(handle)
        if _take(handle, fresh=fresh, owner=owner):
            if _is_at(handle, path):
                _sign(handle, path)
                if _flock(handle, shared=True) is not False:  # so that the workers may share it
                    return handle, not fresh
            os.close(handle)  # its run has just ended and removed it, or another run was faster
            continue
        os.close(handle)
        if _lives(owner) or time.monotonic() > until:
            raise _busy(target, owner)
        time.sleep(PAUSE_S)


def _sign(handle: int, path: Path) -> None:
    """Write the holder into the file."""
    try:
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"{os.getpid()} {socket.gethostname()} {time.time():.0f}".encode(), 0)
    except OSError:  # a full disk
        path.unlink(missing_ok=True)
        os.close(handle)
        raise


def _open(path: Path) -> tuple[int, bool]:
    with contextlib.suppress(FileExistsError):
        return open_own(path, os.O_RDWR | os.O_CREAT | os.O_EXCL), True
    return open_own(path, os.O_RDWR | os.O_CREAT), False


def _take(handle: int, *, fresh: bool, owner: list[str]) -> bool:
    taken = _flock(handle, shared=False)
    return taken if taken is not None else fresh or not _lives(owner)


def _flock(handle: int, *, shared: bool) -> bool | None:
    """Return whether the system gave the lock; None if the disk or the system has none."""
    if sys.platform == "win32":
        return None
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _read_owner(handle: int) -> list[str]:
    """Return process, machine and time (s) of the run that holds it; nothing while it is being written."""
    said = os.pread(handle, 200, 0).decode(errors="replace").split()
    return said if len(said) == 3 and said[0].isdecimal() and said[2].isdecimal() else []


def _lives(owner: list[str]) -> bool:
    """Return whether the process runs; one on another machine counts as running."""
    if not owner:
        return False
    if owner[1] != socket.gethostname():
        return True
    return process_runs(int(owner[0]))


def _busy(target: Path, owner: list[str]) -> OutputError:
    what = "is being written by another run"
    if owner:
        since = time.strftime("%H:%M", time.localtime(int(owner[2])))
        what = f"is being written by process {owner[0]} since {since}"
    return OutputError(what, where=target, remedy="Wait for it, or give another --out.")


class Ticker:
    """Calls `act` every so many seconds in its own thread, which pauses while this process is forked."""

    def __init__(self, act: Callable[[], object], every_s: float) -> None:
        self._act, self._every_s = act, every_s
        self._ended = threading.Event()
        self._next_s = time.monotonic() + every_s

    def __enter__(self) -> Self:
        _tickers.add(self)
        self.go_on()
        return self

    def __exit__(self, *fault: object) -> None:
        _tickers.discard(self)
        self.rest()

    def rest(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join()

    def go_on(self) -> None:
        """Start the thread, or start it again: the next call keeps its time."""
        self._ended.clear()
        self._thread = threading.Thread(target=self._tick, daemon=True)
        self._thread.start()

    def _tick(self) -> None:
        while not self._ended.wait(max(0.0, self._next_s - time.monotonic())):
            self._next_s += self._every_s
            self._act()


@contextmanager
def worker_pool(count: int, start: Callable[..., None] | None = None, *given: Any) -> Iterator[Executor]:
    """Start so many processes on this machine; `start(*given)` is called once in each.

    They ignore Ctrl-C: the parent receives it, and its workers end with it at any moment, so their files must be
    whole at every moment. If no other thread runs in this process they are forked, which saves every import; else
    they are spawned.
    """
    with _one_thread() as alone:
        context = multiprocessing.get_context("fork" if alone else "spawn")
        reader, writer = context.Pipe(duplex=False)
        pool = _DeafPool(
            count, context, initializer=_start, initargs=(reader, writer if alone else None, start, given)
        )
        if alone:
            pool.submit(int)  # all are copied now
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
            "a worker process was ended from outside, or ran out of memory. Finished results are kept: run the "
            "same command again, perhaps with fewer workers."
        ) from fault
    finally:
        writer.close()
        reader.close()


def copies_are_safe() -> bool:
    """Return whether workers may be copies of this process, since no other thread runs in it."""
    with _one_thread() as alone:
        return alone


@contextmanager
def _one_thread() -> Iterator[bool]:
    """Return whether this process has no second thread, of a library neither: tickers and OpenCV's rest
    meanwhile.
    """
    if not _THREADS.is_dir():  # another system: unknown
        yield False
        return
    cv2, tickers = sys.modules.get("cv2"), list(_tickers)
    threads = 1 if cv2 is None else cv2.getNumThreads()
    for ticker in tickers:
        ticker.rest()
    if cv2 is not None:
        cv2.setNumThreads(1)
    try:
        until = time.monotonic() + _THREAD_ENDS_S
        while (alone := len(os.listdir(_THREADS)) == 1) is False and time.monotonic() < until:
            time.sleep(_THREAD_ENDS_S / 100)
        yield alone
    finally:
        if cv2 is not None:
            cv2.setNumThreads(threads)
        for ticker in tickers:
            ticker.go_on()


class _DeafPool(ProcessPoolExecutor):
    """Its processes ignore Ctrl-C, which a terminal sends to every process of a command."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        if sys.platform == "win32":
            return super().submit(fn, *args, **kwargs)
        # both signals wait until a new process has read its task, where they would cause a traceback
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})  # processes inherit it
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start(
    parent: Connection, copied: Connection | None, start: Callable[..., None] | None, given: tuple[Any, ...]
) -> None:
    if copied is not None:  # the parent's end of the pipe, and its locks and tickers
        copied.close()
        _held.clear()
        _tickers.clear()
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if start is not None:
        start(*given)


def _end_with(parent: Connection) -> None:
    """End this worker with its parent, even a killed one, whose end of the pipe closes."""
    wait([parent])
    os._exit(1)
