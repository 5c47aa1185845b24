"""A command as a process of its own, with a fault inside: a fork, which spares the imports, or a new one."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from benchmarks.faults.child import FAULT, MODULES, install, run_command
from benchmarks.faults.commands import ROOT, Command

LIMIT_S = 300  # no run of these takes a tenth of it, in s
TIMED_OUT = -999  # exit code of a run that never ended


@dataclass(frozen=True, slots=True)
class Ended:
    """How a run ended, and what it said on standard error."""

    code: int
    said: str


class Running(Protocol):
    """What the trials ask of a process."""

    pid: int

    def wait(self, timeout_s: float) -> int | None:
        """Its exit code; None where it has not ended by then."""
        ...


class Fork:
    """A copy of this process, which has imported all that the command needs."""

    def __init__(self, words: list[str], fault: Mapping[str, object], said: Path, most: int) -> None:
        context = multiprocessing.get_context("fork")
        self._process = context.Process(target=_in_fork, args=(words, dict(fault), said, most))
        self._process.start()
        self.pid = self._process.pid or 0

    def wait(self, timeout_s: float) -> int | None:
        self._process.join(timeout_s)
        return self._process.exitcode


class Spawn:
    """A new interpreter: a command with workers, which take its main module for their own."""

    def __init__(self, words: list[str], fault: Mapping[str, object], said: Path, most: int) -> None:
        with said.open("w", encoding="utf-8") as file:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.faults.child", *words],
                cwd=ROOT,
                env=_environment(said) | {FAULT: json.dumps(fault)},
                stdout=subprocess.DEVNULL,
                stderr=file,
                start_new_session=True,
                preexec_fn=lambda: _limit(most),
            )
        self.pid = self._process.pid

    def wait(self, timeout_s: float) -> int | None:
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None


@contextmanager
def started(
    command: Command, out: Path, fault: Mapping[str, object] | None = None, *, most: int = 0, fresh: bool = False
) -> Iterator[tuple[Running, Path]]:
    """The command as a group of processes, and the file of what it says; `most` limits the bytes of a file.

    A command without workers is forked, unless it is to be `fresh`.
    """
    said = out.with_name(f"{out.name}.said")
    kind = Spawn if fresh or command.workers > 1 else Fork
    process = kind(command.line(out), {"out": str(out), **(fault or {})}, said, most)
    try:
        yield process, said
    finally:
        if process.wait(0) is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(LIMIT_S)


def ended(running: tuple[Running, Path]) -> Ended:
    """Wait for its end."""
    process, said = running
    code = process.wait(LIMIT_S)
    return Ended(TIMED_OUT if code is None else code, said.read_text(encoding="utf-8", errors="replace"))


def run(
    command: Command, out: Path, *, fault: Mapping[str, object] | None = None, most: int = 0, fresh: bool = False
) -> Ended:
    """To its end."""
    with started(command, out, fault, most=most, fresh=fresh) as running:
        return ended(running)


def import_what_it_took(said: Path) -> None:
    """Import, once and here, the modules that a fresh run has told of."""
    os.environ["MPLBACKEND"] = "Agg"
    for name in _modules(said).read_text(encoding="utf-8").split("\n"):
        if name.startswith(("tactilevision", "calibration", "matplotlib", "scipy", "skfem", "zarr", "tifffile")):
            with suppress(ImportError):
                importlib.import_module(name)


def _environment(said: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", MODULES: str(_modules(said))}


def _modules(said: Path) -> Path:
    return said.with_suffix(".modules")


def _limit(most: int) -> None:
    if most:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


def _in_fork(words: list[str], fault: dict[str, object], said: Path, most: int) -> None:
    os.setsid()
    for number, path in ((1, os.devnull), (2, said)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w", buffering=1)
    _limit(most)
    install(fault, is_worker=False)
    sys.exit(run_command(words))
