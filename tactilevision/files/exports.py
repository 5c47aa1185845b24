"""Write a height map in a format of other programs: TIFF, NPZ, Zarr, PLY or VTK."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import check_known
from tactilevision.files.tiff import masked, write_tiff
from tactilevision.files.writing import replacing
from tactilevision.files.zarr_store import write_zarr
from tactilevision.records.maps import HeightMap

# A height map as a surface in space. Programs for it need right-handed axes. The camera looks at the gel from
# inside: x to its right, y up in its picture and z towards it, into the gel, are right-handed. So places are
# (x, -y, depth), in mm, with (0, 0) in the middle of the picture.

AXES = "x right, y up, z into the gel and towards the camera, mm"


def about(height: HeightMap) -> str:
    """Return one line for a file's head: its axes in mm, and the flags of the map (H, W)."""
    return f"height map; {AXES}" + (f"; doubtful: {' '.join(height.flags)}" if height.flags else "")


def points_mm(height: HeightMap) -> npt.NDArray[np.float32]:
    """Return the places x, y, z (H, W, 3) in mm; z is 0 where the depth is not known."""
    rows, columns = height.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * height.mm_per_px[0]
    y = ((rows - 1) / 2 - np.arange(rows)) * height.mm_per_px[1]
    across, up = np.meshgrid(x, y)
    return np.stack([across, up, np.where(height.valid, height.depth_mm, 0.0)], axis=-1).astype(np.float32)


def triangles(height: HeightMap) -> npt.NDArray[np.int32]:
    """Return the triangles (T, 3): dimensionless numbers of their pixels, counted row by row among the known.

    Two for each four known neighbours, anticlockwise as seen from the camera.
    """
    number = np.cumsum(height.valid.ravel()).reshape(height.valid.shape) - 1
    whole = height.valid[:-1, :-1] & height.valid[:-1, 1:] & height.valid[1:, :-1] & height.valid[1:, 1:]
    a, b, c, d = (n[whole] for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)


def write_npz(path: Path | str, height: HeightMap) -> None:
    """Write depth (H, W) in mm (NaN where unknown), its standard deviation, scale, time, name and flags as NPZ.

    numpy.load reads it without pickle.
    """
    content: dict[str, Any] = {
        "depth_mm": masked(height),
        "mm_per_px": np.array(height.mm_per_px),
        "time_s": np.array(height.time_s),
        "name": np.array(height.name),
        "positions": np.array(height.positions),
        "flags": np.array(height.flags, dtype=np.str_),
    }
    if height.std_mm is not None:
        content["std_mm"] = height.std_mm.astype(np.float32)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **content)


def write_ply(path: Path | str, height: HeightMap) -> None:
    """Write vertices (x, y, z, depth), in mm, and triangles as binary PLY; pixels of unknown depth are holes.

    Source: G. Turk, The PLY Polygon File Format (1994).
    """
    points = points_mm(height)[height.valid]
    faces = triangles(height)
    vertex = np.zeros(len(points), dtype=[("xyz", "<f4", 3), ("depth", "<f4")])
    vertex["xyz"], vertex["depth"] = points, points[:, 2]
    face = np.zeros(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    face["count"], face["corners"] = 3, faces
    header = "\n".join(
        (
            "ply",
            "format binary_little_endian 1.0",
            f"comment {about(height)}",
            f"element vertex {len(vertex)}",
            *(f"property float {name}" for name in ("x", "y", "z", "depth_mm")),
            f"element face {len(face)}",
            "property list uchar int vertex_indices",
            "end_header",
            "",
        )
    )
    with replacing(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + vertex.tobytes() + face.tobytes())


def write_vtk(path: Path | str, height: HeightMap) -> None:
    """Write the grid of all pixels (H, W), in mm, with depth (NaN where unknown) and std, as binary legacy VTK.

    Source: VTK File Formats, "Simple Legacy Formats", version 3.0; numbers are big-endian.
    """
    rows, columns = height.depth_mm.shape
    header = (
        f"# vtk DataFile Version 3.0\n{about(height)}\nBINARY\nDATASET STRUCTURED_GRID\n"
        f"DIMENSIONS {columns} {rows} 1\nPOINTS {rows * columns} float\n"
    )
    parts = [
        header.encode(),
        points_mm(height).astype(">f4").tobytes(),
        f"\nPOINT_DATA {rows * columns}\n".encode(),
    ]
    for name, values in (("depth_mm", masked(height)), ("std_mm", height.std_mm)):
        if values is not None:
            head = f"SCALARS {name} float 1\nLOOKUP_TABLE default\n".encode()
            parts += [head, np.asarray(values).astype(">f4").tobytes(), b"\n"]
    with replacing(path) as temporary:
        temporary.write_bytes(b"".join(parts))


EXPORTS: dict[str, Callable[[Path, HeightMap], None]] = {
    "tiff": write_tiff,
    "npz": write_npz,
    "zarr": write_zarr,
    "ply": write_ply,
    "vtk": write_vtk,
}


UNKNOWN = "no such format of height maps"


def export(height: HeightMap, folder: Path | str, *, form: str) -> Path:
    """Write a height map (H, W), in mm, as `form`, a name in EXPORTS, under its own name; returns the file.

    Raises InputError for a format that is not known.
    """
    check_known(form, EXPORTS, what=UNKNOWN, where="export")
    path = Path(folder) / f"{Path(height.name).stem or 'height'}.{form}"
    EXPORTS[form](path, height)
    return path
