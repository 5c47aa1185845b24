"""Read containers of others (logs, data sets, videos) in a child process with limits, killed as a whole.

A container of a few kilobytes may unpack to gigabytes, or state a calculation without end, and only the system
can stop the library that reads it. The child has limits on memory, processor time and open files, and none of its
files may have a byte (setrlimit; macOS ignores the limit on memory, and Windows has only the limit on waiting). It
answers with JSON and the bytes of arrays: nothing that it sends is executed.
"""

from __future__ import annotations

import faulthandler
import json
import math
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import wait
from pathlib import Path
from queue import SimpleQueue
from typing import Any, BinaryIO, Self

import numpy as np

from tactilevision.errors import InputError, RecordingError
from tactilevision.files.opening import MB, limit, open_regular

if sys.platform != "win32":
    import fcntl
    import resource

READ_MB_S = 50  # MB of a file that its reader passes at least, in a second of processor time without an answer
UNPACKED_S = 10  # s of processor time for each MB of a file: long videos of a still scene need some three
ANSWER_S = 2e-4  # s of the parent's own work for an answer, which counts as the child's
WAIT_S = 60  # s in which a child answers, even if other programs keep the processor
OPEN_FILES = 64  # of a child
PIPE_BYTES = 1 << 20  # of the pipe between the two: what Linux allows every user
MAX_WORDS = 4 * MB  # bytes of an answer without its arrays: the topics of a log have some kilobytes
SHARE = 3  # part of the child's memory that an answer's array may have: libraries hold it two or three times
_FAULTS = {kind.__name__: kind for kind in (InputError, RecordingError)}
_KINDS = re.compile(r"[<|][buif][1248]")  # of numbers in an array
_SETTINGS = {  # of the libraries in a child
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"),
    "OPENCV_FFMPEG_CAPTURE_OPTIONS": "format_whitelist;mov,matroska,avi|protocol_whitelist;file",
    "OPENCV_FFMPEG_THREADS": str(min(os.cpu_count() or 1, 4)),
}
Answer = tuple[Any, ...]  # of None, truth values, numbers, text, arrays of numbers, and lists of the first four


# The parent. A child that has come to an end waits for the next file, which saves its start.

_waiting: list[Child] = []


class Child:
    """A process that runs `serve`, in a group of its own, and one reader at a time; it ends with this object."""

    def __init__(self, settings: Mapping[str, str], *, stderr: int | None = None) -> None:
        code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=stderr,
            start_new_session=True,
            env=os.environ | settings,
        )
        self._out: Any = self.process.stdout.raw  # type: ignore[union-attr]
        with suppress(OSError, NameError, AttributeError):  # on another system, or where a user has many pipes
            os.set_blocking(self._out.fileno(), False)
            fcntl.fcntl(self._out, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        self.kill = weakref.finalize(self, _kill, self.process, os.getpid())

    def start(self, reader: Callable[..., Iterator[Answer]], given: Sequence[object], **budget: float) -> None:
        """Let it run a generator function of a module within a budget (see `_limit`; none: no limits)."""
        self._send({"reader": (reader.__module__, reader.__name__), "given": given, "budget": budget})

    def ask(self, word: object, *, within_s: int = WAIT_S) -> None:
        """Send a word that the reader takes from `asked`, and may work at for so many seconds."""
        self._send({"asked": word, "within_s": within_s})

    def _send(self, order: dict[str, object]) -> None:
        with suppress(BrokenPipeError):  # a child that has ended takes no order, and gives no answer
            pickle.dump(order, self.process.stdin)  # type: ignore[arg-type]
            self.process.stdin.flush()  # type: ignore[union-attr]

    def receive(self, most: float = math.inf, *, until_s: float = math.inf) -> list[Any]:
        """Return a word, "answer" or how the reader ended, and what it yielded, arrays of at most so many bytes.

        Raises EOFError where the child has ended or sends something else, TimeoutError at `until_s`
        (time.monotonic; not on Windows).
        """
        size = int.from_bytes(self._bytes(4, 4, until_s), "little")
        try:
            words = list(json.loads(self._bytes(size, MAX_WORDS, until_s)))
        except ValueError:
            raise EOFError from None
        return [
            self._array(one["dtype"], one["shape"], most, until_s)
            if isinstance(one, dict) and "dtype" in one
            else one
            for one in words
        ]

    def _array(self, kind: str, shape: list[int], most: float, until_s: float) -> Any:
        if not _KINDS.fullmatch(kind):
            raise EOFError
        return np.frombuffer(self._bytes(int(kind[2:]) * math.prod(shape), most, until_s), kind).reshape(shape)

    def _bytes(self, size: int, most: float, until_s: float) -> bytearray:
        if not 0 <= size <= most:
            raise EOFError
        found, done = bytearray(size), 0
        while done < size:
            read = self._out.readinto(memoryview(found)[done:])
            if read == 0:
                raise EOFError
            if read is None and not wait(
                [self._out], None if until_s == math.inf else max(0.0, until_s - time.monotonic())
            ):
                raise TimeoutError
            done += read or 0
        return found


def _kill(process: subprocess.Popen[bytes], owner: int) -> None:
    if owner != os.getpid():  # this process is a copy of the parent
        process.returncode = 0
        return
    if process.poll() is None:
        with suppress(ProcessLookupError):
            process.kill() if sys.platform == "win32" else os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):
            pipe.close()  # type: ignore[union-attr]


