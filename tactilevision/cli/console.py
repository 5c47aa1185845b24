"""Output on the terminal: progress, summary, warnings and errors."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from errno import ENOSPC
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import typer

from tactilevision.errors import InputError, OutputError, TactilevisionError, Terminated, one_line
from tactilevision.files.runs import Ticker
from tactilevision.files.writing import as_json, write_json

if TYPE_CHECKING:
    from calibration.inputs.deadline import Progress

STANDARD_OUTPUT = Path("-")  # the file of --json that stands for it
_present = {"quiet": False, "prints JSON": False}  # what the present command was asked for
warned = set[str]()  # warnings that the present command has printed


def begin() -> None:
    """Forget what an earlier command of this process printed, and how."""
    warned.clear()
    be_quiet(False)
    to_program(None)


def be_quiet(wanted: bool) -> bool:
    """Print no summary and no progress from now on, if `wanted`."""
    _present["quiet"] = wanted
    return wanted


def to_program(path: Path | None) -> Path | None:
    """Return the path of --json; keep standard output free of the summary where that is "-"."""
    _present["prints JSON"] = path == STANDARD_OUTPUT
    return path


def numbers(name: str, text: str | None) -> tuple[float, ...]:
    """Return the numbers of a list with commas between, each once, rising. Raises InputError for other text."""
    try:
        return () if text is None else tuple(sorted({float(part) for part in text.split(",")}))
    except ValueError as fault:
        raise InputError("numbers with commas between are needed", where=name, value=text) from fault


INTERRUPTED = 130  # exit code: 128 and the number of Ctrl-C's signal
TERMINATED = 143  # exit code: 128 and the number of SIGTERM
BAR_EVERY_S = 0.2  # s between two updates of a bar
LINE_EVERY_S = 10  # s between two lines of progress where there is no terminal
_FIRST = 10  # lines of a long list that are printed


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Show a bar with the remaining time on standard error, or, without a terminal, a line every ten seconds."""
    if _present["quiet"]:
        yield lambda done, total, what="": None
        return
    if not sys.stderr.isatty():
        with _progress_lines(title) as advance:
            yield advance
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress as Bar, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    bar = Bar(*columns, console=Console(stderr=True), transient=True, auto_refresh=False)
    with bar, Ticker(bar.refresh, BAR_EVERY_S):
        task = bar.add_task(title, total=None)

        def advance(done: int, total: int, what: str = "") -> None:
            title_now = one_line(f"{title} {what}").rstrip()
            if done > bar.tasks[0].completed + 1:  # done in an earlier run: the remaining time counts from here
                bar.reset(task, completed=done, total=total, description=title_now)
            bar.update(task, completed=done, total=total, description=title_now)

        yield advance


@contextmanager
def _progress_lines(title: str) -> Iterator[Progress]:
    """Print a line of progress, elapsed time and what is left of the present pass at intervals."""
    began = time.monotonic()
    state, step = [title.rstrip(":"), ""], ("", began, 0)

    def advance(done: int, total: int, what: str = "") -> None:
        nonlocal step
        now = time.monotonic()
        if what != step[0] or done < step[2]:
            step = what, now, done
        counted = f": {done} of {total}" if total > done + 1 or done >= total else ""
        left = (total - done) * (now - step[1]) / (done - step[2]) if done > step[2] else 0.0
        state[:] = f"{title} {what}".rstrip() + counted, f", about {left:.0f} s left of it" if left >= 1 else ""

    with Ticker(lambda: _complain(f"{state[0]}, {time.monotonic() - began:.0f} s{state[1]}"), LINE_EVERY_S):
        yield advance


def say(*lines: str) -> None:
    """Print the human summary to standard output. Raises OutputError where that is a file on a full disk."""
    for line in () if _present["quiet"] else lines:
        (_complain if _present["prints JSON"] else _print)(one_line(line))


def _print(text: str) -> None:
    """Print a text. Raises OutputError where standard output is a file on a full disk."""
    try:
        typer.echo(text)
    except BrokenPipeError:
        raise
    except OSError as fault:
        _discard(sys.stdout)
        raise OutputError(
            f"cannot be written: {fault.strerror}", where="standard output", remedy="Send it elsewhere."
        ) from fault


def _complain(line: str) -> None:
    """Print to standard error, unless that cannot be written."""
    try:
        typer.echo(one_line(line), err=True)
    except OSError:
        _discard(sys.stderr)


def _discard(stream: TextIO) -> None:
    """Discard what a stream could not write, which Python would write again at exit."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def say_first(lines: Sequence[str], rest: Path) -> None:
    """Print the first of many lines; `rest` is the file with all of them."""
    say(*lines[:_FIRST])
    if len(lines) > _FIRST:
        say(f"  ... and {len(lines) - _FIRST} more, all in {rest}")


def warn(lines: Sequence[str]) -> None:
    """Print warnings to standard error, each on its own line, and once in a run of a command."""
    for line in lines:
        if line not in warned:
            warned.add(line)
            _complain(f"warning: {line}")


def hand_over(result: Any, path: Path | None) -> None:
    """Write the result for a program to the file of --json, or print it where that is "-"."""
    if path is None:
        return
    if path == STANDARD_OUTPUT:
        _print(as_json(result).rstrip())
        return
    try:
        write_json(path, result)
    except OutputError as fault:
        remedy = "The results themselves are written; name another file with --json."
        raise OutputError(fault.what, where=fault.where, value=fault.value, remedy=remedy) from fault


def report_failure(fault: BaseException) -> int:
    """Print one message and return the exit code; unknown failures are raised again."""
    if isinstance(fault, OSError) and fault.errno == ENOSPC and not fault.filename:  # help, or a file of results
        _discard(sys.stdout)
        where, remedy = "standard output or a file", "Make room, or send it elsewhere."
        fault = OutputError(f"cannot be written: {fault.strerror}", where=where, remedy=remedy)
    if isinstance(fault, TactilevisionError):
        _complain(f"error: {fault}")
        return fault.exit_code
    if isinstance(fault, typer.Abort | KeyboardInterrupt):
        _complain("interrupted: results written earlier are as they were.")
        return INTERRUPTED
    if isinstance(fault, Terminated):
        _complain("terminated: results written earlier are as they were.")
        return TERMINATED
    if isinstance(fault, SystemExit):
        return fault.code if isinstance(fault.code, int) else 1
    if isinstance(fault, BrokenPipeError):
        return 0
    if isinstance(fault, OSError) and fault.filename:  # a name too long, or no permission
        _complain(f"error: {str(fault.filename)[:200]}: cannot be used: {fault.strerror}.")
        return InputError.exit_code
    show = getattr(fault, "show", None)  # the parser's message of a wrong option or argument
    if callable(show):
        try:
            show()
        except OSError:
            _discard(sys.stderr)
        return int(getattr(fault, "exit_code", 2))
    raise fault
