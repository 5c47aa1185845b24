"""A sensor of one's own: straightened and scaled by four clicks, or by a grid of dots seen through its camera.

Four clicks on the corners of a rectangle of known size serve where straight lines are straight in the raw picture;
a grid (a plate of dots pressed into the gel, or printed marks) undoes a lens that bends them as well.
Each axis has its own scale; left out, it is the one at which the rectified picture has as many pixels as the raw
one has on its way across.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.files import replacing
from tactilevision.records import Bytes, Floats, Pair, Sensor
from tactilevision.sensors.rectification import Maps, maps_from_corners, maps_from_grid


def sensor_from_corners(
    corners_px: Sequence[Pair], size_mm: Pair, *, mm_per_px: Pair | None = None, has_markers: bool = False
) -> Sensor:
    """The sensor whose gel is the rectangle of `size_mm` with its corners there, (x, y) in the raw picture.

    They run top left, top right, bottom right, bottom left. Raises InputError where they span no face.
    """
    corner = np.asarray(corners_px, np.float64)
    if corner.shape != (4, 2) or not np.isfinite(corner).all() or min(size_mm) <= 0:
        raise InputError("four corners (x, y) and a size above 0", where="sensor_from_corners", value=corners_px)
    if not _runs_round(corner):
        raise InputError(
            "the corners do not run round: top left, top right, bottom right, bottom left",
            where="sensor_from_corners",
            value=corners_px,
        )
    across = 0.5 * (np.hypot(*(corner[1] - corner[0])) + np.hypot(*(corner[2] - corner[3])))
    down = 0.5 * (np.hypot(*(corner[3] - corner[0])) + np.hypot(*(corner[2] - corner[1])))
    scale = mm_per_px or (float(size_mm[0] / across), float(size_mm[1] / down))
    return _sensor(maps_from_corners(corners_px, size_mm, mm_per_px=scale), scale, has_markers)


def sensor_from_grid(
    points_px: Floats, spacing_mm: float, *, mm_per_px: Pair | None = None, has_markers: bool = False
) -> Sensor:
    """The sensor whose gel is the grid with crossings at `points_px` (rows, columns, 2) in the raw picture, px.

    Raises InputError as `maps_from_grid` does.
    """
    if points_px.ndim == 3 and min(points_px.shape[:2]) > 1:
        across = float(np.median(np.hypot(*np.moveaxis(np.diff(points_px, axis=1), 2, 0))))
        down = float(np.median(np.hypot(*np.moveaxis(np.diff(points_px, axis=0), 2, 0))))
    else:
        across = down = 1.0  # maps_from_grid says what is wrong
    scale = mm_per_px or (spacing_mm / across, spacing_mm / down)
    return _sensor(maps_from_grid(points_px, spacing_mm, mm_per_px=scale), scale, has_markers)


def find_grid(rgb: Bytes, rows: int, *, columns: int) -> Floats:
    """The dots of a grid (rows, columns, 2), px in a raw picture, from the top left, row by row.

    Dots may be dark on bright or bright on dark. Raises InputError where not all of them are found.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    even = cv2.subtract(cv2.GaussianBlur(grey, (0, 0), rgb.shape[0] / 12), grey, dtype=cv2.CV_32F)
    span = max(float(np.abs(even).max()), 1.0)
    for sign in (1, -1):
        picture = np.asarray(np.clip(127.5 - sign * 127.5 * even / span, 0, 255), np.uint8)
        found, points = cv2.findCirclesGrid(
            picture, (columns, rows), flags=cv2.CALIB_CB_SYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING
        )
        if found:
            return _upright(np.asarray(points, np.float64).reshape(rows, columns, 2))
    raise InputError(
        f"no grid of {rows} by {columns} dots is seen",
        where="find_grid",
        value=f"{rgb.shape[1]} by {rgb.shape[0]} px",
        remedy="Count the dots, light them evenly, or click the corners instead.",
    )


def save_rectification(sensor: Sensor, path: Path | str) -> Path:
    """Write the sensor's maps where recording.toml's `rectification` looks for them (.npz: map_x, map_y)."""
    if sensor.rectification is None:
        raise InputError("the sensor has no rectification", where=f"sensor {sensor.kind}")
    target = Path(path).with_suffix(".npz")
    with replacing(target) as temporary:
        np.savez_compressed(temporary, map_x=sensor.rectification[0], map_y=sensor.rectification[1])
    return target


def _sensor(maps: Maps, mm_per_px: Pair, has_markers: bool) -> Sensor:
    height, width = maps[0].shape
    return Sensor("custom", width, height, mm_per_px, rectification=maps, has_markers=has_markers)


def _runs_round(corner: Floats) -> bool:
    """Whether four corners turn the same way at each (clockwise as the picture is seen)."""
    side = np.roll(corner, -1, axis=0) - corner
    after = np.roll(side, -1, axis=0)
    return bool(np.all(side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0] > 0))


def _upright(points: Floats) -> Floats:
    """The grid turned so that its columns run to the right and its rows down."""
    if points[0, -1, 0] < points[0, 0, 0]:
        points = points[:, ::-1]
    if points[-1, 0, 1] < points[0, 0, 1]:
        points = points[::-1]
    return np.ascontiguousarray(points)
