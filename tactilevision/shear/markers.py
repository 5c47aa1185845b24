"""Markers: dark spots on the gel, detected in a frame, tracked into another, and interpolated.

Detection: Otsu's threshold of the darkness -log(I / local mean) of the darkest channel; a connected spot is a
marker, its place the mean weighted by darkness, which a factor of light does not change. Tracking: a marker is
predicted to move as its neighbours, starting from those that did not move; a pair counts if each is the other's
nearest and within `REACH` of the markers' spacing of the prediction. So a motion of many spacings is tracked if it
changes by less than `REACH` of a spacing from one marker to the next. Interpolation: a thin-plate spline, smoothed
by generalised cross-validation. Its leave-one-out errors are the standard deviation of the map, of localisation
and interpolation together.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import center_of_mass
from scipy.spatial import KDTree

from tactilevision.records.measured import Bools, Bytes, Floats

REACH = 0.4  # of the markers' spacing: beyond a half a neighbour is as near
MAX_ITERATIONS = 12  # rounds of matching
NEIGHBOURS = 6  # markers that predict the motion of one
ROUND_ABOUT = 2.0  # spacings over which errors are averaged


@dataclass(frozen=True, slots=True)
class MarkerMotion:
    """`place_px` (N, 2) of the markers in the first frame, `motion_px` (N, 2), and which were `found` again
    (N,).
    """

    place_px: Floats
    motion_px: Floats
    found: Bools


def find_markers(rgb: Bytes) -> Floats:
    """Find the places (N, 2) in pixels of the markers in a frame (H, W, 3); none if it has no similar spots."""
    dark = darkness(rgb)
    level, _ = cv2.threshold(_as_bytes(dark), 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    spots = (_as_bytes(dark) > level).astype(np.uint8)
    count, label, stats, _ = cv2.connectedComponentsWithStats(spots, connectivity=8)
    area = stats[1:, cv2.CC_STAT_AREA].astype(float)
    if count < 2:
        return np.zeros((0, 2))
    usual = float(np.median(area[area >= 4])) if (area >= 4).any() else 0.0
    kept = (area >= max(4, usual / 3)) & (area <= 3 * usual)
    places = np.array(center_of_mass(np.maximum(dark, 0), label, np.arange(1, count)))[:, ::-1]
    left, top = stats[1:, cv2.CC_STAT_LEFT], stats[1:, cv2.CC_STAT_TOP]
    right, low = left + stats[1:, cv2.CC_STAT_WIDTH], top + stats[1:, cv2.CC_STAT_HEIGHT]
    kept &= (left > 0) & (top > 0) & (right < dark.shape[1]) & (low < dark.shape[0])  # not cut by the border
    return np.asarray(places[kept])


def follow_markers(before_px: Floats, after_px: Floats) -> MarkerMotion:
    """Match markers of one frame (N, 2) to those of another (M, 2)."""
    motion = np.zeros_like(before_px)
    found = np.zeros(len(before_px), dtype=bool)
    if len(before_px) < NEIGHBOURS + 1 or len(after_px) == 0:
        return MarkerMotion(before_px, motion, found)
    tree, spacing = KDTree(before_px), _spacing(before_px)
    near = np.asarray(tree.query(before_px, NEIGHBOURS + 1)[1])[:, 1:]
    after = KDTree(after_px)
    for _ in range(MAX_ITERATIONS):
        expected = before_px + motion
        distance, partner = (np.asarray(part) for part in after.query(expected))
        back = np.asarray(KDTree(expected).query(after_px)[1])
        pairs = (distance < REACH * spacing) & (back[partner] == np.arange(len(before_px)))
        seen = np.where(pairs[:, None], after_px[partner] - before_px, 0.0)
        pairs &= _like_neighbours(seen, pairs, near, spacing)
        moved = np.where(pairs[:, None], seen, _from_neighbours(seen, pairs, near, motion))
        settled = np.array_equal(pairs, found) and np.allclose(moved, motion, atol=1e-3)
        motion, found = moved, pairs
        if settled:
            break
    return MarkerMotion(before_px, motion, found)


def spread_motion(motion: MarkerMotion, shape: tuple[int, int], *, step_px: int) -> tuple[Floats, Floats]:
    """Return the motion (H, W, 2) in pixels at every pixel, and its standard deviation (H, W) by cross-validation.

    The deviation at a place is that of the markers around it: near a contact's edge it is greater.
    """
    place, moved = motion.place_px[motion.found], motion.motion_px[motion.found]
    scale = float(max(shape))
    kernel = _thin_plate(place / scale, place / scale)
    ones = np.column_stack([np.ones(len(place)), place / scale])
    smoothing = _smoothing(place, moved, scale)
    system = np.block([[kernel + smoothing * np.eye(len(place)), ones], [ones.T, np.zeros((3, 3))]])
    inverse = np.linalg.inv(system)
    weights = inverse @ np.concatenate([moved, np.zeros((3, 2))])
    held_out = weights[: len(place)] / np.diag(inverse)[: len(place), None]  # leave-one-out errors
    rows, columns = (np.arange(0, n + step_px, step_px) for n in shape)
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2) / scale
    coarse = (
        _thin_plate(nodes, place / scale) @ weights[:-3]
        + np.column_stack([np.ones(len(nodes)), nodes]) @ weights[-3:]
    )
    field = coarse.reshape(len(rows), len(columns), 2).astype(np.float32)
    x, y = np.meshgrid(np.arange(shape[1], dtype=np.float32), np.arange(shape[0], dtype=np.float32))
    dense = cv2.remap(field, x / step_px, y / step_px, cv2.INTER_LINEAR)
    near = np.exp(-0.5 * _square(nodes, place / scale) * (scale / (ROUND_ABOUT * _spacing(place))) ** 2) + 1e-6
    variance = (near @ (held_out**2).mean(axis=1)) / near.sum(axis=1)
    std = np.sqrt(variance).reshape(len(rows), len(columns)).astype(np.float32)
    std = cv2.remap(std, x / step_px, y / step_px, cv2.INTER_LINEAR)
    return np.asarray(dense, dtype=np.float64), np.asarray(std, dtype=np.float64)


def hull(places_px: Floats, shape: tuple[int, int]) -> Bools:
    """Return the mask (H, W) of the pixels between the markers; beyond them nothing is known."""
    mask = np.zeros(shape, dtype=np.uint8)
    points = cv2.convexHull(np.round(places_px).astype(np.int32)).reshape(-1, 2)
    cv2.fillConvexPoly(mask, points, 1)
    return mask.astype(bool)


def darkness(rgb: Bytes) -> Floats:
    """Return -log of the lightest channel's ratio to its mean round about (H, W).

    A mark is dark in all colours, a shade is not.
    """
    light = np.log1p(rgb.max(axis=2).astype(np.float32))
    wide = max(3, rgb.shape[0] / 20)
    around = cv2.GaussianBlur(light, (0, 0), wide)
    return np.asarray(cv2.GaussianBlur(around - light, (0, 0), 0.8), dtype=np.float64)


def _as_bytes(dark: Floats) -> Bytes:
    top = max(float(np.percentile(dark, 99.8)), 1e-6)
    return np.asarray(np.clip(dark / top * 255, 0, 255), dtype=np.uint8)


def _spacing(places: Floats) -> float:
    return float(np.median(np.asarray(KDTree(places).query(places, 2)[0])[:, 1]))


def _like_neighbours(seen: Floats, pairs: Bools, near: np.ndarray, spacing: float) -> Bools:
    """Return whether each pair moved as its matched neighbours did, to `REACH` of a spacing.

    a lone pair is kept.
    """
    around = np.where(pairs[near][:, :, None], seen[near], np.nan)
    count = pairs[near].sum(axis=1)
    middle = np.zeros_like(seen)
    some = count > 0
    middle[some] = np.nanmedian(around[some], axis=1)
    return np.asarray((count < 2) | (np.hypot(*(seen - middle).T) < REACH * spacing))


def _from_neighbours(seen: Floats, pairs: Bools, near: np.ndarray, motion: Floats) -> Floats:
    """Predict each marker's motion from matched neighbours; without any, keep the earlier estimate."""
    weight = pairs[near].astype(float)
    total = weight.sum(axis=1, keepdims=True)
    mean = (weight[:, :, None] * seen[near]).sum(axis=1) / np.maximum(total, 1)
    return np.where(total > 0, mean, motion)


def _square(a: Floats, b: Floats) -> Floats:
    return np.asarray(((a[:, None, :] - b[None, :, :]) ** 2).sum(axis=-1))


def _thin_plate(a: Floats, b: Floats) -> Floats:
    square = _square(a, b)
    return np.asarray(0.5 * square * np.log(np.maximum(square, 1e-300)))


def _smoothing(place: Floats, moved: Floats, scale: float) -> float:
    """Choose the weight against bending by generalised cross-validation over powers of four."""
    kernel = _thin_plate(place / scale, place / scale)
    ones = np.column_stack([np.ones(len(place)), place / scale])
    q = np.linalg.qr(ones, mode="complete")[0][:, 3:]
    values, vectors = np.linalg.eigh(q.T @ kernel @ q)
    part = vectors.T @ (q.T @ moved)
    values = np.maximum(values, 0)
    weights = 4.0 ** np.arange(-18, -4)
    shares = weights[:, None] / (values + weights[:, None])
    scores = ((shares[:, :, None] * part) ** 2).sum(axis=(1, 2)) / shares.sum(axis=1) ** 2
    return float(weights[scores.argmin()])
