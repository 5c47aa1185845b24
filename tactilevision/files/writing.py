"""Write results atomically: a reader sees the old file or the new one."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
import shutil
import stat
import tempfile
import time
import uuid
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from tactilevision.errors import OutputError, Terminated

_UNFINISHED = ".unfinished-"  # prefix of a file being written; the number of its process follows
PAUSE_S = 0.05  # s between two checks of a process or a page that is ending
_STREAMS = (Path("/dev"), Path("/dev/fd"), Path("/proc/self/fd"))  # links to what a process reads and writes
_LONGEST = 60  # letters; usual disks hold names of 255 bytes


def plain_name(label: str) -> str:
    """Return a text as part of a file's name that leads out of no folder and that every disk holds."""
    return re.sub(r"[^\w .+-]", "_", label)[:_LONGEST].lstrip(".")


# Folders of results may be somebody else's: what lies in them is never written, removed or copied through a link.

_OTHER = "Remove it, or choose another folder with --out."
_folders: list[str] = []  # folders of results that this process writes, as they were named


@contextmanager
def writes_into(folder: Path | str) -> Iterator[None]:
    """Refuse links below this folder, whatever is written, until the end."""
    _folders.append(os.path.abspath(folder))
    try:
        yield
    finally:
        _folders.remove(os.path.abspath(folder))


def check_links(path: Path | str) -> None:
    """Raise OutputError where a folder between a folder of results and `path` in it is a link."""
    below = tuple(os.path.join(one, "") for one in _folders)
    for folder in Path(os.path.abspath(path)).parents:
        if str(folder).startswith(below) and os.path.islink(folder):
            raise OutputError("a folder of the results is a link, and not followed", where=folder, remedy=_OTHER)


def open_own(path: Path | str, flags: int) -> int:
    """Open a file of results to write and read, and return its number.

    Raises OutputError for a link, a pipe, a device, and a file with a second name; OSError where the system
    refuses.
    """
    check_links(path)
    safe = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        handle = os.open(path, flags | safe, 0o666)
    except OSError as fault:
        if fault.errno not in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
            raise
        raise OutputError("is a link or no file, and is not written", where=path, remedy=_OTHER) from fault
    about = os.fstat(handle)
    if not stat.S_ISREG(about.st_mode) or about.st_nlink > 1:
        os.close(handle)
        raise OutputError("is no file, or has a second name, and is not written", where=path, remedy=_OTHER)
    return handle


def remove(path: Path) -> None:
    """Remove a file, a link or a folder of results, if it is there."""
    check_links(path)
    with output_errors(path):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def copy_file(source: BinaryIO, target: Path) -> None:
    """Copy an open file whole, and close it."""
    with source, replacing(target) as temporary, temporary.open("wb") as file:
        shutil.copyfileobj(source, file)


def copy_own(source: Path, target: Path) -> None:
    """Copy a file of results as `open_own` opens it: what a link leads to is not made public."""
    with output_errors(source):
        handle = open_own(source, os.O_RDONLY)
    copy_file(os.fdopen(handle, "rb"), target)


def make_folder(path: Path | str) -> Path:
    """Make a folder for results, and those it lies in. Raises OutputError where the file system refuses."""
    folder = Path(path)
    check_links(folder / "file")
    with output_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def append_text(path: Path | str, text: str) -> None:
    """Append to a file that is there: one write at its end, so that many processes may do so at a time."""
    with output_errors(Path(path)):
        handle = open_own(path, os.O_WRONLY | os.O_APPEND)
        try:
            os.write(handle, text.encode(errors="backslashreplace"))
        finally:
            os.close(handle)


_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # no room on the disk, in the quota, in the file
_PART = re.compile(r"\d+ requested and \d+ written")  # numpy's message of a full disk, which has no errno