if sys.platform != "win32":
    os.register_at_fork(after_in_child=_waiting.clear)


class Answers:
    """Iterator over what `reader(*given)`, a generator function of a module, yields in a child process.

    `given` are parts of JSON, a path as text the first. `files` are what it reads: their size on disk adds to the
    child's memory and time. Raises InputError as the reader does, for what is no regular file, and where the child
    ends at a limit (MAX_CHILD_MB, MAX_CHILD_SECONDS); an error is raised again by later calls.
    """

    def __init__(self, reader: Callable[..., Iterator[Answer]], *given: object, files: Sequence[Path]) -> None:
        self.where, size = str(given[0]), sum(map(_size_MB, files))
        self.memory_MB, seconds = limit("MAX_CHILD_MB") + size, limit("MAX_CHILD_SECONDS")
        self._over: Exception | None = None
        self._pending: deque[object] = deque()  # asked, and not yet answered
        waiting = [one for one in _waiting if one.process.poll() is None]
        self._child: Child | None = waiting[0] if waiting else Child(_SETTINGS, stderr=subprocess.DEVNULL)
        _waiting.clear()
        budget = {
            "memory_MB": self.memory_MB,
            "step_s": seconds + size / READ_MB_S,
            "all_s": seconds + UNPACKED_S * size,
        }
        self._child.start(reader, given, **budget)

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Answer:
        if self._over is not None:
            raise self._over
        assert self._child is not None
        try:
            kind, *words = self._child.receive(self.memory_MB * MB / SHARE)
            while kind == "answer" and not words:
                kind, *words = self._child.receive(self.memory_MB * MB / SHARE)
        except EOFError:
            self._over = self._ended()
            raise self._over from None
        except BaseException:  # interrupted: the rest of an answer is in the pipe
            self.close()
            raise
        if kind == "answer":
            return tuple(words)
        _waiting[:], self._child = [self._child], None
        self._over = raised(kind, *words) if words else StopIteration()
        raise self._over

    def ask(self, word: object, *later: object) -> Answer:
        """Return the answer to a word that the reader takes from `asked`; `later` ones are prepared meanwhile."""
        for one in (word, *later):
            if self._child is not None and one not in self._pending:
                self._child.ask(one)
                self._pending.append(one)
        while True:
            answer = next(self)
            if self._pending.popleft() == word:
                return answer

    def close(self) -> None:
        """End the child."""
        self._over = self._over or StopIteration()
        if self._child is not None:
            self._child.kill()
            self._child = None

    def _ended(self) -> InputError:
        """Return the reason why the child has ended, or end it for an answer that is none."""
        assert self._child is not None
        with suppress(subprocess.TimeoutExpired):
            self._child.process.wait(1)
        code = -(self._child.process.poll() or 0)
        self.close()
        if sys.platform != "win32" and code in (signal.SIGXCPU, signal.SIGALRM):
            return _beyond("takes more time than a file of its size may", "MAX_CHILD_SECONDS", self.where)
        return _beyond("is damaged, or needs too much memory", "MAX_CHILD_MB", self.where)


def _size_MB(path: Path) -> float:
    with open_regular(path, limit=None) as file:
        about = os.fstat(file.fileno())
    return min(about.st_size, 512 * getattr(about, "st_blocks", about.st_size)) / MB


def _beyond(what: str, name: str, where: object) -> InputError:
    remedy = f"Copy it again. If it is meant, set TACTILEVISION_{name} in the environment to a larger number."
    return InputError(what, where=where, remedy=remedy)


