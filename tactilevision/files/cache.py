"""Cache of what takes seconds to compute, in files named by a hash of what it depends on.

The folder is $TACTILEVISION_CACHE, else $XDG_CACHE_HOME/tactilevision, else ~/.cache/tactilevision. A file that
cannot be read is made anew, and so is one of another revision of the sources; a folder that cannot be written to
is ignored. Beyond MOST_MB the files used least recently are removed.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError, OutputError, installed_version
from tactilevision.files.arrays import read_archive, unpack_arrays
from tactilevision.files.opening import MB
from tactilevision.files.writing import pack_arrays, replacing, write_archive

MOST_MB = 500  # of all files together
VARIABLE = "TACTILEVISION_CACHE"  # of the environment: the folder
OFF = "off"  # instead of a folder: nothing is kept
PACKAGE = "tactilevision."  # of the classes that are kept
T = TypeVar("T")
KEY = "key"  # name of the file with the whole key
SOURCES = "*.py", "*.json", "*.csv"  # code, cards and tables, on which all results depend
LIBRARIES = "numpy", "scipy", "opencv-contrib-python-headless", "matplotlib"  # others may round otherwise


def cache_folder() -> Path | None:
    """Return the folder that keeps files, made when something is written; None where nothing is kept."""
    own = os.environ.get(VARIABLE)
    if own:
        return None if own == OFF else Path(own)
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root and Path(root).is_absolute() else Path.home() / ".cache") / "tactilevision"


@cache
def source_digest() -> str:
    """Return a hash of both packages' sources and of the libraries' versions: others compute anew."""
    packages = [Path(__file__).parents[2] / name for name in ("tactilevision", "calibration")]
    digest = hashlib.sha256(repr([installed_version(name) for name in LIBRARIES]).encode())
    for path in sorted(path for one in packages for form in SOURCES for path in one.rglob(form)):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:20]


def kept(
    name: str, key: object, *, make: Callable[[], Mapping[str, bytes]], whole: Callable[[], bool] = lambda: True
) -> dict[str, bytes]:
    """Return the files that `make` writes for `key`: from the cache, else made, and kept if they are `whole`."""
    depends = repr((name, key, source_digest())).encode()
    folder = cache_folder()
    if folder is None:
        return dict(make())
    path = folder / f"{name}-{hashlib.sha256(depends).hexdigest()[:20]}.zip"
    found = _read(path, depends)
    if found is not None:
        return found
    made = dict(make())
    with suppress(OutputError, OSError):
        if whole():
            write_archive(path, made | {KEY: depends})
            _shrink(folder)
    return made


def kept_array(name: str, key: object, *, make: Callable[[], npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Return the array of `key`, of any shape and of its unit: read from the cache, else computed and kept."""
    files = kept(name, key, make=lambda: {"table.npz": pack_arrays({"table": make()}, small=False)})
    return unpack_arrays(files["table.npz"], where=Path(name))["table"]


# Records of this package, with tuples, mappings, arrays, texts and numbers in them: JSON, and arrays beside it.

RECORD, ARRAYS = "record.json", "arrays.npz"


def kept_record(name: str, key: object, *, make: Callable[[], T]) -> T:
    """Return the record of `key`: read from the cache, else made and kept; the first time from the same bytes."""
    files = kept(name, key, make=lambda: packed_record(make()))
    arrays = unpack_arrays(files[ARRAYS], where=Path(name))
    found: T = _unpacked(json.loads(files[RECORD]), arrays)
    return found


def packed_record(record: object, *, whatever: bool = False) -> dict[str, bytes]:
    """Return the files of a record; `whatever`: others stand there as their repr, for a hash of all.

    Raises TypeError for what is no record.
    """
    arrays: dict[str, npt.NDArray[Any]] = {}
    text = json.dumps(_packed(record, arrays, whatever=whatever))
    return {RECORD: text.encode(), ARRAYS: pack_arrays(arrays, small=False)}


def _packed(value: Any, arrays: dict[str, npt.NDArray[Any]], *, whatever: bool) -> Any:
    inner = partial(_packed, arrays=arrays, whatever=whatever)
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        arrays[f"a{len(arrays)}"] = value
        return {"array": f"a{len(arrays) - 1}"}
    if isinstance(value, tuple | list):
        return {type(value).__name__: [inner(one) for one in value]}
    if isinstance(value, Mapping):
        return {"mapping": [[inner(key), inner(one)] for key, one in value.items()]}
    kind = type(value)
    if is_dataclass(value) and kind.__module__.startswith(PACKAGE):
        parts = {field.name: inner(getattr(value, field.name)) for field in fields(value)}
        return {"class": f"{kind.__module__}:{kind.__name__}", "fields": parts}
    if not whatever:
        raise TypeError(f"{kind.__name__} is not kept")
    return repr(value)


def _unpacked(value: Any, arrays: Mapping[str, npt.NDArray[Any]]) -> Any:
    if not isinstance(value, dict):
        return value
    if "class" in value:
        kind = resolve_name(value["class"]) if value["class"].startswith(PACKAGE) else None
        if not (isinstance(kind, type) and is_dataclass(kind)):
            raise InputError("is no record", where=VARIABLE, value=value["class"], remedy="Delete the cache.")
        return kind(**{name: _unpacked(one, arrays) for name, one in value["fields"].items()})
    ((form, held),) = value.items()
    if form == "array":
        return arrays[held]
    if form == "mapping":
        return {_unpacked(key, arrays): _unpacked(one, arrays) for key, one in held}
    each = [_unpacked(one, arrays) for one in held]
    return tuple(each) if form == "tuple" else each


def remembered(name: str, key: object) -> str:
    """Return the text that `remember` kept for `key`; empty where there is none that this user alone may read."""
    path = _private(name, key)
    with suppress(OSError):
        if path is not None and not path.is_symlink() and not path.stat().st_mode & 0o077:
            return path.read_text(encoding="utf-8")
    return ""


def remember(name: str, key: object, text: str) -> None:
    """Keep a short text for this user alone, where a cache is kept and the system knows such files."""
    path = _private(name, key)
    if path is not None and os.name == "posix":
        with suppress(OutputError, OSError), replacing(path) as temporary:
            temporary.chmod(0o600)
            temporary.write_text(text, encoding="utf-8")


def _private(name: str, key: object) -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / f"{name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:20]}.txt"


def _read(path: Path, whole: bytes) -> dict[str, bytes] | None:
    try:
        files = read_archive(path)
        os.utime(path)
    except (OSError, InputError):
        return None
    return files if files.pop(KEY, b"") == whole else None


def _shrink(folder: Path) -> None:
    """Remove the files used least recently, until MOST_MB remain."""
    total = 0.0
    for path in sorted(folder.glob("*-*.zip"), key=lambda path: path.stat().st_mtime, reverse=True):
        total += path.stat().st_size / MB
        if total > MOST_MB:
            path.unlink()
