"""Exceptions, grouped by what the reader would do about them.

    TactilevisionError
    ├── InputError          mend the file, the option or the argument      exit code 2
    │   ├── RecordingError  ... a file of a recording folder (FORMAT: docs/format.md)
    │   ├── OutputError     ... the place of the results (full disk, no permission)
    │   └── ClusterError    ... the cluster
    ├── NothingCertified    measure again: no press of the recording can be trusted   exit code 3
    └── ConvergenceError    a solver stopped before its tolerance; it returns nothing

Each message says what is wrong, where, the value found, and the remedy.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any

# control characters but the tab, line breaks, changes of the text's direction, surrogates of undecodable bytes
_UNPLAIN = re.compile(r"[\x00-\x08\x0a-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def one_line(text: str) -> str:
    """Return a text with control characters and line breaks spelt out (\\x1b), safe to print as one line."""
    return _UNPLAIN.sub(lambda found: ascii(found[0])[1:-1], text)


class Terminated(BaseException):
    """The process was asked to end (SIGTERM); handlers of Exception or SystemExit do not catch it."""


class TactilevisionError(Exception):
    """Base of every error that this library raises on purpose; the message is one line."""

    exit_code = 1

    def __init__(self, *parts: object) -> None:
        super().__init__(*(one_line(part) if isinstance(part, str) else part for part in parts))


class InputError(TactilevisionError, ValueError):
    """An argument or a file cannot be used.

    The message is ``where: what (got value). remedy``; empty parts are omitted.
    """

    exit_code = 2

    def __init__(self, what: str, *, where: object = "", value: object = None, remedy: str = "") -> None:
        self.what, self.where, self.value, self.remedy = what, str(where), value, remedy
        place = f"{self.where}: " if self.where else ""
        got = f" (got {value!r})" if value is not None else ""
        super().__init__(f"{place}{what}{got}." + (f" {remedy}" if remedy else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        # pickled by its parts, not by its message: workers send theirs to the process that started them
        return partial(type(self), where=self.where, value=self.value, remedy=self.remedy), (self.what,)


def check_known(name: str, known: Iterable[str], *, what: str, where: object) -> None:
    """Raise InputError for a name that is not among the `known`; `what` is the fault."""
    names = list(known)
    if name not in names:
        remedy = f"{did_you_mean(name, names)}Known are {', '.join(names)}."
        raise InputError(what, where=where, value=name, remedy=remedy)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the question for the most similar known name, or nothing where none is similar."""
    from difflib import get_close_matches  # takes a while to load

    near = get_close_matches(name, list(known), n=1)
    return f"Did you mean {near[0]}? " if near else ""


def library(name: str, *, extra: str, where: object) -> Any:
    """Import a module of an extra. Raises InputError if its package is missing."""
    try:
        return import_module(name)
    except ImportError as fault:
        what, remedy = (
            f"the package {name.partition('.')[0]} is missing",
            f"pip install '.[{extra}]' in the repository.",
        )
        raise InputError(what, where=where, remedy=f"Install it: {remedy}") from fault


def installed_version(package: str) -> str:
    """Return the version of a package; "" where it is not installed."""
    from importlib.metadata import PackageNotFoundError, version  # takes a while to load

    try:
        return version(package)
    except PackageNotFoundError:
        return ""


class RecordingError(InputError):
    """A file of a recording is missing, damaged, or holds something impossible."""


@contextmanager
def found_in(where: object, what: str = "") -> Iterator[None]:
    """Raise InputErrors of records as errors of the file, or the place in it, that holds their numbers."""
    try:
        yield
    except RecordingError:
        raise
    except InputError as fault:
        said = f"{what} {fault.what}".lstrip()
        raise RecordingError(said, where=where, value=fault.value, remedy=fault.remedy) from fault


class OutputError(InputError):
    """Results cannot be written where they should go."""


class ClusterError(InputError):
    """A cluster cannot be reached, has no workers, or has workers of another version."""


class NothingCertified(TactilevisionError):
    """Every press was rejected; the message lists each with its reason."""

    exit_code = 3


class ConvergenceError(TactilevisionError):
    """A numerical solution did not reach its tolerance; the message states how far it got."""