def stated(fault: InputError) -> tuple[str, str, dict[str, object]]:
    """Return an error as parts of JSON, for `raised`."""
    value = fault.value if isinstance(fault.value, str | int | float | None) else str(fault.value)
    return type(fault).__name__, fault.what, {"where": fault.where, "value": value, "remedy": fault.remedy}


def raised(kind: str, what: str, about: Mapping[str, Any]) -> InputError:
    """Return the error of `stated`; of another kind than this library's own, InputError."""
    return _FAULTS.get(kind, InputError)(what, **about)


# The child.

_orders: SimpleQueue[dict[str, Any]] = SimpleQueue()
_budget: dict[str, float] = {}  # s of processor time for an answer (step_s), and until the child ends (all_s)


def asked() -> Iterator[Any]:
    """Yield what the parent asks a reader, without end."""
    while True:
        _wait(0)
        order = _orders.get()
        _wait(order["within_s"])
        yield order["asked"]


def serve() -> None:
    """Answer the orders that come by the standard input, until it ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a reader prints is no answer
    sys.stdout = sys.stderr
    threading.Thread(target=_listen, daemon=True).start()
    while True:
        order = _orders.get()
        if "reader" in order:  # else asked too late
            _write(out, *_outcome(out, order))


def _listen() -> None:
    try:
        while True:
            _orders.put(pickle.load(sys.stdin.buffer))  # noqa: S301 -- of the process that started this one
    finally:  # it has ended
        os._exit(0)


def _outcome(out: BinaryIO, order: dict[str, Any]) -> tuple[object, ...]:
    """Send the answers of a reader, and return how it ended."""
    module, name = order["reader"]
    found: InputError | None = None
    try:
        _limit(**order["budget"])
        for answer in getattr(import_module(module), name)(*order["given"]):
            _wait(0)
            _write(out, "answer", *answer)
            _wait(WAIT_S)
    except Exception as fault:
        where, said = order["given"][0], f"is damaged: {type(fault).__name__}: {str(fault)[:160]}"
        found = fault if isinstance(fault, InputError) else InputError(said, where=where, remedy="Copy it again.")
        if isinstance(fault, MemoryError) or isinstance(fault.__cause__, MemoryError):
            found = _beyond(f"needs more memory than {order['budget']['memory_MB']:.0f} MB", "MAX_CHILD_MB", where)
    _wait(0)
    return ("end",) if found is None else stated(found)


def _write(out: BinaryIO, *words: object) -> None:
    """Send one answer: the length of its JSON, the JSON, and the arrays, of which it holds kind and shape."""
    words = tuple(np.frombuffer(one, np.uint8) if isinstance(one, bytes) else one for one in words)
    arrays = [np.ascontiguousarray(one) for one in words if isinstance(one, np.ndarray)]
    about = [{"dtype": one.dtype.str, "shape": one.shape} if isinstance(one, np.ndarray) else one for one in words]
    text = json.dumps(about).encode()
    try:
        out.write(len(text).to_bytes(4, "little") + text)
        for array in arrays:
            out.write(array.data)
        out.flush()
    except BrokenPipeError:  # the parent has ended
        os._exit(0)


def _limit(*, memory_MB: float = 0.0, step_s: float = math.inf, all_s: float = math.inf) -> None:
    """Set the limits of this process for one reader: memory, and processor time for an answer and for all."""
    _budget.update(step_s=step_s, all_s=time.process_time() + all_s)
    if sys.platform != "win32" and memory_MB:
        most = {"DATA": int(memory_MB * MB), "NOFILE": OPEN_FILES, "FSIZE": 0, "CORE": 0}
        for name, value in most.items():
            kind = getattr(resource, f"RLIMIT_{name}")
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
    _wait(WAIT_S)


def _wait(seconds: int) -> None:
    """Let this process end if it does not come here again within so many seconds (0: no limit)."""
    if sys.platform == "win32":
        faulthandler.cancel_dump_traceback_later()
        if seconds:
            faulthandler.dump_traceback_later(seconds, exit=True)
        return
    if seconds and _budget["all_s"] < math.inf:
        _budget["all_s"] -= ANSWER_S
        end_s = math.ceil(min(time.process_time() + _budget["step_s"], _budget["all_s"]))
        resource.setrlimit(resource.RLIMIT_CPU, (end_s, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    signal.alarm(seconds)
