"""Tables that take seconds to make, kept in the user's cache under a hash of what they depend on.

The folder is $TACTILEVISION_CACHE, else $XDG_CACHE_HOME/tactilevision, else ~/.cache/tactilevision. A file that
cannot be read is made anew; a folder that cannot be written to costs only the time of the next start.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.door.arrays import read_arrays
from tactilevision.errors import InputError, OutputError
from tactilevision.files import replacing

VERSION = 1  # part of every hash: raise it when the numbers change


def cache_folder() -> Path:
    """Where tables are kept. Not made before something is written."""
    own = os.environ.get("TACTILEVISION_CACHE")
    if own:
        return Path(own)
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root and Path(root).is_absolute() else Path.home() / ".cache") / "tactilevision"


def kept(name: str, key: object, *, make: Callable[[], npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """The array of `key`, of any shape and in any unit: read where it was kept, else made and kept."""
    digest = hashlib.sha256(repr((VERSION, name, key)).encode()).hexdigest()[:20]
    path = cache_folder() / f"{name}-{digest}.npz"
    found = _read(path, repr(key))
    if found is not None:
        return found
    made = make()
    try:
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, table=made, key=np.array(repr(key)))
    except OutputError:
        pass
    return made


def _read(path: Path, key: str) -> npt.NDArray[Any] | None:
    try:
        file = read_arrays(path)
        return file["table"] if str(file["key"]) == key else None
    except (OSError, KeyError, InputError):
        return None
