"""Open regular files of bounded size and check names and numbers found in files."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from tactilevision.errors import InputError, TactilevisionError, one_line

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

# Limits of what a file may hold, far beyond what a sensor gives. A variable of the environment raises each:
# TACTILEVISION_MAX_PIXELS=200000000.

MB = 10**6  # bytes in a megabyte
MAX_PIXELS = 50_000_000  # of one picture: 8192 x 6144
MAX_ARRAY_MB = 500  # unpacked, of one .npy or .npz file: as a child process may have
MAX_FILE_MB = 4_000  # of one picture, table or array on disk
MAX_TEXT_MB = 64  # of one TOML or JSON file; calibrations have less than one
MAX_COLUMNS = 2_000  # of a table; recordings have some tens
MAX_DEPTH = 64  # of the dotted parts of a key: their time is quadratic; files have less than ten
MAX_NUMBER = 1_000_000_000_000  # of any number in mm, N, s, MPa or px; a time in s since 1970 has ten digits
MAX_CHILD_MB = 500  # besides its size, of memory for the reader of a log, a data set or a video
MAX_CHILD_SECONDS = 3  # of processor time for one answer of such a reader, and besides its size for all
MAX_EFFECT_SECONDS = 10  # of one call of a private effect; those of the catalogue take milliseconds


def limit(name: str) -> int:
    """Return a limit by its name, as the environment states it.

    Raises InputError if that is not a number above 0.
    """
    stated = os.environ.get(f"TACTILEVISION_{name}")
    if stated is None:
        return int(globals()[name])
    if not stated.isdigit() or int(stated) == 0:
        raise InputError("a limit is a whole number above 0", where=f"TACTILEVISION_{name}", value=stated)
    return int(stated)


def check(found: float, name: str, *, what: str, where: object) -> None:
    """Raise InputError if a size `found` in a file exceeds the limit of this name."""
    most = limit(name)
    if found > most:
        raise InputError(
            f"{what} is beyond the limit of {most:,}",
            where=where,
            value=found,
            remedy=f"If it is meant, set TACTILEVISION_{name} in the environment to a larger number.",
        )


# Opening regular files of bounded size.

_KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
    stat.S_IFSOCK: "a socket",
}


def open_regular(path: Path | str, *, limit: str | None = "MAX_FILE_MB") -> BinaryIO:
    """Open a file for reading bytes; `limit` names the largest size, None: any.

    Raises InputError for a pipe, a device, a folder or a socket, and for a file beyond the limit; OSError where
    the file system refuses. It never waits: a pipe is opened without blocking.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
    try:
        about = os.fstat(handle)
        kind = stat.S_IFMT(about.st_mode)
        if kind != stat.S_IFREG:
            raise InputError(
                f"is {_KINDS.get(kind, 'no regular file')}, not a file",
                where=path,
                remedy="Put a file in its place." if kind == stat.S_IFDIR else "Copy its content into a file.",
            )
        if limit is not None:
            check(about.st_size / MB, limit, what="its size in MB", where=path)
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def read_bytes(path: Path | str, *, limit: str = "MAX_FILE_MB") -> bytes:
    """Read all of a regular file. Raises as `open_regular` does."""
    with open_regular(path, limit=limit) as file:
        return file.read()


@contextmanager
def damage(where: object, *, what: str = "is damaged", remedy: str = "Copy it again.") -> Iterator[None]:
    """Raise InputError for errors of any kind, which libraries raise for a damaged file; those on purpose stay."""
    try:
        yield
    except TactilevisionError:
        raise
    except FileNotFoundError as fault:
        raise InputError("there is no such file", where=fault.filename or where) from fault
    except Exception as fault:
        said = " ".join(str(fault).split())[:160] or type(fault).__name__
        raise InputError(f"{what}: {said}", where=where, remedy=remedy) from fault


# Names in files: none leads out of its folder, by "..", an absolute path or a link.

MAX_NAME = 255  # bytes of a file's name; file systems take no more
_OUTWARD = re.compile(r"^[/\\~]|^[A-Za-z]:|(^|[/\\])\.\.([/\\]|$)")


def is_plain(text: str) -> bool:
    """Return whether a table or a message can hold it: no line break, escape or NUL, and UTF-8."""
    return one_line(text) == text


def check_plain(name: str, *, where: object) -> None:
    """Raise InputError for a file's name that is not plain."""
    if not is_plain(name):
        raise InputError(
            "a file's name holds a control character, or is not UTF-8",
            where=where,
            value=name,
            remedy="Rename it.",
        )


def inside(folder: Path, name: str, *, where: object) -> Path:
    """Return `folder / name`. Raises InputError if that leads out of the folder, is too long, or is not plain.

    `where` is the file that holds the name.
    """
    path = folder / name
    check_plain(name, where=where)
    if len(name.encode(errors="replace")) > MAX_NAME:
        raise InputError("a name is longer than a file can have", where=where, value=f"{name[:40]}...")
    if (
        not name
        or _OUTWARD.search(name)
        or (linked(folder, name) and not real_path(path).is_relative_to(real_path(folder)))
    ):
        raise InputError(
            "a name leads out of its folder",
            where=where,
            value=name,
            remedy=f"Name a file within {folder}; copy it there if it is elsewhere.",
        )
    return path


def real_path(path: Path | str) -> Path:
    """Return the absolute path without links; one within a circle of links stays as it is."""
    return Path(os.path.realpath(path))


def linked(folder: Path, name: str) -> bool:
    """Return whether a part of the way from the folder to the file is a link."""
    place = os.fspath(folder)
    for part in re.split(r"[/\\]", name):
        place = os.path.join(place, part)
        if os.path.islink(place):
            return True
    return False


# Numbers in files: finite, and below what any sensor gives.


def number(value: object, *, what: str, where: object) -> float | None:
    """Return a number of a parsed document, in its unit; None if there is none (null).

    Raises InputError where it is text, a truth value or a list, not finite, or beyond the limit MAX_NUMBER.
    """
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
        raise InputError(f"{what} is no number", where=where, value=str(value)[:40])
    check(abs(value), "MAX_NUMBER", what=what, where=where)
    return float(value)


def check_numbers(values: npt.NDArray[np.number], *, what: str, where: object) -> None:
    """Raise InputError where a number of an array, of any shape and in any unit, is infinite or too large.

    NaN passes: the reader decides whether a gap is allowed.
    """
    if values.dtype in ("int64", "uint64"):
        values = values.astype("float64")
    if values.dtype.kind == "f":
        largest = abs(values).max(initial=0.0, where=values == values)
        check(float(largest), "MAX_NUMBER", what=what, where=where)
