"""Arrays from .npy and .npz files: shapes and types are read from the headers before any number is."""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tactilevision.door.limits import check
from tactilevision.door.opening import open_regular
from tactilevision.errors import InputError

DAMAGED = (ValueError, EOFError, OSError, KeyError, TypeError, AttributeError, SyntaxError, OverflowError,
           MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error, tokenize.TokenError)  # fmt: skip


class DamagedArrayError(InputError):
    """The file is cut short or damaged; another copy may be sound."""


def read_array(data: bytes, *, where: object) -> npt.NDArray[Any]:
    """The one array of a .npy file, as it is, of any shape, in its unit.

    Raises DamagedArrayError where it is damaged or holds objects, InputError where it is too large.
    """
    try:
        _check_header(io.BytesIO(data), where)
        return np.asarray(np.lib.format.read_array(io.BytesIO(data), allow_pickle=False))
    except InputError:
        raise
    except DAMAGED as fault:
        raise _damaged(fault, where) from fault


def read_arrays(path: Path | str) -> Mapping[str, npt.NDArray[Any]]:
    """The arrays of a .npz file by their names, as they are, of any shape, in their unit.

    Raises InputError where the file is damaged, holds objects, or unpacks to more than the limit; OSError where
    the file system refuses.
    """
    with open_regular(path) as file:
        return _unpacked(file, path)


def unpack_arrays(data: bytes, *, where: object) -> Mapping[str, npt.NDArray[Any]]:
    """The arrays of the bytes of a .npz file by their names, of any shape, in their unit.

    Raises InputError as `read_arrays` does.
    """
    return _unpacked(io.BytesIO(data), where)


def _unpacked(file: BinaryIO, where: object) -> Mapping[str, npt.NDArray[Any]]:
    try:
        with zipfile.ZipFile(file) as packed:
            total = sum(about.file_size for about in packed.infolist())
            check(total / 1e6, "MAX_ARRAY_MB", what="what it unpacks to, in MB,", where=where)
            return {about.filename.removesuffix(".npy"): _member(packed, about, where)
                    for about in packed.infolist()}  # fmt: skip
    except InputError:
        raise
    except DAMAGED as fault:
        raise _damaged(fault, where) from fault


def _member(packed: zipfile.ZipFile, about: zipfile.ZipInfo, source: object) -> npt.NDArray[Any]:
    where = f"{source}, {about.filename}"
    with packed.open(about) as member:
        _check_header(member, where)  # type: ignore[arg-type]
    with packed.open(about) as member:
        return np.asarray(np.lib.format.read_array(member, allow_pickle=False))


def _check_header(file: BinaryIO, where: object) -> None:
    """Raise where the header states more than the limit: the numbers themselves may be few."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if dtype.hasobject:
        raise DamagedArrayError(
            "the array is damaged, or holds Python objects, which are never read",
            where=where,
            remedy="Store numbers.",
        )
    size = math.prod(int(side) for side in shape) * dtype.itemsize
    check(size / 1e6, "MAX_ARRAY_MB", what=f"an array of shape {shape}, in MB,", where=where)


def _damaged(fault: BaseException, where: object) -> DamagedArrayError:
    said = " ".join(str(fault).split()) or type(fault).__name__
    return DamagedArrayError(
        f"the array is damaged: {said[:200]}", where=where, remedy="Copy it again from where it came."
    )
