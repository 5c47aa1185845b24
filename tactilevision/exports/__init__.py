"""One height map for other programs: EXPORTS, one format a file. A writer takes (path, height)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tactilevision.errors import InputError
from tactilevision.exports.npz import write_npz
from tactilevision.exports.ply import write_ply
from tactilevision.exports.tiff import write_tiff
from tactilevision.exports.vtk import write_vtk
from tactilevision.exports.zarr_store import write_zarr
from tactilevision.records import HeightMap

Writer = Callable[[Path, HeightMap], None]

EXPORTS: dict[str, Writer] = {
    "tiff": write_tiff,
    "npz": write_npz,
    "zarr": write_zarr,
    "ply": write_ply,
    "vtk": write_vtk,
}


def export(height: HeightMap, folder: Path | str, *, form: str) -> Path:
    """Write a height map (H, W), in mm, as `form`, a name in EXPORTS, under its own name; returns the file.

    Raises InputError for a format that is not known.
    """
    writer = EXPORTS.get(form)
    if writer is None:
        raise InputError(
            "no such format of height maps",
            where="export",
            value=form,
            remedy="Known are " + ", ".join(EXPORTS) + ".",
        )
    path = Path(folder) / f"{Path(height.name).stem or 'height'}.{form}"
    writer(path, height)
    return path
