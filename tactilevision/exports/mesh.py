"""A height map as a surface in space, for programs that turn it about.

Such programs take x, y, z for a right-handed set. The camera looks at the gel from inside; x to its right, y up in
its picture and z towards it, which is into the gel, are one: so (x, -y, depth), in mm, (0, 0) the middle of the
picture.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.records import HeightMap

AXES = "x right, y up, z into the gel and towards the camera, mm"


def about(height: HeightMap) -> str:
    """One line for a file's head: its axes in mm, and what makes the map (H, W) doubtful."""
    return f"height map; {AXES}" + (f"; doubtful: {' '.join(height.flags)}" if height.flags else "")


def points_mm(height: HeightMap) -> npt.NDArray[np.float32]:
    """Places x, y, z (H, W, 3) in mm; z is 0 where the depth is not known."""
    rows, columns = height.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * height.mm_per_px[0]
    y = ((rows - 1) / 2 - np.arange(rows)) * height.mm_per_px[1]
    across, up = np.meshgrid(x, y)
    return np.stack([across, up, np.where(height.valid, height.depth_mm, 0.0)], axis=-1).astype(np.float32)


def triangles(height: HeightMap) -> npt.NDArray[np.int32]:
    """Triangles (T, 3): dimensionless numbers of their pixels, counted row by row among the known.

    Two where four neighbours are known.

    They run anticlockwise as seen from the camera.
    """
    number = np.cumsum(height.valid.ravel()).reshape(height.valid.shape) - 1
    whole = height.valid[:-1, :-1] & height.valid[:-1, 1:] & height.valid[1:, :-1] & height.valid[1:, 1:]
    a, b, c, d = (n[whole] for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)
