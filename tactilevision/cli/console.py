"""What the terminal sees: progress, as a bar or as lines, a plain summary, one clear line for a failure."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from errno import ENOSPC
from pathlib import Path
from typing import Annotated, Any, Protocol, TextIO

import typer

from tactilevision.errors import InputError, OutputError, TactilevisionError, Terminated
from tactilevision.files.opening import as_plain
from tactilevision.files.runs import Ticker
from tactilevision.files.writing import write_json


class FigureFormat(StrEnum):
    """The forms of plots.style.FORMS, which is not imported before something is drawn."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


OutOption = Annotated[Path, typer.Option("--out", help="Folder for the results; made if missing.")]
FormatOption = Annotated[
    FigureFormat,
    typer.Option(
        "--format", help="Write each figure in this form, too; PNG is always written, and in the report."
    ),
]


def _reached(context: typer.Context, address: str | None) -> str | None:
    """The address, once a scheduler has answered there: before the light is calibrated, which takes minutes.

    A shell that completes a line waits for no scheduler.
    """
    if address is not None and not context.resilient_parsing:
        from tactilevision.cluster.connect import check_cluster

        check_cluster(address)
    return address


ClusterOption = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        callback=_reached,
        help="A Dask cluster: tcp://HOST:PORT, or its scheduler file.",
    ),
]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Processes; one a core if left out.")]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Also write the result here, for a program.")]

PriorOption = Annotated[
    bool,
    typer.Option(
        "--prior/--no-prior", help="Hold Poisson's ratio to what elastomers have, where nothing is stated of it."
    ),
]

INTERRUPTED = 130  # exit code: 128 and the number of Ctrl-C's signal
TERMINATED = 143  # exit code: 128 and the number of SIGTERM
BAR_EVERY_S = 0.2  # s between two looks at a bar
LINE_EVERY_S = 10.0  # s between two lines of progress where there is no terminal: none for what is done sooner
_FIRST = 10  # lines of a long list that are printed; more would hide the summary above them


class Progress(Protocol):
    """Told how far a long job is: `done` of `total` steps, and what it is at."""

    def __call__(self, done: int, total: int, what: str = "") -> None: ...


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A bar with the remaining time on standard error; where that is no terminal, a line every ten seconds."""
    if not sys.stderr.isatty():
        with _progress_lines(title) as tell:
            yield tell
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress as Bar, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    bar = Bar(*columns, console=Console(stderr=True), transient=True, auto_refresh=False)
    with bar, Ticker(bar.refresh, BAR_EVERY_S):
        task = bar.add_task(title, total=None)

        def advance(done: int, total: int, what: str = "") -> None:
            title_now = f"{title} {what}".rstrip()
            if done > bar.tasks[0].completed + 1:  # found done already: the remaining time counts from here
                bar.reset(task, completed=done, total=total, description=title_now)
            bar.update(task, completed=done, total=total, description=title_now)

        yield advance


@contextmanager
def _progress_lines(title: str) -> Iterator[Progress]:
    """A line now and then, also while nothing is told: what is at work, how far, and since when."""
    began, state = time.monotonic(), [title]

    def tell(done: int, total: int, what: str = "") -> None:
        counted = f": {done} of {total}" if total > done + 1 or done >= total else ""
        state[0] = f"{title} {what}".rstrip() + counted

    with Ticker(lambda: _complain(f"{state[0]}, {time.monotonic() - began:.0f} s"), LINE_EVERY_S):
        yield tell


def say(*lines: str) -> None:
    """Print the human summary to standard output. Raises OutputError where that is a file on a full disk."""
    for line in lines:
        try:
            typer.echo(as_plain(line))
        except BrokenPipeError:
            raise
        except OSError as fault:
            _let_go(sys.stdout)
            raise OutputError(
                f"cannot be written: {fault.strerror}", where="standard output", remedy="Send it elsewhere."
            ) from fault


def _complain(line: str) -> None:
    """To standard error, where that can be written: if not, the results and the exit code tell."""
    try:
        typer.echo(as_plain(line), err=True)
    except OSError:
        _let_go(sys.stderr)


def _let_go(stream: TextIO) -> None:
    """Let what a stream could not write go nowhere: Python writes what is left at its end."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def say_first(lines: Sequence[str], rest: Path) -> None:
    """Print the first of many lines; `rest` is where all of them stand."""
    say(*lines[:_FIRST])
    if len(lines) > _FIRST:
        say(f"  ... and {len(lines) - _FIRST} more, all in {rest}")


def warn(lines: Sequence[str]) -> None:
    """Print warnings to standard error, each on its own line."""
    for line in lines:
        _complain(f"warning: {line}")


def hand_over(result: Any, path: Path | None) -> None:
    """Write the result for a program, where one was asked for."""
    if path is None:
        return
    try:
        write_json(path, result)
    except OutputError as fault:
        remedy = "The results themselves are written; name another file with --json."
        raise OutputError(fault.what, where=fault.where, value=fault.value, remedy=remedy) from fault


def report_failure(fault: BaseException) -> int:
    """Print one clear message and return the exit code; what is no known failure is raised again."""
    if isinstance(fault, OSError) and fault.errno == ENOSPC and not fault.filename:  # help, or a file of results
        _let_go(sys.stdout)
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
    if isinstance(fault, OSError) and fault.filename:  # a name too long, no permission: the place is at fault
        _complain(f"error: {str(fault.filename)[:200]}: cannot be used: {fault.strerror}.")
        return InputError.exit_code
    show = getattr(fault, "show", None)  # a wrong option or argument, worded by the command line's parser
    if callable(show):
        try:
            show()
        except OSError:
            _let_go(sys.stderr)
        return int(getattr(fault, "exit_code", 2))
    raise fault
