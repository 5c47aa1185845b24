"""Opening a file: regular ones alone, of a size that was looked at first."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from tactilevision.door.limits import check
from tactilevision.errors import InputError

_KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
    stat.S_IFSOCK: "a socket",
}


class IrregularFileError(InputError):
    """A pipe, a device, a folder or a socket stands where a file should."""


def open_regular(path: Path | str, *, limit: str = "MAX_FILE_MB") -> BinaryIO:
    """Open a file for reading bytes; `limit` names the largest size.

    Raises IrregularFileError for a pipe, a device, a folder or a socket; InputError for a file beyond the limit;
    OSError where the file system refuses. It never waits: a pipe is opened without blocking, and told apart.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
    try:
        about = os.fstat(handle)
        kind = stat.S_IFMT(about.st_mode)
        if kind != stat.S_IFREG:
            raise IrregularFileError(
                f"is {_KINDS.get(kind, 'no regular file')}, not a file",
                where=path,
                remedy="Put a file in its place." if kind == stat.S_IFDIR else "Copy what it gives into a file.",
            )
        check(about.st_size / 1e6, limit, what="its size in MB", where=path)
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def check_regular(path: Path | str, *, limit: str = "MAX_FILE_MB") -> None:
    """The same looks at a file that another library will open by its name."""
    open_regular(path, limit=limit).close()


def read_bytes(path: Path | str, *, limit: str = "MAX_FILE_MB") -> bytes:
    """All of a regular file. Raises as `open_regular` does."""
    with open_regular(path, limit=limit) as file:
        return file.read()
