"""The face's edge, direction by direction: where the depth falls most steeply on the way out.

Just outside a sharp punch the surface falls like a square root, so the true slope is -C x^(-1/2) beyond the edge
x = 0 and 0 before it. Seen through a blur of any width the steepest place then lies outside the edge, by an
amount that the slope's own shape tells: a wall as steep inwards as outwards (a cut-off wall) has its middle at the
edge, one with a long outer flank has it inside. The family x^(-1/2) exp(-x/L), blurred, covers both ends;
the ratio of the outer to the inner half width names the member and with it the offset.
Lengths in mm; directions are angles from x (right) towards y (down).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Floats, HeightMap, Pair

_DIRECTIONS = 180  # round the face, in which the steepest place is looked for


def place_px(height: HeightMap, places_mm: Floats) -> Floats:
    """Pixels (x, y) of places (..., 2) on the pad, mm from its centre."""
    rows, columns = height.depth_mm.shape
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    return np.asarray(np.asarray(places_mm) / np.asarray(height.mm_per_px) + middle, dtype=np.float64)


def sample(field: npt.NDArray[Any], places_px: Floats) -> Floats:
    """Bilinear values of `field` (H, W) or (H, W, C) at places (A, B, 2), px; NaN outside the picture."""
    grid = places_px.astype(np.float32)
    values = cv2.remap(
        np.asarray(field, dtype=np.float32),
        grid[..., 0],
        grid[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(float("nan"),) * 4,
    )
    return np.asarray(values, dtype=np.float64)


def edge_points(height: HeightMap, centre_mm: Pair, radius_mm: float) -> tuple[Floats, Floats, float]:
    """Edge points (N, 2) in mm round a rough centre and radius, their steepness (N,) in mm per mm, and by how
    much (mm) they were drawn inwards from the steepest place.

    Searched between half and one and a half radii. Directions whose ray leaves the view or meets invalid pixels at
    the wall are left out.
    """
    step = min(height.mm_per_px) / 2
    radii = np.arange(0.5 * radius_mm, 1.55 * radius_mm, step)
    slope = _outward_fall(height, centre_mm, radii)
    usable = np.isfinite(slope)
    peak = np.where(usable, slope, -np.inf).argmax(axis=1)
    inner = (peak > 0) & (peak < radii.size - 1)
    rows = np.arange(_DIRECTIONS)
    around = slope[rows[:, None], np.clip(peak[:, None] + [-1, 0, 1], 0, radii.size - 1)]
    inner &= np.isfinite(around).all(axis=1) & (around[:, 1] > 0)
    bend = around[:, 0] - 2 * around[:, 1] + around[:, 2]
    shift = np.where(bend < 0, 0.5 * (around[:, 0] - around[:, 2]) / np.where(bend < 0, bend, -1.0), 0.0)
    at = radii[peak] + np.clip(shift, -0.5, 0.5) * step
    offset = _offset(slope[inner], at[inner], radii)
    at -= offset
    angle = 2 * np.pi * rows / _DIRECTIONS
    points = np.asarray(centre_mm) + at[:, None] * np.c_[np.cos(angle), np.sin(angle)]
    return points[inner], around[inner, 1], offset


def _outward_fall(height: HeightMap, centre_mm: Pair, radii: Floats) -> Floats:
    """-d depth/dr (directions, radii), smoothed over neighbouring directions."""
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    rays = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None, :] * radii[None, :, None]
    depth = np.where(height.valid, height.depth_mm, np.nan)
    values = sample(depth, place_px(height, rays + np.asarray(centre_mm)))
    wrapped = np.vstack([values[-2:], values, values[:2]])
    mean = np.mean([wrapped[k : k + _DIRECTIONS] for k in range(5)], axis=0)
    return -np.gradient(mean, radii, axis=1)


def _offset(slope: Floats, at: Floats, radii: Floats) -> float:
    """How far outside the edge the steepest place lies, from the mean shape of the wall."""
    if not len(at):
        return 0.0
    step = float(radii[1] - radii[0])
    reach = np.arange(-0.3 * radii[-1], 0.3 * radii[-1], step)
    walls = _between(slope, (at[:, None] + reach - radii[0]) / step)
    whole = walls[np.isfinite(walls).all(axis=1)]  # not cut by the view's border
    if not len(whole):
        return 0.0
    wall = np.median(whole, axis=0)
    middle, half = reach.size // 2, 0.5 * float(wall.max())
    if half <= 0:
        return 0.0
    inward = _half_width(wall[middle::-1], half) * step
    outward = _half_width(wall[middle:], half) * step
    ratios, offsets = _wall_family()
    return inward * float(np.interp(outward / max(inward, step), ratios, offsets))


def _between(rows: Floats, places: Floats) -> Floats:
    """Values of each of `rows` (n, k) at fractional indices (n, m), straight between; 0 beyond its ends."""
    last = rows.shape[1] - 1
    left = np.clip(places.astype(np.intp), 0, last - 1)
    share = places - left
    low, high = (np.take_along_axis(rows, at, axis=1) for at in (left, left + 1))
    value = np.where(share == 0, low, np.where(share == 1, high, low + share * (high - low)))
    return np.where((places < 0) | (places > last), 0.0, value)


def _half_width(flank: Floats, half: float) -> float:
    """Steps until a falling flank passes `half`."""
    below = np.flatnonzero(flank < half)
    if not below.size or below[0] == 0:
        return 0.0 if below.size else float(flank.size)
    last = int(below[0]) - 1
    return float(last + (flank[last] - half) / (flank[last] - flank[last + 1]))


@lru_cache(maxsize=1)
def _wall_family() -> tuple[Floats, Floats]:
    """Ratio of outer to inner half width, and offset over the inner half width, over L of the family."""
    step = 0.02
    x = np.arange(-8, 40, step)
    blur = np.exp(-0.5 * np.arange(-6, 6 + step, step) ** 2)
    ratios, offsets = [1.0], [0.0]
    for length in np.geomspace(1.5, 200, 20):
        # the integral of x^(-1/2) over each step, so that the singularity keeps its weight
        root = np.diff(np.sqrt(np.maximum(np.append(x, x[-1] + step), 0))) * np.exp(-np.maximum(x, 0) / length)
        wall = np.convolve(root, blur, mode="same")
        top = int(wall.argmax())
        inward = _half_width(wall[top::-1], 0.5 * float(wall.max())) * step
        outward = _half_width(wall[top:], 0.5 * float(wall.max())) * step
        ratios.append(outward / inward)
        offsets.append((x[top] + step / 2) / inward)
    order = np.argsort(ratios)
    return np.array(ratios)[order], np.array(offsets)[order]
