"""Write a height map, or fields of many frames, as a Zarr store of format 2.

Every frame is one chunk and so one file, written whole: many processes fill one store. Chunks are not compressed,
since the noise of depths does not pack. Source: Zarr storage specification, version 2.
"""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.files.tiff import masked
from tactilevision.files.writing import output_errors, unfinished
from tactilevision.records.maps import HeightMap

Singles = npt.NDArray[np.float32]


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
        _begin(scratch, about)
        for name, values in fields.items():
            _begin_array(scratch / name, values.shape, values.shape, about=_field("mm", "y", "x"))
            (scratch / name / "0.0").write_bytes(_packed(values))
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
    names = np.array(list(frames), dtype=np.str_)
    with output_errors(scratch):
        _begin(scratch, about)
        for name, unit in fields.items():
            whole = (len(frames), *shape)
            _begin_array(scratch / name, whole, (1, *shape), about=_field(unit, "frame", "y", "x"))
        dtype = names.dtype.newbyteorder("<")
        listed = {"_ARRAY_DIMENSIONS": ["frame"]}
        _begin_array(scratch / "frame", names.shape, names.shape, dtype=dtype.str, fill_value="", about=listed)
        (scratch / "frame" / "0").write_bytes(names.astype(dtype).tobytes())


def write_frame(scratch: Path, number: int, *, fields: Mapping[str, Singles]) -> None:
    """Write one frame's fields, (rows, columns) each."""
    with output_errors(scratch):
        for name, values in fields.items():
            chunk = scratch / name / ".".join([str(number)] + ["0"] * values.ndim)
            partial = chunk.with_name(f"{chunk.name}.{uuid.uuid4().hex}.partial")
            partial.write_bytes(_packed(values))
            os.replace(partial, chunk)


def end_frames(scratch: Path, path: Path) -> None:
    """Move the finished store to its place, without partial files of killed writers."""
    with output_errors(path):
        for left in list(scratch.rglob("*.partial")):
            left.unlink()
        _move(scratch, path)


def _packed(values: Singles) -> bytes:
    return np.ascontiguousarray(values, "<f4").tobytes()


def _field(unit: str, *dimensions: str) -> dict[str, Any]:
    return {"unit": unit, "_ARRAY_DIMENSIONS": list(dimensions)}


def _begin(scratch: Path, about: Mapping[str, Any]) -> None:
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    (scratch / ".zgroup").write_text(json.dumps({"zarr_format": 2}))
    (scratch / ".zattrs").write_text(json.dumps(dict(about)))


def _begin_array(
    folder: Path,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    *,
    dtype: str = "<f4",
    fill_value: str = "NaN",
    about: Mapping[str, Any],
) -> None:
    layout = {"zarr_format": 2, "shape": shape, "chunks": chunks, "dtype": dtype, "fill_value": fill_value}
    folder.mkdir()
    (folder / ".zarray").write_text(json.dumps(layout | {"order": "C", "compressor": None, "filters": None}))
    (folder / ".zattrs").write_text(json.dumps(dict(about)))


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
