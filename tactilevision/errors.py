"""Everything that can go wrong, grouped by what the reader would do about it.

    TactilevisionError
    ├── InputError          mend the file, the option or the argument      exit code 2
    │   ├── RecordingError  ... a file of a recording folder (FORMAT: docs/format.md)
    │   ├── OutputError     ... the place that results should go to (full disk, no permission)
    │   └── ClusterError    ... the cluster that should do the work
    ├── NothingCertified    measure again: no press of the recording can be trusted   exit code 3
    └── ConvergenceError    a solver stopped before its tolerance; its result is not handed out

Each message says what is wrong, where, the value found, and the remedy.
"""

from __future__ import annotations

from functools import partial
from typing import Any


class Terminated(BaseException):
    """The process was asked to end (SIGTERM). No guard against Exception or SystemExit holds it up."""


class TactilevisionError(Exception):
    """Base of every error that this library raises on purpose."""

    exit_code = 1


class InputError(TactilevisionError, ValueError):
    """Something handed in cannot be used as it is.

    The message is put together as ``where: what (got value). remedy``; parts left empty are left out.
    """

    exit_code = 2

    def __init__(self, what: str, *, where: object = "", value: object = None, remedy: str = "") -> None:
        self.what, self.where, self.value, self.remedy = what, str(where), value, remedy
        place = f"{self.where}: " if self.where else ""
        got = f" (got {value!r})" if value is not None else ""
        super().__init__(f"{place}{what}{got}." + (f" {remedy}" if remedy else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        # pickled by what it is made of, not by its message: workers send theirs to the process that asked
        return partial(type(self), where=self.where, value=self.value, remedy=self.remedy), (self.what,)


class RecordingError(InputError):
    """A file of a recording is missing, damaged, or says something impossible."""


class OutputError(InputError):
    """Results cannot be written where they should go."""


class ClusterError(InputError):
    """A cluster cannot be reached, has no workers, or theirs are of another version."""


class NothingCertified(TactilevisionError):
    """Every press was rejected; the message lists each with its reason."""

    exit_code = 3


class ConvergenceError(TactilevisionError):
    """A numerical solution did not reach its tolerance; says how far it got."""
