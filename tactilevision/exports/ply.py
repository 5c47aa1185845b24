"""PLY (binary, little-endian): the surface as triangles, for MeshLab, CloudCompare, Blender and Open3D.

Pixels of unknown depth are holes. Each vertex carries depth_mm again as a scalar to colour it by.
Source: G. Turk, The PLY Polygon File Format (1994).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactilevision.exports.mesh import about, points_mm, triangles
from tactilevision.files import replacing
from tactilevision.records import HeightMap


def write_ply(path: Path | str, height: HeightMap) -> None:
    """Write vertices (x, y, z, depth), in mm, and triangles."""
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
