"""VTK, the legacy format (binary): a structured grid with depth_mm and std_mm on its points, for ParaView.

Depth is NaN where it is not known.
Source: VTK File Formats, "Simple Legacy Formats", version 3.0; numbers are big-endian.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactilevision.exports.mesh import about, points_mm
from tactilevision.exports.tiff import masked
from tactilevision.files import replacing
from tactilevision.records import HeightMap


def write_vtk(path: Path | str, height: HeightMap) -> None:
    """Write the grid of all pixels (H, W), in mm, the first row first."""
    rows, columns = height.depth_mm.shape
    header = (
        f"# vtk DataFile Version 3.0\n{about(height)}\nBINARY\nDATASET STRUCTURED_GRID\n"
        f"DIMENSIONS {columns} {rows} 1\nPOINTS {rows * columns} float\n"
    )
    parts = [header.encode("ascii"), points_mm(height).astype(">f4").tobytes(), b"\n"]
    parts.append(f"POINT_DATA {rows * columns}\n".encode("ascii"))
    scalars = {"depth_mm": masked(height)} | ({} if height.std_mm is None else {"std_mm": height.std_mm})
    for name, values in scalars.items():
        parts += [f"SCALARS {name} float 1\nLOOKUP_TABLE default\n".encode("ascii")]
        parts += [np.asarray(values).astype(">f4").tobytes(), b"\n"]
    with replacing(path) as temporary:
        temporary.write_bytes(b"".join(parts))
