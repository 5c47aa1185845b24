"""Cache of arrays that take seconds to compute, in files named by a hash of what the arrays depend on.

The folder is $TACTILEVISION_CACHE, else $XDG_CACHE_HOME/tactilevision, else ~/.cache/tactilevision. A file that
cannot be read is computed anew; a folder that cannot be written to is ignored. Beyond MOST_MB the files used least
recently are removed.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError, OutputError
from tactilevision.files.arrays import read_arrays
from tactilevision.files.opening import MB
from tactilevision.files.writing import replacing

VERSION = 2  # part of every hash: raise it when the numbers change
MOST_MB = 500  # of all files together


def cache_folder() -> Path:
    """Return the folder that keeps arrays; it is made when something is written."""
    own = os.environ.get("TACTILEVISION_CACHE")
    if own:
        return Path(own)
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root and Path(root).is_absolute() else Path.home() / ".cache") / "tactilevision"


def kept(name: str, key: object, *, make: Callable[[], npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Return the array of `key`, of any shape and of its unit: read from the cache, else computed and kept."""
    digest = hashlib.sha256(repr((VERSION, name, key)).encode()).hexdigest()[:20]
    path = cache_folder() / f"{name}-{digest}.npz"
    found = _read(path, repr(key))
    if found is not None:
        with suppress(OSError):
            os.utime(path)
        return found
    made = make()
    with suppress(OutputError, OSError):
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, table=made, key=np.array(repr(key)))
        _shrink(path.parent)
    return made


def _read(path: Path, key: str) -> npt.NDArray[Any] | None:
    try:
        file = read_arrays(path)
        return file["table"] if str(file["key"]) == key else None
    except (OSError, KeyError, InputError):
        return None


def _shrink(folder: Path) -> None:
    """Remove the files used least recently, until MOST_MB remain."""
    files = sorted(folder.glob("*-*.npz"), key=lambda path: path.stat().st_mtime, reverse=True)
    total = 0.0
    for path in files:
        total += path.stat().st_size / MB
        if total > MOST_MB:
            path.unlink()
