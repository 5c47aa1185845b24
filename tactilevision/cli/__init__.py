"""The console script `tactilevision`: options, one call and what is printed for each command."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import threading
from types import FrameType
from typing import NoReturn

from tactilevision.errors import Terminated

COLLECT_AFTER = 20_000  # new objects before cycles are looked for: each search walks all that imports made


def main() -> int:
    """Run the command line; returns the exit code.

    0 done · 2 bad input (also a wrong option) · 3 nothing could be certified · 130 interrupted · 143 terminated.
    """
    _ready_streams()
    gc.set_threshold(COLLECT_AFTER)
    for library in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(library, "1")  # matrices are small: threads would only wait for each other
    handled = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, _terminate) if handled else None
    try:
        code = _run()
    except (KeyboardInterrupt, Terminated) as stop:  # during imports
        code = 130 if isinstance(stop, KeyboardInterrupt) else 143
        sys.stderr.write(f"{'interrupted' if code == 130 else 'terminated'} before anything was done.\n")
    if code in (130, 143):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        exec("")  # noqa: S102 -- with -m, CPython else ends by the signal itself if Ctrl-C came within an exec
    elif handled:
        signal.signal(signal.SIGTERM, before)
    return code


def _ready_streams() -> None:
    """Open closed streams on the null device, and escape letters that a terminal lacks (\\u03bd)."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which else a file of results would
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _run() -> int:
    from tactilevision.cli.app import app
    from tactilevision.cli.console import INTERRUPTED, begin, report_failure
    from tactilevision.errors import InputError

    if "" in sys.argv[1:]:  # as a path it would be the current folder
        return report_failure(InputError("an argument is empty", remedy="Is a variable of the shell unset?"))
    begin()
    try:
        if app(standalone_mode=False) == INTERRUPTED:  # typer returns a number after Ctrl-C
            return report_failure(KeyboardInterrupt())
    except BaseException as fault:
        return report_failure(fault)
    return 0


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    """Raise on SIGTERM as on Ctrl-C, so that workers end and unfinished files are removed."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise Terminated
