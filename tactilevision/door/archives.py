"""Several files in one: a zip that stores them as they are, each looked at before it is read.

Nothing is unpacked to disk. A packed or encrypted member, one that stands there twice, and a folder are refused.
"""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

from tactilevision.door.arrays import DAMAGED
from tactilevision.door.limits import check
from tactilevision.door.opening import open_regular
from tactilevision.errors import InputError

MAX_MEMBERS = 64  # files in one archive; ours hold fewer than ten
_ENCRYPTED = 0x1  # bit of a member's flags


def read_archive(path: Path | str) -> dict[str, bytes]:
    """The files of a zip by their names.

    Raises InputError where it is damaged, too large, or not such an archive; OSError where the file system
    refuses.
    """
    with open_regular(path) as file:
        try:
            with zipfile.ZipFile(file) as packed:
                members = packed.infolist()
                _check(members, Path(path), size=os.fstat(file.fileno()).st_size)
                return {about.filename: packed.read(about) for about in members}
        except InputError:
            raise
        except DAMAGED as fault:
            said = " ".join(str(fault).split()) or type(fault).__name__
            raise InputError(
                f"the archive is damaged: {said[:200]}", where=path, remedy="Copy it again from where it came."
            ) from fault


def _check(members: list[zipfile.ZipInfo], path: Path, *, size: int) -> None:
    total = sum(about.file_size for about in members)
    check(total / 1e6, "MAX_ARRAY_MB", what="what it holds, in MB,", where=path)
    names = [about.filename for about in members]
    if len(names) > MAX_MEMBERS or len(set(names)) != len(names):
        raise InputError("the archive holds more files than ours do, or one twice", where=path, value=len(names))
    for about in members:
        stored = about.compress_type == zipfile.ZIP_STORED and about.compress_size == about.file_size
        named = about.filename and not about.is_dir()
        if not stored or about.flag_bits & _ENCRYPTED or not named:
            raise InputError(
                "the archive holds what is not stored as it is",
                where=path,
                value=about.filename,
                remedy="Take the file that `tactilevision calibrate-sensor` wrote.",
            )
    if total > size:  # members that share their bytes
        raise InputError("the archive states more than the file has", where=path, value=total)
