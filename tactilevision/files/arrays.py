"""Read arrays from .npy and .npz files and members of stored zip archives, headers first."""

from __future__ import annotations

import hashlib
import io
import math
import os
import zipfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.documents import read_json
from tactilevision.files.opening import MB, check, damage, open_regular, read_bytes
from tactilevision.files.writing import replacing, write_json

_AGAIN = "Copy it again from its source."


def read_array(data: bytes, *, where: object) -> npt.NDArray[Any]:
    """Read the one array of a .npy file, as it is, of any shape, in its unit.

    Raises InputError where it is damaged, holds objects, or is too large.
    """
    with damage(where, what="the array is damaged", remedy=_AGAIN):
        return _array(partial(io.BytesIO, data), where)


def read_arrays(path: Path | str) -> Mapping[str, npt.NDArray[Any]]:
    """Read the arrays of a .npz file by their names, as they are, of any shape, in their unit.

    Raises InputError where the file is damaged, holds objects, or unpacks to more than the limit; OSError where
    the file system refuses.
    """
    with open_regular(path) as file:
        return _unpacked(file, path)


def unpack_arrays(data: bytes, *, where: object) -> Mapping[str, npt.NDArray[Any]]:
    """Read the arrays from the bytes of a .npz file by their names, of any shape, in their unit.

    Raises InputError as `read_arrays` does.
    """
    return _unpacked(io.BytesIO(data), where)


def save_table(path: Path, card: Mapping[str, Any], **arrays: npt.NDArray[Any]) -> None:
    """Write arrays of any shape, in their unit, as PATH (.npz), and their card, with their hash, as .json."""
    with replacing(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)
    write_json(path.with_suffix(".json"), {**card, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()})


def load_table(path: Path) -> tuple[Mapping[str, npt.NDArray[Any]], dict[str, Any]]:
    """Read arrays of any shape, in their unit, and card. Raises InputError where they differ."""
    card = read_json(path.with_suffix(".json"))
    if hashlib.sha256(read_bytes(path)).hexdigest() != card.get("sha256"):
        raise InputError(
            "the table differs from its card",
            where=path,
            remedy="Reinstall tactilevision, or tabulate anew.",
        )
    return read_arrays(path), card


def _unpacked(file: BinaryIO, where: object) -> Mapping[str, npt.NDArray[Any]]:
    with damage(where, what="the array is damaged", remedy=_AGAIN), zipfile.ZipFile(file) as packed:
        total = sum(about.file_size for about in packed.infolist())
        check(total / MB, "MAX_ARRAY_MB", what="what it unpacks to, in MB,", where=where)
        return {
            about.filename.removesuffix(".npy"): _array(partial(packed.open, about), f"{where}, {about.filename}")
            for about in packed.infolist()
        }


def _array(opened: Callable[[], IO[bytes]], where: object) -> npt.NDArray[Any]:
    """Read an array. Raises InputError if the header states objects, or more than the limit."""
    with opened() as file:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    if dtype.hasobject:
        what = "the array is damaged, or holds Python objects, which are never read"
        raise InputError(what, where=where, remedy="Store numbers.")
    size = math.prod(int(side) for side in shape) * dtype.itemsize
    check(size / MB, "MAX_ARRAY_MB", what=f"an array of shape {shape}, in MB,", where=where)
    with opened() as file:
        return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


# Archives: zip files of members that are stored, not compressed. Nothing is unpacked to disk.


def read_archive(path: Path | str) -> dict[str, bytes]:
    """Read the files of a zip by their names.

    Raises InputError where it is damaged, too large, or not such an archive; OSError where the file system
    refuses.
    """
    with open_regular(path) as file, damage(path, what="the archive is damaged", remedy=_AGAIN):
        packed = zipfile.ZipFile(file)
        total = sum(about.file_size for about in packed.infolist())
        check(total / MB, "MAX_ARRAY_MB", what="what it holds, in MB,", where=path)
        names = packed.namelist()
        if len(set(names)) != len(names) or total > os.fstat(file.fileno()).st_size:
            raise InputError(
                "the archive states more than the file has: a compressed member, or one twice",
                where=path,
                value=total,
                remedy="Take the file that `tactilevision calibrate-sensor` wrote.",
            )
        return {name: packed.read(name) for name in names}
