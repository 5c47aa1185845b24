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
FILE_S = 2e-3  # s of that work for an answer with bytes, of which the parent makes a file
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
    """A process that runs `serve` of a module, in a group of its own; it ends with this object."""

    def __init__(self, module: str, *, settings: Mapping[str, str], stderr: int | None = None) -> None:
        code = f"import sys; sys.path[:] = {sys.path!r}; from {module} import serve; serve()"
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

    def send(self, order: bytes) -> None:
        """Send one order; a child that has ended takes none, and gives no answer."""
        with suppress(BrokenPipeError):
            self.process.stdin.write(order)  # type: ignore[union-attr]
            self.process.stdin.flush()  # type: ignore[union-attr]

    def receive(self, most: float = math.inf, *, until_s: float = math.inf) -> list[Any]:
        """Return what `send` sent in the child, arrays of at most so many bytes.

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


def _reading() -> Child:
    return Child(__name__, settings=_SETTINGS, stderr=subprocess.DEVNULL)


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
        self._child: Child | None = waiting[0] if waiting else _reading()
        _waiting.clear()
        budget = {"MB": self.memory_MB, "step_s": seconds + size / READ_MB_S, "all_s": seconds + UNPACKED_S * size}
        self._send(budget | {"reader": [reader.__module__, reader.__name__], "given": given})

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Answer:
        if self._over is not None:
            raise self._over
        try:
            return self._next()
        except (StopIteration, InputError) as over:
            self._over = over
            raise
        except BaseException:  # interrupted: the rest of an answer is in the pipe
            self.close()
            raise

    def ask(self, word: object, *later: object) -> Answer:
        """Return the answer to a word that the reader takes from `asked`; `later` ones are prepared meanwhile."""
        for one in (word, *later):
            if self._child is not None and one not in self._pending:
                self._send({"asked": one})
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

    def _send(self, order: dict[str, Any]) -> None:
        assert self._child is not None
        self._child.send(json.dumps(order).encode() + b"\n")

    def _next(self) -> Answer:
        assert self._child is not None
        while True:
            try:
                kind, *words = self._child.receive(self.memory_MB * MB / SHARE)
            except EOFError:
                raise self._ended() from None
            if kind == "answer" and words:
                return tuple(words)
            if kind != "answer":
                _waiting[:], self._child = [self._child], None
                raise _FAULTS[kind](words[0], **dict(words[1])) if kind in _FAULTS else StopIteration

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


# The child.

ROOM = 8 * MB  # bytes that every reader needs at least
_orders: SimpleQueue[dict[str, Any]] = SimpleQueue()
_budget = {"step_s": math.inf, "all_s": math.inf}  # s of processor time for an answer, and until the child ends


def asked() -> Iterator[Any]:
    """Yield what the parent asks a reader, without end."""
    while True:
        _wait(0)
        order = _orders.get()
        _wait(WAIT_S)
        yield order["asked"]


def serve() -> None:
    """Answer the orders that come by the standard input, until it ends; what libraries print is no answer."""
    out = begin(_orders, lambda file: json.loads(file.readline()), prints_to=os.open(os.devnull, os.O_WRONLY))
    while True:
        order = _orders.get()
        if "reader" in order:  # else asked too late
            send(out, *_outcome(out, order))


def begin(orders: SimpleQueue[Any], read: Callable[[BinaryIO], Any], *, prints_to: int) -> BinaryIO:
    """Put what `read` returns of the standard input into `orders`, and end with it; return the file of answers."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(prints_to, 1)

    def listen() -> None:
        with suppress(Exception):  # the parent has ended
            while True:
                orders.put(read(sys.stdin.buffer))
        os._exit(0)

    threading.Thread(target=listen, daemon=True).start()
    return out


def _outcome(out: BinaryIO, order: dict[str, Any]) -> tuple[object, ...]:
    """Send the answers of a reader, and return how it ended."""
    module, name = order["reader"]
    found: InputError | None = None
    try:
        read = getattr(import_module(module), name)  # before the limits, which concern the file
        _limit(order)
        for answer in read(*order["given"]):
            _wait(0)
            send(out, "answer", *answer)
            _budget["all_s"] -= FILE_S if bytes in map(type, answer) else ANSWER_S
            _wait(WAIT_S)
    except Exception as fault:
        where, said = order["given"][0], f"is damaged: {type(fault).__name__}: {str(fault)[:160]}"
        found = fault if isinstance(fault, InputError) else InputError(said, where=where, remedy="Copy it again.")
        if isinstance(fault, MemoryError) or isinstance(fault.__cause__, MemoryError):
            found = _beyond(f"needs more memory than {order['MB']:.0f} MB", "MAX_CHILD_MB", where)
    _wait(0)
    if found is None:
        return ("end",)
    return type(found).__name__, *fault_fields(found)


def fault_fields(fault: InputError) -> tuple[str, dict[str, Any]]:
    """Return what an error is made of, as JSON."""
    value = fault.value if isinstance(fault.value, str | int | float | None) else str(fault.value)
    return fault.what, {"where": fault.where, "value": value, "remedy": fault.remedy}


def send(out: BinaryIO, *words: object) -> None:
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


def _limit(order: dict[str, Any]) -> None:
    """Set the limits of this process for one reader."""
    _budget.update(step_s=order["step_s"], all_s=time.process_time() + order["all_s"])
    if sys.platform != "win32":
        most = {"DATA": int(order["MB"] * MB), "NOFILE": OPEN_FILES, "FSIZE": 0, "CORE": 0}
        for name, value in most.items():
            kind = getattr(resource, f"RLIMIT_{name}")
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
        bytearray(ROOM)  # MemoryError where this process holds more than the limit already
    _wait(WAIT_S)


def _wait(seconds: int) -> None:
    """Let this process end if it does not come here again within so many seconds (0: no limit)."""
    if sys.platform == "win32":
        faulthandler.cancel_dump_traceback_later()
        if seconds:
            faulthandler.dump_traceback_later(seconds, exit=True)
        return
    if seconds:
        end_s = math.ceil(min(time.process_time() + _budget["step_s"], _budget["all_s"]))
        resource.setrlimit(resource.RLIMIT_CPU, (end_s, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    signal.alarm(seconds)
