"""NPZ, for numpy: depth_mm (H, W) float32 with NaN where it is not known, std_mm where it is, mm_per_px (x, y).

`flags` are the words of flags.py that make the map doubtful, if any."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.exports.tiff import masked
from tactilevision.files import replacing
from tactilevision.records import HeightMap


def write_npz(path: Path | str, height: HeightMap) -> None:
    """Write depth (H, W) in mm, its standard deviation, scale, time and name.

    Read back with numpy.load, no pickle in it.
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
