"""The gel beside a punch as a surface of its own, from slopes alone.

Slopes of several frames are averaged over half squares (SQUARE_MM/2) and integrated to squares, with the face and
its walls left out, so that the gel beside stands on its own slopes. Its level and tilt are then open. What lies
under the bevel, and beyond it, is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.contact.bevel import SIDES
from tactilevision.integration.half_squares import integrate_half_squares
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.records import Floats, Indenter, Pair, SlopeMap

SQUARE_MM = 0.25  # mm, side of the squares that slopes are averaged over; benchmarks.nu_from_frames
WALL_MM = 0.5  # mm beyond the edge: steep profile, ink and blur; benchmarks.nu_from_frames
BEFORE_BEVEL_MM = 0.5  # mm before the bevel's edge that are left out, lest the bevel's dent be read
SOUND = 0.9  # share of a square's pixels that must be readable; benchmarks.nu_from_frames
CENTRE_STD_MM = 0.05  # mm, one sigma of the face's centre; benchmarks.nu_from_frames


@dataclass(frozen=True, slots=True, eq=False)
class SquareSlopes:
    """Mean slopes (2h, 2w) over frames and half squares, share of readable pixels, and the frames' mean depth."""

    dz_dx: Floats
    dz_dy: Floats
    share: Floats
    depth_mm: float


def average_slopes(maps: Sequence[tuple[SlopeMap, float]], mm_per_px: Pair) -> SquareSlopes | None:
    """Means over slope maps (H, W), each with the punch's depth in mm; None without any. mm_per_px (x, y)."""
    if not maps:
        return None
    total = np.sum([_sums(slopes, mm_per_px) for slopes, _ in maps], axis=0)
    share = total[2].astype(np.float64)
    safe = np.maximum(share, 1e-6)
    depth = float(np.mean([depth_mm for _, depth_mm in maps]))
    return SquareSlopes(total[0] / safe, total[1] / safe, share / len(maps), depth)


def surface_view(
    slopes: SquareSlopes,
    indenter: Indenter,
    *,
    centre_mm: Pair,
    depth_std_mm: float,
    mm_per_px: Pair,
    shape: tuple[int, ...],
    name: str,
) -> SurfaceView:
    """The surface (h, w) beside a punch at `centre_mm` of the pad, from pictures of `shape` (H, W).

    `mm_per_px` (x, y) of those; `depth_std_mm` of the depth that the slopes state.
    """
    half = tuple(mm * n / m for mm, n, m in zip(mm_per_px, shape[::-1], slopes.share.shape[::-1], strict=True))
    x, y = _places(slopes.share.shape, half, centre_mm)
    share = np.where(np.hypot(x, y) > indenter.radius_mm + WALL_MM, slopes.share, 0.0)
    depth, beside = integrate_half_squares(
        slopes.dz_dx, slopes.dz_dy, share=share, least=SOUND, mm_per_px=(half[0], half[1])
    )
    scale = (2 * half[0], 2 * half[1])
    if indenter.bevel is not None:
        along, (x, y) = SIDES[indenter.bevel], _places(depth.shape, scale, centre_mm)
        start = indenter.bevel_distance_mm or indenter.radius_mm + 2 * BEFORE_BEVEL_MM
        beside &= along[0] * x + along[1] * y < start - BEFORE_BEVEL_MM
    return SurfaceView(
        depth, beside, scale, indenter.radius_mm, centre_mm, CENTRE_STD_MM, slopes.depth_mm, depth_std_mm, name
    )


def _sums(slopes: SlopeMap, mm_per_px: Pair) -> npt.NDArray[np.float32]:
    """dz/dx, dz/dy and share (3, 2h, 2w) of the readable pixels of half squares, as means over all pixels."""
    readable = np.isfinite(slopes.dz_dx) & np.isfinite(slopes.dz_dy)
    if slopes.valid is not None:
        readable &= slopes.valid
    parts = (np.where(readable, slopes.dz_dx, 0), np.where(readable, slopes.dz_dy, 0), readable)
    size = [2 * max(round(n * mm / SQUARE_MM), 2) for n, mm in zip(readable.shape[::-1], mm_per_px, strict=True)]
    return np.stack([cv2.resize(np.float32(part), size, interpolation=cv2.INTER_AREA) for part in parts])


def _places(shape: tuple[int, ...], mm: Sequence[float], centre_mm: Pair) -> tuple[Floats, Floats]:
    """x (1, w) and y (h, 1) in mm of squares (h, w) from the punch's axis; `mm` (x, y) of a square."""
    rows, columns = shape
    x = (np.arange(columns) - (columns - 1) / 2)[None, :] * mm[0] - centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2)[:, None] * mm[1] - centre_mm[1]
    return np.asarray(x, np.float64), np.asarray(y, np.float64)
