"""Write a height map, or fields of many frames, as a Zarr store of format 2.

Every frame is one chunk and so one file, written whole: many processes fill one store. The files of the format are
written here: zarr itself would start threads, after which workers could not be forked (files/runs.py).
Source: Zarr storage specification, version 2.
"""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.files.tiff import masked
from tactilevision.files.writing import output_errors, unfinished
from tactilevision.records.maps import HeightMap

Singles = npt.NDArray[np.float32]
_COMPRESSOR = {"id": "blosc", "cname": "lz4", "clevel": 5, "shuffle": 1, "blocksize": 0}  # the default of zarr


def write_zarr(path: Path | str, height: HeightMap) -> None:
    """Write a group with depth_mm (H, W), in mm, NaN where it is not known, and std_mm where it is stated."""
    fields = {"depth_mm": masked(height)}
    if height.std_mm is not None:
        fields["std_mm"] = height.std_mm.astype(np.float32)
    path = Path(path)
    scratch = path.with_name(f"{unfinished()}{path.name}")
    about = {
        "mm_per_px": list(height.mm_per_px),
        "name": height.name,
        "positions": height.positions,
        "flags": list(height.flags),
    }
    with output_errors(path):
        _new_group(scratch, about)
        for name, values in fields.items():
            _new_array(scratch / name, values.shape, values.shape, axes=["y", "x"], unit="mm")
            _write_chunk(scratch / name / "0.0", values)
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
    with output_errors(scratch):
        _new_group(scratch, about)
        for name, unit in fields.items():
            axes = ["frame", "y", "x"]
            _new_array(scratch / name, (len(frames), *shape), (1, *shape), axes=axes, unit=unit)
        names = np.array(list(frames), dtype=np.str_)
        kind: dict[str, Any] = {"dtype": names.dtype.str, "fill_value": "", "compressor": None}
        _new_array(scratch / "frame", names.shape, names.shape, axes=["frame"], **kind)
        (scratch / "frame" / "0").write_bytes(names.tobytes())


def write_frame(scratch: Path, number: int, *, fields: Mapping[str, Singles]) -> None:
    """Write one frame's fields; (rows, columns) each."""
    with output_errors(scratch):
        for name, values in fields.items():
            _write_chunk(scratch / name / f"{number}.0.0", values)


def end_frames(scratch: Path, path: Path) -> None:
    """Move the finished store to its place, without partial files of killed writers."""
    with output_errors(path):
        for left in list(scratch.rglob("*.partial")):
            left.unlink()
        _move(scratch, path)


def _new_group(scratch: Path, about: Mapping[str, Any]) -> None:
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    _write_parts(scratch, {".zgroup": {"zarr_format": 2}, ".zattrs": dict(about)})


def _new_array(
    folder: Path, shape: tuple[int, ...], chunks: tuple[int, ...], *, axes: list[str], unit: str = "", **kind: Any
) -> None:
    """Make an array without chunks, float32 of NaN unless `kind` states another type."""
    folder.mkdir()
    usual = {"dtype": "<f4", "fill_value": "NaN", "compressor": _COMPRESSOR, "order": "C", "filters": None}
    about = usual | kind | {"shape": shape, "chunks": chunks, "dimension_separator": ".", "zarr_format": 2}
    attributes: dict[str, Any] = {"unit": unit} if unit else {}
    _write_parts(folder, {".zarray": about, ".zattrs": attributes | {"_ARRAY_DIMENSIONS": axes}})


def _write_parts(folder: Path, parts: Mapping[str, Any]) -> None:
    for name, content in parts.items():
        (folder / name).write_text(json.dumps(content, indent=2))


def _write_chunk(chunk: Path, values: Singles) -> None:
    partial = chunk.with_name(f"{chunk.name}.{uuid.uuid4().hex}.partial")
    partial.write_bytes(_codec().encode(np.ascontiguousarray(values, "<f4")))
    os.replace(partial, chunk)


@cache
def _codec() -> Any:
    import numcodecs  # type: ignore[import-untyped]  # comes with zarr

    return numcodecs.get_codec(_COMPRESSOR)


def settle(path: Path) -> None:
    """Restore the store of a run that was killed between the two renames of `_move`."""
    old = _old(path)
    with output_errors(path):
        if old.exists() and not path.exists():
            os.replace(old, path)
    shutil.rmtree(old, ignore_errors=True)


def _move(scratch: Path, path: Path) -> None:
    settle(path)
    if path.exists():
        os.replace(path, _old(path))
    os.replace(scratch, path)
    shutil.rmtree(_old(path), ignore_errors=True)


def _old(path: Path) -> Path:
    return path.with_name(f".{path.name}-old")