@contextmanager
def output_errors(target: Path) -> Iterator[None]:
    """Raise OutputError where the file system refuses what is written to `target`."""
    try:
        yield
    except OSError as fault:
        full = fault.errno in _FULL or _PART.search(str(fault))
        remedy = ("Free some space or choose" if full else "Choose") + " another folder with --out."
        raise OutputError(f"cannot be written: {fault.strerror or fault}", where=target, remedy=remedy) from fault


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; on success it is renamed to `path`, else removed.

    The temporary name keeps the suffix of `path`, by which many writers choose the format. Missing folders are
    made. Raises OutputError where the file system refuses (disk full, no permission), and for a device or a pipe,
    which the file would replace.
    """
    target = Path(path)
    check_replaceable(target)
    temporary = target.parent / f"{unfinished()}{uuid.uuid4().hex}{target.suffix}"
    with output_errors(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)
    try:
        with output_errors(target):
            yield temporary
            temporary.replace(target)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def check_replaceable(target: Path) -> None:
    """Raise OutputError for /dev/stdout, a device, a pipe or a folder, which a renamed file would replace.

    A link is replaced itself, unless it leads to one of these; a folder on the way is none.
    """
    check_links(target)
    if "\0" in str(target):
        raise OutputError("a name holds a NUL", where=target, remedy="Choose another name.")
    with output_errors(target):
        there = os.path.lexists(target)
        plain = not target.exists() or target.is_file()
    if there and (not plain or target.absolute().parent in _STREAMS):
        raise OutputError("is not a file that can be replaced", where=target, remedy="Name a file.")


@contextmanager
def staged(folder: Path | str, *, last: str = "") -> Iterator[Path]:
    """Yield an empty folder for results; on success all its files move into `folder`, else none does.

    An interrupted run leaves earlier results as they were. Files of `folder` that the new results do not replace
    stay. `last` names a folder of the results that is moved last and at once, so that all is there where it is.
    Raises OutputError as `replacing` does, and where `last` exists.
    """
    target = Path(folder)
    if last and os.path.lexists(target / last):
        raise OutputError(f"holds {last} already", where=target, remedy="Choose an empty folder with --out.")
    make_folder(target)
    with output_errors(target):
        clear_unfinished(target)
        stage = Path(tempfile.mkdtemp(prefix=unfinished(), dir=target))
    try:
        with output_errors(target), writes_into(target):
            yield stage
            try:
                _move(stage, target, last)
            except (KeyboardInterrupt, SystemExit, Terminated):  # finish, so that results are not half moved
                _move(stage, target, last)
                raise
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _move(stage: Path, target: Path, last: str) -> None:
    """Move all, after it is known that each can be moved; a new folder is moved as a whole."""
    moves = list(_moves(stage, target))
    for _, place in moves:
        check_replaceable(place)
    for path, place in sorted(moves, key=lambda move: move[0] == stage / last):
        path.replace(place)


def _moves(stage: Path, target: Path) -> Iterator[tuple[Path, Path]]:
    for path in sorted(stage.iterdir()):
        place = target / path.name
        if path.is_dir() and os.path.lexists(place):
            yield from _moves(path, place)
        else:
            yield path, place


def clear_unfinished(folder: Path, *, deep: bool = False, wait_s: float = 0.0) -> None:
    """Remove unfinished files of killed runs from a folder, with `deep` also from those below it.

    Files of running processes stay; for those that are ending it waits `wait_s` at most.
    """
    until = time.monotonic() + wait_s
    while True:
        found = list((folder.rglob if deep else folder.glob)(f"{_UNFINISHED}*"))
        left = [path for path in found if not _cleared(path)]
        if not left or time.monotonic() >= until:
            return
        time.sleep(PAUSE_S)


def _cleared(path: Path) -> bool:
    owner = path.name.removeprefix(_UNFINISHED).partition("-")[0]
    if owner.isdecimal() and process_runs(int(owner)):
        return False
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()
    return True


def process_runs(process: int) -> bool:
    """Return whether there is a process of that number that has not ended (a zombie has)."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        return True
    with suppress(OSError, IndexError):  # Linux alone has it
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return True


def unfinished() -> str:
    """Return the prefix of the names of files that this process has not finished."""
    return f"{_UNFINISHED}{os.getpid()}-"


def write_text(path: Path | str, text: str) -> None:
    """Write UTF-8 text, whole or not at all; bytes of a file's name that are no UTF-8 are written as \\udcXX."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write bytes, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: Path | str, content: object) -> None:
    """Write JSON that every parser accepts: NaN and infinities become null. The order of keys is kept."""
    write_text(path, as_json(content))


def as_json(content: object) -> str:
    """Return the text that `write_json` writes."""
    return json.dumps(_finite(content), indent=2, allow_nan=False) + "\n"


def pack_arrays(arrays: Mapping[str, Any], *, small: bool) -> bytes:
    """Return the bytes of a .npz file of `arrays`, the same for the same ones; `small` takes longer to read."""
    import numpy as np

    packed = io.BytesIO()
    (np.savez_compressed if small else np.savez)(packed, **arrays)
    return packed.getvalue()


def write_archive(path: Path | str, files: Mapping[str, bytes]) -> None:
    """Write `files` by their names into one uncompressed zip; the same content gives the same bytes."""
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as packed:
        for name, content in files.items():
            about = zipfile.ZipInfo(name)  # dated 1980
            about.external_attr = 0o644 << 16
            packed.writestr(about, content)


def _finite(content: object) -> object:
    if isinstance(content, dict):
        return {str(key): _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    if hasattr(content, "tolist"):  # numpy arrays and scalars
        return _finite(content.tolist())
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
