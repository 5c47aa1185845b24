"""Write a height map, or fields of many frames, as a Zarr store of format 2.

Every frame is one chunk and so one file, written whole: many processes fill one store.
"""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.files.tiff import masked, metadata
from tactilevision.files.writing import check_links, make_folder, output_errors, remove, unfinished
from tactilevision.records.maps import HeightMap

Singles = npt.NDArray[np.float32]
ZARR_THREADS = "zarr.core.sync"  # where zarr 3 keeps them


def write_zarr(path: Path | str, height: HeightMap) -> None:
    """Write a group with depth_mm (H, W), in mm, NaN where it is not known, and std_mm where it is stated."""
    fields = {"depth_mm": masked(height)}
    if height.std_mm is not None:
        fields["std_mm"] = height.std_mm.astype(np.float32)
    path = Path(path)
    scratch = path.with_name(f"{unfinished()}{path.name}")
    with output_errors(path):
        group = _new_group(scratch, {"name": height.name} | metadata(height))
        for name, values in fields.items():
            array = group.create_array(
                name, shape=values.shape, chunks=values.shape, dtype="f4", fill_value=np.nan
            )
            array.attrs.update({"unit": "mm", "_ARRAY_DIMENSIONS": ["y", "x"]})
            array[:] = values
        _move(scratch, path)


def begin_frames(
    scratch: Path,
    frames: Sequence[str],
    *,
    fields: Mapping[str, str],
    shape: tuple[int, int],
    about: Mapping[str, Any],
) -> None:
    """Make a store of `fields` (name: unit), (frames, rows, columns) float32 of NaN, and of `frame`, the names."""
    with output_errors(scratch), _own_threads():
        group = _new_group(scratch, about)
        for name, unit in fields.items():
            array = group.create_array(
                name, shape=(len(frames), *shape), chunks=(1, *shape), dtype="f4", fill_value=np.nan
            )
            array.attrs.update({"unit": unit, "_ARRAY_DIMENSIONS": ["frame", "y", "x"]})
        names = np.array(list(frames), dtype=np.str_)
        listed = group.create_array("frame", shape=names.shape, dtype=names.dtype)
        listed.attrs["_ARRAY_DIMENSIONS"] = ["frame"]
        listed[:] = names


def write_frame(scratch: Path, number: int, *, fields: Mapping[str, Singles]) -> None:
    """Write one frame's fields; (rows, columns) each, as zarr writes a chunk, without its threads."""
    with output_errors(scratch):
        for name, values in fields.items():
            if np.isnan(values).all():  # a chunk that is not there reads as NaN
                continue
            folder = scratch / name
            made = (folder / ".zarray").stat()  # a cluster's worker may write many stores to one path
            codec = _codec(str(folder), (made.st_ino, made.st_mtime_ns))
            chunk = folder / ".".join([str(number)] + ["0"] * values.ndim)
            check_links(chunk)
            partial = chunk.with_name(f"{chunk.name}.{uuid.uuid4().hex}.partial")
            partial.write_bytes(codec.encode(np.ascontiguousarray(values, "<f4")))
            os.replace(partial, chunk)


def read_frames(scratch: Path, fields: Sequence[str]) -> dict[str, Singles]:
    """Return the fields (frames, rows, columns) of a store, in their unit; NaN for unwritten frames."""
    import zarr

    with _own_threads():
        group = zarr.open_group(str(scratch), mode="r")
        return {name: np.asarray(group[name][:]) for name in fields}


def end_frames(scratch: Path, path: Path) -> None:
    """Move the finished store to its place, without partial files of killed writers."""
    _codec.cache_clear()
    with output_errors(path):
        for left in list(scratch.rglob("*.partial")):
            left.unlink()
        _move(scratch, path)


@lru_cache(maxsize=16)
def _codec(folder: str, made: tuple[int, int]) -> Any:
    """Return the codec of a field's chunks."""
    import numcodecs  # type: ignore[import-untyped]  # comes with zarr

    return numcodecs.get_codec(json.loads((Path(folder) / ".zarray").read_text())["compressor"])


def _new_group(scratch: Path, about: Mapping[str, Any]) -> Any:
    import zarr

    _codec.cache_clear()
    remove(scratch)
    make_folder(scratch.parent)
    group = zarr.open_group(str(scratch), mode="w", zarr_format=2)
    group.attrs.update(dict(about))
    return group


def settle(path: Path) -> None:
    """Restore the store of a run that was killed between the two renames of `_move`."""
    old = _old(path)
    with output_errors(path):
        if old.exists() and not path.exists():
            os.replace(old, path)
    remove(old)


def _move(scratch: Path, path: Path) -> None:
    settle(path)
    if path.exists():
        os.replace(path, _old(path))
    os.replace(scratch, path)
    remove(_old(path))


def _old(path: Path) -> Path:
    return path.with_name(f".{path.name}-old")


@contextmanager
def _own_threads() -> Iterator[None]:
    """End zarr's threads if they were started inside, so that workers can be forked (files/runs.py)."""
    if _loop_and_thread() is not None:  # started by others, who may be using them
        yield
        return
    try:
        yield
    finally:
        begun = _loop_and_thread()
        if begun is not None:
            loop, thread = begun
            loop.call_soon_threadsafe(loop.stop)
            thread.join()  # zarr itself waits .2 s, which is too short on a busy machine
            import_module(ZARR_THREADS).cleanup_resources()


def _loop_and_thread() -> tuple[Any, Any] | None:
    """Return zarr's event loop and thread; None of a version that keeps them elsewhere."""
    with suppress(ImportError, AttributeError):
        sync = import_module(ZARR_THREADS)
        if sync.loop[0] is not None and sync.iothread[0] is not None:
            return sync.loop[0], sync.iothread[0]
    return None
