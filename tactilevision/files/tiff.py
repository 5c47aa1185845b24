"""Read and write height maps as float32 TIFF files that carry their scale."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.documents import parse_json
from tactilevision.files.opening import check, check_numbers, damage, number, open_regular
from tactilevision.files.writing import replacing
from tactilevision.records.maps import HeightMap, add
from tactilevision.records.measured import Pair


def write_tiff(path: Path | str, height: HeightMap, *, quantity: str = "depth into the gel") -> None:
    """Write depth (H, W) in mm as float32, NaN where invalid, never clipped.

    Scale, flags and `quantity`, the name of what the map holds, go into the file's tags.
    """
    import tifffile

    about = {"quantity": quantity, "unit": "mm"} | metadata(height)
    with replacing(path) as temporary:
        tifffile.imwrite(
            temporary,
            masked(height),
            description=json.dumps(about),
            metadata=None,  # else it adds a second description, which other readers refuse
            resolution=(10 / height.mm_per_px[0], 10 / height.mm_per_px[1]),
            resolutionunit="CENTIMETER",
        )


def read_tiff(path: Path | str, *, mm_per_px: Pair | None = None) -> HeightMap:
    """Read a TIFF of depths (H, W), in mm; `mm_per_px` overrides the scale in the file.

    Raises InputError for a file that is not such a TIFF, or without a scale.
    """
    import tifffile

    path = Path(path)
    with damage(path, what="cannot be read as a depth TIFF", remedy=""):
        open_regular(path).close()
        with tifffile.TiffFile(path) as file:
            pixels = math.prod(file.series[0].shape) if file.series else 0
            check(pixels, "MAX_PIXELS", what="its pixels", where=path)
            depth, about = file.asarray(), file.pages[0].description or ""  # type: ignore[union-attr]
    if depth.ndim != 2 or not np.issubdtype(depth.dtype, np.floating):
        raise InputError(
            "a depth TIFF holds one plane of floating-point numbers",
            where=path,
            value=f"{depth.shape} {depth.dtype}",
        )
    content: dict[str, Any] = {}
    with suppress(InputError):  # another program's description
        content = parse_json(about, where=path)
    check_numbers(depth[np.isfinite(depth)], what="a depth in mm", where=path)
    scale = mm_per_px or _scale(content, path)
    if scale is None:
        raise InputError("does not state its scale", where=path, remedy="Give it with --mm-per-px.")
    flags = content.get("flags")
    return HeightMap(
        depth,
        np.isfinite(depth),
        scale,
        name=path.stem,
        flags=add((), map(str, flags)) if isinstance(flags, list) else (),
        positions=content.get("positions", "deformed"),
    )


def _scale(about: dict[str, Any], path: Path) -> Pair | None:
    try:
        x, y = (number(side, what="mm_per_px", where=path) for side in about["mm_per_px"])
    except (ValueError, TypeError, KeyError):
        return None
    return None if x is None or y is None else (x, y)


def metadata(height: HeightMap) -> dict[str, Any]:
    """Return what a file states of a map (H, W): its scale in mm per pixel, positions and flags."""
    return {"mm_per_px": list(height.mm_per_px), "positions": height.positions, "flags": list(height.flags)}


def masked(height: HeightMap) -> npt.NDArray[np.float32]:
    """Return the depth (H, W) in mm as float32, NaN where it is not known."""
    depth = height.depth_mm.astype(np.float32)
    if not height.valid.all():
        depth[~height.valid] = np.nan
    return depth
