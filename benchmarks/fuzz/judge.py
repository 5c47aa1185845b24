"""One mutant before one reader: what came out, how long it took, what was written, which numbers were believed."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.fuzz.readers import Reader
from tactilevision.errors import TactilevisionError

MAX_SECONDS = 10  # of processor: a busy machine is no finding
MAX_WAIT = 60  # s of waiting: on a pipe, a lock, a machine that never answers
MAX_MEMORY_KB = 1_000_000  # more than before the first mutant
ADDRESS_SPACE = 6 << 30  # bytes beyond what the process has when it starts: before the machine suffers
ABSURD = 1e12  # in mm, N, s, MPa, px: no sensor's number
_SKIPPED = frozenset(("extra", "other", "settings", "details", "edge_profile", "warnings"))  # no meaning is known

_CHANGES = frozenset(
    "os." + name for name in ("remove", "rename", "mkdir", "rmdir", "truncate", "symlink", "link")
)
_ESCAPES = frozenset(
    ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "socket.connect", "pickle.find_class")
)


@dataclasses.dataclass(frozen=True, slots=True)
class Finding:
    """`kind` is the same for mutants that fail in the same way and place."""

    kind: str
    said: str

    @property
    def slug(self) -> str:
        """A short name for files."""
        return hashlib.sha256(self.kind.encode()).hexdigest()[:8]


class Judge:
    """Judges mutants of one reader in `folder`.

    A call beyond MAX_SECONDS ends the process by SIGPROF, one beyond MAX_WAIT by SIGALRM.
    """

    def __init__(self, reader: Reader, folder: Path) -> None:
        self.reader, self.folder, self.runs, self.accepted = reader, folder, 0, 0
        folder.mkdir(parents=True, exist_ok=True)
        scratch = folder.parent / "scratch"
        scratch.mkdir(exist_ok=True)
        tempfile.tempdir = os.fspath(scratch)
        os.environ["TACTILEVISION_CACHE"] = os.fspath(scratch)
        reader.make(folder)
        self.seed = (folder / reader.file).read_bytes()
        self._neighbours = {
            path: path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file() and path != folder / reader.file
        }
        self._watching, self._written = False, list[str]()
        sys.addaudithook(self._audit)
        cv2.setNumThreads(1)
        warnings.simplefilter("error", RuntimeWarning)
        with open("/proc/self/statm") as file:
            now = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (now + ADDRESS_SPACE, resource.RLIM_INFINITY))
        self._before_kb = 0
        if (first := self(self.seed)) is not None or not self.accepted:
            raise RuntimeError(f"{reader.file}: the valid file is refused: {first or self.refusal}")
        self._before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    refusal = ""

    def __call__(self, data: bytes) -> Finding | None:
        """What is wrong with what the reader does with these bytes; None: nothing."""
        (self.folder / self.reader.file).write_bytes(data)
        self.runs += 1
        self._written.clear()
        self._watching = True
        signal.alarm(MAX_WAIT)
        signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS)
        try:
            record = self.reader.read(self.folder)
            finding = next(
                (Finding(f"number {where}", f"{where} = {value}") for where, value in self._numbers(record, "")),
                None,
            )
            self.accepted += 1
        except TactilevisionError as refused:
            finding, self.refusal = None, str(refused)
        except Exception as fault:  # whatever it is, it is the finding
            finding = Finding(_place(fault), f"{type(fault).__name__}: {str(fault)[:300]}")
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.alarm(0)
            self._watching = False
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if self._before_kb and memory - self._before_kb > MAX_MEMORY_KB:
            finding = Finding("memory", f"{(memory - self._before_kb) / 1e6:.1f} GB more")
            self._before_kb = memory
        if self._written:
            finding = Finding("written", ", ".join(self._written[:3]))
        self._restore()
        return finding

    def _restore(self) -> None:
        if self.reader.file in ("method.npz", "network.onnx"):  # their card is written anew by each call
            for path, data in self._neighbours.items():
                path.write_bytes(data)

    def _audit(self, event: str, words: tuple[Any, ...]) -> None:
        if not self._watching:
            return
        opened = event == "open" and isinstance(words[2], int)
        if event in _CHANGES or (opened and words[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)):
            self._note(words[0])
        elif event in _ESCAPES and "files.child import serve" not in str(words[1:2]):
            self._written.append(f"{event} {words[:1]}")

    def _note(self, path: Any) -> None:
        if isinstance(path, int) or path == os.devnull:
            return
        place = Path(os.path.realpath(os.fsdecode(path)))
        own = {self.folder.resolve() / name for name in ("method.json", "network.json")}
        if place not in own and not place.is_relative_to(Path(tempfile.gettempdir()).resolve()):
            self._written.append(str(place))

    def _numbers(self, value: Any, name: str) -> Iterator[tuple[str, object]]:
        """Fields whose number is NaN, infinite or absurd."""
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            for one in dataclasses.fields(value):
                if one.name not in _SKIPPED:
                    yield from self._numbers(getattr(value, one.name), one.name)
        elif isinstance(value, Mapping):
            for key, inner in value.items():
                yield from self._numbers(inner, name or str(key))
        elif isinstance(value, list | tuple):
            for inner in value:
                yield from self._numbers(inner, name)
        elif isinstance(value, np.ndarray):
            if value.dtype.kind in "fc":
                largest = np.abs(value[~np.isnan(value)]).max(initial=0.0)
                yield from self._number(float(largest), name)
                if np.isnan(value).any():
                    yield from self._number(math.nan, name)
        elif isinstance(value, float | int | np.number) and not isinstance(value, bool):
            yield from self._number(value, name)

    def _number(self, value: Any, name: str) -> Iterator[tuple[str, object]]:
        if value != value:
            if name not in self.reader.gaps:
                yield name, value
        elif abs(value) > ABSURD:
            yield name, value if isinstance(value, float) else f"a number of {len(str(value))} digits"


def _place(fault: BaseException) -> str:
    """The kind of error, and the last line of the library that it passed."""
    frames = traceback.extract_tb(fault.__traceback__)
    own = [one for one in frames if "/tactilevision/" in one.filename or "/calibration/" in one.filename]
    last = (own or frames)[-1]
    return f"{type(fault).__name__} in {Path(last.filename).name}, {last.name}"


def smaller(judge: Judge, data: bytes, finding: Finding, *, trials: int = 300) -> bytes:
    """The mutant with what can be left out left out, as far as some trials go."""
    part = max(len(data) // 2, 1)
    while part >= 1 and trials > 0:
        start = 0
        while start < len(data) and trials > 0:
            trials -= 1
            shorter = data[:start] + data[start + part :]
            again = judge(shorter)
            if again is not None and again.kind == finding.kind:
                data = shorter
            else:
                start += part
        part //= 2
    return data
