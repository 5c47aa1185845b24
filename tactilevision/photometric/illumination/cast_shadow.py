"""Which places a lamp reaches, forecast from a height map and the lamps' places.

A pressed face stands out towards camera and lamps, and its wall keeps the light of low lamps from the gel beside
it. Of a point Q of lamp l, from a place P of height z (towards the camera) only so much is hidden as stands higher
than the way to it:

    V_l(P) = share of the points Q with  max over s of (z(P + s u) - z(P))/s < Q_z/|Q - P|

u the direction to Q in the plane of the pad. Light that the gel sends to itself is left out. Heights that were
read in shadow are too high, which shortens the forecast a little. Under a path tracer's lamps (two sensors, faces
.3 to .6 mm deep, lamps and heights from the pictures alone) slopes where it says lit were right within 10 %, those
it says dark a half to many times too steep.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.illumination.lamps import Lamps
from tactilevision.records import Bools, Pair

CELL_MM = 0.125  # side of the cells that are forecast: a fifth of the shortest shadow that matters
STEP = 0.75  # cells from one height on the way to a lamp to the next
LIT = 0.97  # of a lamp's light: less is shadow
LEAST_TANGENT = 0.1  # of a lamp's elevation: lower lamps would shade all of the pad

Picture = npt.NDArray[np.float32]


def visibility(lamps: Lamps, depth_mm: npt.NDArray[np.floating], mm_per_px: Pair) -> Picture:
    """Share (3 lamps, H, W), from 0 to 1, of each lamp's points that reach the places of a depth map (H, W) mm."""
    height, width = depth_mm.shape
    rows, columns = (
        max(2, round(n * mm / CELL_MM)) for n, mm in zip(depth_mm.shape, mm_per_px[::-1], strict=True)
    )
    coarse = cv2.resize(np.asarray(depth_mm, np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    cell = (width * mm_per_px[0] / columns, height * mm_per_px[1] / rows)
    x = ((np.arange(columns) - (columns - 1) / 2) * cell[0])[None, :].astype(np.float32)
    y = ((np.arange(rows) - (rows - 1) / 2) * cell[1])[:, None].astype(np.float32)
    seen = [
        np.mean([_reached(point, coarse, (x, y), cell) for point in lamp.points_mm], axis=0)
        for lamp in lamps.lamps
    ]
    return np.stack([cv2.resize(one, (width, height), interpolation=cv2.INTER_LINEAR) for one in seen])


def lit(lamps: Lamps, depth_mm: npt.NDArray[np.floating], mm_per_px: Pair) -> Bools:
    """Mask (H, W) of the places of a depth map (H, W), mm, that all lamps reach."""
    return np.asarray(visibility(lamps, depth_mm, mm_per_px).min(axis=0) > LIT)


def _reached(
    point: npt.NDArray[np.float64], heights: Picture, places: tuple[Picture, Picture], cell: Pair
) -> Picture:
    """1 where a point of a lamp is seen from the cells (h, w), 0 where something stands in its way."""
    over_x, over_y = point[0] - places[0], point[1] - places[1]
    distance = np.hypot(over_x, over_y)
    towards_x, towards_y = over_x / distance, over_y / distance
    tangent = np.maximum(point[2] / distance, LEAST_TANGENT).astype(np.float32)
    column = np.arange(heights.shape[1], dtype=np.float32)[None, :]
    row = np.arange(heights.shape[0], dtype=np.float32)[:, None]
    step = STEP * min(cell)
    seen = np.ones(heights.shape, np.float32)
    farthest = (float(heights.max()) - float(heights.min())) / float(tangent.min())
    for k in range(1, int(farthest / step) + 2):
        at_x = (column + towards_x * (k * step / cell[0])).astype(np.float32)
        at_y = (row + towards_y * (k * step / cell[1])).astype(np.float32)
        there = cv2.remap(heights, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        seen[there - heights > tangent * np.float32(k * step)] = 0.0
    return seen
