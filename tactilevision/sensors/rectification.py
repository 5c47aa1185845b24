"""Rectify raw pictures, and describe a custom sensor by four corners or a grid of dots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.writing import replacing
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bytes, Floats, Pair, Picture
from tactilevision.records.rig import Sensor

# rectified[y, x] = raw[map_y[y, x], map_x[y, x]]       bilinear; maps float32 (height, width)

Map = Picture
Maps = tuple[Map, Map]
KEPT = 8  # cached maps in fixed point, the oldest dropped first

_fixed: dict[int, tuple[Map, npt.NDArray[np.int16], npt.NDArray[np.uint16], tuple[int, int]]] = {}


def rectify(sensor: Sensor, rgb: Bytes) -> Bytes:
    """Rectify a raw picture to (height_px, width_px, 3); return the same array if the sensor has no maps.

    Raises InputError for a picture of another size than the sensor, or smaller than its maps require.
    """
    if sensor.rectification is None:
        if rgb.shape[:2] != (sensor.height_px, sensor.width_px):
            raise InputError(
                f"the frame is {rgb.shape[1]} by {rgb.shape[0]} px, not as its sensor",
                where="frame",
                value=f"{sensor.kind}: {sensor.width_px} by {sensor.height_px}",
                remedy="Set width_px, height_px and mm_per_px of the sensor, or its rectification.",
            )
        return rgb
    whole, parts, (right, bottom) = _fixed_point(sensor.rectification)
    if right > rgb.shape[1] or bottom > rgb.shape[0]:
        raise InputError(
            f"the rectification reaches outside the frame, to x = {right}, y = {bottom} px",
            where="[sensor] rectification",
            value=f"{rgb.shape[1]} by {rgb.shape[0]} px",
            remedy="Use the maps made for this stream; are map_x and map_y exchanged?",
        )
    return np.asarray(cv2.remap(rgb, whole, parts, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _fixed_point(maps: Maps) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint16], tuple[int, int]]:
    """Return the maps in OpenCV's fixed-point form, three times as fast, and the last column and row they reach
    for, px.

    Kept for the last few sensors.
    """
    held = _fixed.get(id(maps[0]))
    if held is None or held[0] is not maps[0]:
        while len(_fixed) >= KEPT:
            _fixed.pop(next(iter(_fixed), 0), None)
        whole, parts = cv2.convertMaps(maps[0], maps[1], cv2.CV_16SC2)
        last = int(whole[..., 0].max()), int(whole[..., 1].max())
        held = _fixed[id(maps[0])] = (maps[0], whole, parts, last)
    return held[1:]


# A custom sensor, rectified and scaled by four clicks on the corners of a rectangle of known size, or, for a lens
# with distortion, by a grid (a plate of dots pressed into the gel, or printed marks). Each axis has its own scale;
# by default the rectified picture has as many pixels as the raw one across the gel.


def sensor_from_corners(corners_px: Sequence[Pair], size_mm: Pair, *, mm_per_px: Pair | None = None) -> Sensor:
    """Return the sensor whose gel is the rectangle of `size_mm` with its corners there, (x, y) in the raw picture.

    They run top left, top right, bottom right, bottom left. Straight lines must be straight in the raw picture:
    for a lens with distortion use a grid. Raises InputError if they span no area.
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
    width, height = (max(2, round(size / step)) for size, step in zip(size_mm, scale, strict=True))
    target = [[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]]
    warp = cv2.getPerspectiveTransform(np.array(target, np.float32), corner.astype(np.float32))
    y, x = np.mgrid[:height, :width].astype(np.float64)
    places = np.stack([x, y, np.ones_like(x)], axis=-1) @ warp.T
    maps = places[..., :2] / places[..., 2:]
    return _sensor(maps[..., 0], maps[..., 1], scale)


def sensor_from_grid(points_px: Floats, spacing_mm: float, *, mm_per_px: Pair | None = None) -> Sensor:
    """Return the sensor whose gel is the grid with crossings `points_px` (rows, columns, 2) in the raw picture.

    Between crossings the maps are splines (cubic for four crossings or more), which correct a lens's distortion.
    The rectified frame spans the grid from its first to its last crossing. Raises InputError for fewer than 2 by
    2 crossings.
    """
    from scipy.interpolate import RectBivariateSpline

    rows, columns = points_px.shape[:2]
    if points_px.shape[2:] != (2,) or min(rows, columns) < 2 or not np.isfinite(points_px).all():
        raise InputError(
            "a grid of crossings (rows, columns, 2), at least 2 by 2",
            where="sensor_from_grid",
            value=points_px.shape,
        )
    across, down = (
        float(np.median(np.hypot(*np.moveaxis(np.diff(points_px, axis=axis), 2, 0)))) for axis in (1, 0)
    )
    scale = mm_per_px or (spacing_mm / across, spacing_mm / down)
    down_mm, across_mm = (np.arange(count) * spacing_mm for count in (rows, columns))
    y, x = (
        np.arange(0.0, along[-1] + ROUNDING, step)
        for along, step in zip((down_mm, across_mm), scale[::-1], strict=True)
    )
    map_x, map_y = (
        RectBivariateSpline(down_mm, across_mm, plane, kx=min(3, rows - 1), ky=min(3, columns - 1), s=0)(y, x)
        for plane in np.moveaxis(points_px, 2, 0)
    )
    return _sensor(map_x, map_y, scale)


def find_grid(rgb: Bytes, rows: int, *, columns: int) -> Floats:
    """Find the dots of a grid (rows, columns, 2), px in a raw picture, from the top left, row by row.

    Dots may be dark on bright or bright on dark. Raises InputError if some are not found.
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


def _sensor(map_x: Floats, map_y: Floats, mm_per_px: Pair) -> Sensor:
    (height, width), maps = map_x.shape, (map_x.astype(np.float32), map_y.astype(np.float32))
    return Sensor("custom", width, height, mm_per_px, rectification=maps)


def _runs_round(corner: Floats) -> bool:
    """Return whether four corners turn the same way at each (clockwise as the picture is seen)."""
    side = np.roll(corner, -1, axis=0) - corner
    after = np.roll(side, -1, axis=0)
    return bool(np.all(side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0] > 0))


def _upright(points: Floats) -> Floats:
    """Turn the grid so that its columns run to the right and its rows down."""
    if points[0, -1, 0] < points[0, 0, 0]:
        points = points[:, ::-1]
    if points[-1, 0, 1] < points[0, 0, 1]:
        points = points[::-1]
    return np.ascontiguousarray(points)
