"""Find the indenter's circle in a height map: its edge, centre, radius, depth and tilt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records.constants import ROUNDING, TINY
from tactilevision.records.maps import Footprint, HeightMap
from tactilevision.records.measured import Bools, Floats, Pair, Picture
from tactilevision.records.rig import Indenter
from tactilevision.robust import mad_std, median, tukey_weight

# Edge of the face in each direction: the place of the steepest fall of depth outwards.
#
# Just outside a sharp punch the surface falls like a square root, so the true slope is -C x^(-1/2) beyond the edge
# x = 0 and 0 before it. After a blur the steepest place is outside the edge, by an amount that follows from the
# slope's shape: a wall as steep inwards as outwards (a cut-off wall) has its middle at the edge, one with a long
# outer flank has the edge inside. The family x^(-1/2) exp(-x/L), blurred, covers both ends; the ratio of the outer
# to the inner half width determines L and the offset. Lengths in mm; directions are angles from x (right) towards
# y (down).

_DIRECTIONS = 180  # round the face
_ANGLES = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
_TOWARDS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)]).T  # each contiguous, as numpy keeps it in rays


def place_px(height: HeightMap, places_mm: Floats) -> Floats:
    """Return the pixels (x, y) of places (..., 2) on the pad, mm from its centre."""
    rows, columns = height.depth_mm.shape
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    return np.asarray(np.asarray(places_mm) / np.asarray(height.mm_per_px) + middle, dtype=np.float64)


def _offsets(height: HeightMap, centre_mm: Pair) -> tuple[Floats, Floats]:
    """Return the places x (1, W) and y (H, 1) of the pixels from a centre on the pad, mm."""
    (x_px, y_px), (rows, columns) = place_px(height, np.asarray(centre_mm)), height.depth_mm.shape
    x, y = np.arange(columns) - x_px, np.arange(rows) - y_px
    return x[None, :] * height.mm_per_px[0], y[:, None] * height.mm_per_px[1]


def sample(field: npt.NDArray[Any], places_px: Floats) -> Floats:
    """Interpolate `field` (H, W) or (H, W, C) bilinearly at places (A, B, 2), px; NaN outside the picture."""
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
    """Find edge points (N, 2) in mm round a rough centre and radius, their steepness (N,) in mm per mm, and how
    far (mm) they were moved inwards from the steepest place.

    Searched between half and one and a half radii. Directions whose ray leaves the view or meets invalid pixels at
    the wall are excluded.
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
    points = np.asarray(centre_mm) + at[:, None] * _TOWARDS
    return points[inner], around[inner, 1], offset


def _outward_fall(height: HeightMap, centre_mm: Pair, radii: Floats) -> Floats:
    """Return -d depth/dr (directions, radii) of a map, smoothed over neighbouring directions."""
    rays = _TOWARDS[:, None, :] * radii[None, :, None]
    values = sample(height.depth_mm, place_px(height, rays + np.asarray(centre_mm)))
    wrapped = np.vstack([values[-2:], values, values[:2]])
    mean = sum(wrapped[k : k + _DIRECTIONS] for k in range(5)) / 5
    return -np.gradient(mean, radii, axis=1)


def _offset(slope: Floats, at: Floats, radii: Floats) -> float:
    """Return the distance of the steepest place outside the edge, from the mean shape of the wall."""
    if not len(at):
        return 0.0
    step = float(radii[1] - radii[0])
    reach = np.arange(-0.3 * radii[-1], 0.3 * radii[-1], step)
    walls = _between(slope, (at[:, None] + reach - radii[0]) / step)
    whole = walls[np.isfinite(walls).all(axis=1)]  # not cut by the view's border
    if not len(whole):
        return 0.0
    wall = median(whole.T)
    middle, half = reach.size // 2, 0.5 * float(wall.max())
    if half <= 0:
        return 0.0
    inward = _half_width(wall[middle::-1], half) * step
    outward = _half_width(wall[middle:], half) * step
    ratios, offsets = _wall_family()
    return inward * float(np.interp(outward / max(inward, step), ratios, offsets))


def _between(rows: Floats, places: Floats) -> Floats:
    """Return the values of each of `rows` (n, k) at fractional indices (n, m), straight between.

    0 beyond its ends.
    """
    last = rows.shape[1] - 1
    left = np.clip(places.astype(np.intp), 0, last - 1)
    share = places - left
    low, high = (np.take_along_axis(rows, at, axis=1) for at in (left, left + 1))
    value = np.where(share == 0, low, np.where(share == 1, high, low + share * (high - low)))
    return np.where((places < 0) | (places > last), 0.0, value)


def _half_width(flank: Floats, half: float) -> float:
    """Return the steps until a falling flank passes `half`."""
    below = np.flatnonzero(flank < half)
    if not below.size or below[0] == 0:
        return 0.0 if below.size else float(flank.size)
    last = int(below[0]) - 1
    return float(last + (flank[last] - half) / (flank[last] - flank[last + 1]))


@lru_cache(maxsize=1)
def _wall_family() -> tuple[Floats, Floats]:
    """Return the ratio of outer to inner half width, and offset over the inner half width, over L of the
    family.
    """
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


# The circle through places some of which are not its own, with its deviation:
#
#     minimise  sum_i w_i rho( |p_i - c| - R )        rho: Tukey's biweight, its scale from the residuals
#
# RANSAC (Fischler & Bolles, Comm. ACM 24 (1981) 381) finds the circle that most points agree on, whatever the
# others do; the weighted geometric (orthogonal distance) fit then refines it. Units: mm.

TRIALS = 200  # circles through three points: with half of all points wild none is good once in 4e11, 1/(7/8)^200


@dataclass(frozen=True, slots=True)
class Circle:
    """Centre (x, y) and radius, standard deviation of either, rms distance of the kept points, share kept."""

    centre_mm: Pair
    radius_mm: float
    centre_std_mm: float
    radius_std_mm: float
    residual_mm: float
    kept: float


def fit_circle(
    points_mm: Floats, *, start: tuple[Pair, float], scale_mm: float, independent: float
) -> Circle | None:
    """Return the robust circle through points (N, 2) from a start (centre, radius).

    `scale_mm` is what a point may be off at best (a fraction of a pixel); `independent` the number of points
    that err independently, since neighbours on an edge err together. None where fewer than half of
    the points agree on a circle.
    """
    if len(points_mm) < 8:
        return None
    begin = _consensus(points_mm, start, scale_mm)
    centre, radius, weights = _refine(points_mm, begin, scale_mm)
    inside = weights > 0
    if inside.mean() < 0.5:
        return None
    jacobian, residual = _linearised(points_mm, centre, radius)
    rms = float(np.sqrt(np.average(residual**2, weights=weights)))
    information = (jacobian * weights[:, None]).T @ jacobian * min(independent / len(points_mm), 1.0)
    variance = _inverse_diagonal(information) * max(rms, 0.1 * scale_mm) ** 2
    return Circle(
        (float(centre[0]), float(centre[1])),
        radius,
        float(np.sqrt(variance[:2].max())),
        float(np.sqrt(variance[2])),
        rms,
        float(inside.mean()),
    )


def _consensus(points: Floats, start: tuple[Pair, float], scale_mm: float) -> tuple[Floats, float]:
    """Return the circle through three points that most others lie on; or the start, if none is better.

    Three points p, p + b, p + c lie on the circle round p + u, 2 [b; c] u = [b b; c c].
    """
    tolerance, start_radius = 3 * scale_mm, start[1]
    rng = np.random.default_rng(len(points))  # a draw that repeats: the same points give the same circle
    first, b, c = points[rng.integers(0, len(points), (3, TRIALS))]
    b, c = b - first, c - first
    twice = 2.0 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    well_spread = np.abs(twice) > ROUNDING * start_radius**2
    first, b, c, twice = first[well_spread], b[well_spread], c[well_spread], twice[well_spread, None]
    square_b, square_c = (np.sum(side**2, axis=1) for side in (b, c))
    to_centre = (
        np.stack([c[:, 1] * square_b - b[:, 1] * square_c, b[:, 0] * square_c - c[:, 0] * square_b], axis=1)
        / twice
    )
    radii = np.hypot(*to_centre.T)
    likely = (0.3 * start_radius < radii) & (radii < 3 * start_radius)
    centres = np.concatenate([np.asarray(start[0], np.float64)[None], (first + to_centre)[likely]])
    radii = np.concatenate([[start_radius], radii[likely]])
    least, most = (np.maximum(radii + side, 0.0) ** 2 for side in (-tolerance, tolerance))  # of squared distances
    of_points = np.stack([np.sum(points**2, axis=1), *points.T, np.ones(len(points))])
    beyond = np.sum(centres**2, axis=1) - (least + most) / 2
    of_centres = np.column_stack([np.ones(len(radii)), -2 * centres, beyond])
    near = np.abs(of_centres @ of_points) < (most - least)[:, None] / 2
    best = int(np.argmax(np.count_nonzero(near, axis=1)))
    return centres[best], float(radii[best])


def _refine(points: Floats, start: tuple[Floats, float], scale_mm: float) -> tuple[Floats, float, Floats]:
    centre, radius = np.array(start[0], dtype=np.float64), start[1]
    weights = np.ones(len(points))
    for _ in range(20):
        jacobian, residual = _linearised(points, centre, radius)
        weights = tukey_weight(residual, max(mad_std(residual, centre=0.0), 0.5 * scale_mm))
        step, *_ = np.linalg.lstsq(jacobian * weights[:, None] ** 0.5, -residual * weights**0.5, rcond=None)
        centre, radius = centre + step[:2], radius + float(step[2])
        if np.abs(step).max() < 1e-6 * radius:
            break
    return centre, radius, weights


def _linearised(points: Floats, centre: Floats, radius: float) -> tuple[Floats, Floats]:
    offset = points - centre
    distance = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), TINY)
    jacobian = np.full((len(points), 3), -1.0)
    jacobian[:, :2] = -offset / distance[:, None]
    return jacobian, distance - radius


def _inverse_diagonal(information: Floats) -> Floats:
    """Return it for a matrix (k, k) >= 0; a short arc gives very large values, never below 0."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(vectors**2 @ (1 / np.maximum(values, np.finfo(float).eps * values[-1])))


# Footprint of the indenter: a disc-minus-ring filter finds the face, the steepest ring round it gives edge points,
# to which a circle is fitted robustly, and a plane through the face gives depth and tilt:
#
#     depth(x, y) = depth_c + tilt_x (x - x_c) + tilt_y (y - y_c)
#
# Lengths in mm, places on the pad, depth from the height map's zero. Assumes a flat round face; the contact of a
# ball or a cone gives a circle too, with tilt and depth of the plane nearest to its tip.

_GRID_MM = 0.2  # mm: grid of the rough search
_RING = (1.2, 1.5)  # of the radius: beyond the steep edge, near enough that a tilted zero plane cancels
_MIN_RINGS = 3  # of which one may be uneven
_INNER = 0.8  # of the radius: the face without its wall
_CORRECTION_STD = 0.25  # relative uncertainty of the edge's correction: blurs are not Gaussian
_DETECTION_SIGMA = 6  # times the scatter of the filter over the view: about one false alarm in 1e6 views


def find_footprint(height: HeightMap, indenter: Indenter, *, prior: Footprint | None = None) -> Footprint | None:
    """Find the face of `indenter`, in mm, in a map (H, W); None if nothing exceeds the noise.

    `prior`, a footprint of the same press, replaces the search. Needs a depth of some ten times the noise.
    """
    if prior is not None:
        start: tuple[Pair, float] | None = (prior.centre_mm, prior.radius_mm)
    else:
        # the contact radius of a ball or a cone depends on its depth
        start = _search(height, indenter.radius_mm if indenter.shape == "flat_cylinder" else float("nan"))
    if start is None:
        return None
    circle, moved = None, 0.0
    height = replace(height, depth_mm=np.where(height.valid, height.depth_mm, np.float32(np.nan)))
    for _ in range(2):  # the second time round the centre of the first
        points, steepness, moved = edge_points(height, *start)
        steep = steepness > 0.25 * np.median(steepness) if len(steepness) else np.zeros(0, dtype=bool)
        arc = 2 * np.pi * start[1] * steep.sum() / _DIRECTIONS
        circle = fit_circle(
            points[steep], start=start, scale_mm=0.5 * max(height.mm_per_px), independent=max(2 * arc, 4)
        )
        if circle is None or not 0.3 * start[1] < circle.radius_mm < 2.5 * start[1]:
            return None
        start = (circle.centre_mm, circle.radius_mm)
    return None if circle is None else _describe(height, circle, _CORRECTION_STD * moved)


def ring_outside(height: HeightMap, face: Footprint, *, away_from: Pair) -> Floats:
    """Return the depth (180,) in mm just outside the face, from azimuth 0 towards y, less its mean and first
    harmonic.

    `away_from` (x, y) points to the bevel, whose quarter is NaN. All is NaN if less than a third is in view.
    """
    radii = np.linspace(*_RING, 7) * face.radius_mm
    places = _TOWARDS[:, None, :] * radii[None, :, None] + np.asarray(face.centre_mm)
    depth = np.where(height.valid, height.depth_mm, np.nan)
    outside = sample(depth, place_px(height, places)).mean(axis=1)
    use = np.isfinite(outside) & (_TOWARDS @ np.asarray(away_from) < np.cos(np.pi / 4))
    ring = np.full(_DIRECTIONS, np.nan)
    if use.sum() >= _DIRECTIONS / 3:
        basis = np.c_[np.ones(_DIRECTIONS), _TOWARDS][use]
        answer, *_ = np.linalg.lstsq(basis, outside[use], rcond=None)
        ring[use] = outside[use] - basis @ answer
    return ring


def shared_ring(rings: Sequence[Floats]) -> Floats:
    """Return what rings (180,) in mm have most in common, of any size and sign: their first singular vector.

    Shadows of fixed lamps fall to the same sides of every punch. Zero where unknown, and if fewer than three rings
    are known.
    """
    known = [np.nan_to_num(ring) for ring in rings if np.isfinite(ring).any()]
    if len(known) < _MIN_RINGS:
        return np.zeros(_DIRECTIONS)
    return np.asarray(np.linalg.svd(np.array(known), full_matrices=False)[2][0])


def unevenness_mm(ring: Floats, light: Floats) -> float:
    """Return the rms in mm of the depth just outside a face, a ring (180,), less the share of `light`.

    Outside a disc the gel falls evenly all round; a slot, a burr or a crumb shows there even if the wall is as
    steep as a disc's. `light` (180,) is the ring shared by other punches. NaN for an unknown ring.
    """
    known = np.isfinite(ring)
    if not known.any():
        return float("nan")
    own, shared = ring[known], light[known]
    if shared.any():
        own = own - shared * (shared @ own) / (shared @ shared)
    return float(np.sqrt(np.mean(own**2)))


def relief_mm(height: HeightMap, face: Footprint) -> float:
    """Return the rms in mm of the face in a map (H, W) about a plane and a dish.

    A broken edge contributes, a tilt does not, nor does a rotationally symmetric dish, which a height map may show
    on any deep face. Read within _INNER of the radius, inside the wall. NaN if too little of the face is in view.
    """
    x, y = _offsets(height, face.centre_mm)
    inside = height.valid & (np.hypot(x, y) < _INNER * face.radius_mm)
    if inside.sum() < 20:
        return float("nan")
    x, y = (np.broadcast_to(along, inside.shape)[inside] for along in (x, y))
    basis, depth = np.c_[np.ones_like(x), x, y, x**2 + y**2], height.depth_mm[inside].astype(np.float64)
    answer, *_ = np.linalg.lstsq(basis, depth, rcond=None)
    return float(np.sqrt(np.mean((depth - basis @ answer) ** 2)))


def _search(height: HeightMap, radius_mm: float) -> tuple[Pair, float] | None:
    """Find a rough centre and radius: the strongest response of a disc-minus-ring filter."""
    candidates = [radius_mm] if np.isfinite(radius_mm) else list(np.geomspace(0.8, 6, 7))
    found = [(answer, radius) for radius in candidates if (answer := _best_disc(height, radius)) is not None]
    if not found:
        return None
    (centre, _), radius = max(found, key=lambda item: item[0][1] * np.sqrt(item[1]))
    return centre, radius


def _best_disc(height: HeightMap, radius_mm: float) -> tuple[Pair, float] | None:
    rows, columns = height.depth_mm.shape
    size = (
        max(int(columns * height.mm_per_px[0] / _GRID_MM), 8),
        max(int(rows * height.mm_per_px[1] / _GRID_MM), 8),
    )
    filled = np.where(height.valid, height.depth_mm, 0)
    depth = cv2.resize(filled.astype(np.float32, copy=False), size, interpolation=cv2.INTER_AREA)
    (disc, of_disc), (ring, of_ring) = _disc_and_ring(
        np.packbits(height.valid).tobytes(), (rows, columns), size, radius_mm / _GRID_MM
    )
    within, around = (
        cv2.filter2D(depth, cv2.CV_32F, weights, borderType=cv2.BORDER_CONSTANT) / np.maximum(share, 0.05)
        for weights, share in ((disc, of_disc), (ring, of_ring))
    )
    score, covered = within - around, np.minimum(of_disc, of_ring) > 0.4
    if not covered.any():
        return None
    known = score[covered]
    typical = np.median(known)
    scatter = mad_std(known, centre=typical)
    best = np.unravel_index(int(np.where(covered, score, -np.inf).argmax()), score.shape)
    if score[best] - typical < _DETECTION_SIGMA * scatter or score[best] <= 0:
        return None
    x = (best[1] + 0.5) * columns / size[0] - 0.5 - (columns - 1) / 2
    y = (best[0] + 0.5) * rows / size[1] - 0.5 - (rows - 1) / 2
    return (float(x * height.mm_per_px[0]), float(y * height.mm_per_px[1])), float(score[best])


@lru_cache(maxsize=16)  # the pixels of a sensor that are not valid are the same in most frames
def _disc_and_ring(
    valid: bytes, shape: tuple[int, int], size: tuple[int, int], radius: float
) -> list[tuple[Picture, Picture]]:
    """Return the weights of a disc and of the ring round it, and of each the share (rows, columns) that packed
    pixels say to be valid.
    """
    bits = np.unpackbits(np.frombuffer(valid, np.uint8), count=shape[0] * shape[1]).reshape(shape)
    known = cv2.resize(bits.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    reach = int(np.ceil(_RING[1] * radius))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.hypot(x, y)
    found = []
    for inside in (distance < 0.9 * radius, (distance > _RING[0] * radius) & (distance < _RING[1] * radius)):
        kernel = inside.astype(np.float32) / inside.sum()
        share = cv2.filter2D(known, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT)
        found.append((kernel, share))
    return found


def _describe(height: HeightMap, circle: Circle, model_mm: float) -> Footprint:
    x, y = _offsets(height, circle.centre_mm)
    mask = x**2 + y**2 <= circle.radius_mm**2
    reach = _INNER * circle.radius_mm
    there = (slice(*_span(y, reach)), slice(*_span(x, reach)))
    x, y = x[:, there[1]], y[there[0]]
    face = height.valid[there] & (x**2 + y**2 < reach**2)
    plane, std = _plane(height.depth_mm[there].astype(np.float64), face, (x, y), height.mm_per_px)
    lever = _INNER / 2 * circle.radius_mm  # rms distance from the middle of the face along one axis
    return Footprint(
        mask=mask,
        centre_mm=circle.centre_mm,
        centre_std_mm=circle.centre_std_mm,
        radius_mm=circle.radius_mm,
        radius_std_mm=float(np.hypot(circle.radius_std_mm, model_mm)),
        tilt=(float(plane[1]), float(plane[2])),
        tilt_std=std / lever,
        depth_mm=float(plane[0]),
        depth_std_mm=std,
        residual_mm=circle.residual_mm,
    )


def _span(offset: Floats, reach: float) -> tuple[int, int]:
    """Return the first index within `reach` of the middle, and the first beyond it."""
    near = np.flatnonzero(np.abs(offset.ravel()) < reach)
    return (int(near[0]), int(near[-1]) + 1) if near.size else (0, 0)


def _plane(depth_mm: Floats, face: Bools, offsets: tuple[Floats, Floats], mm_per_px: Pair) -> tuple[Floats, float]:
    """Fit a plane (depth at the centre, d/dx, d/dy) to the face.

    Return it and the standard deviation of its depth. Twice, the second time without residuals beyond 3 sigma.
    Their correlation length is their std over that of their gradient, so the face has area / (2 pi length^2)
    independent readings.
    """
    x, y = np.broadcast_to(offsets[0], face.shape)[face], np.broadcast_to(offsets[1], face.shape)[face]
    if x.size < 10:
        return np.array([np.nan, np.nan, np.nan]), float("nan")
    depth = depth_mm[face]
    basis = np.c_[np.ones_like(x), x, y]
    keep = np.ones(x.size, dtype=bool)
    plane = np.zeros(3)
    residual = depth
    for _ in range(2):
        plane, *_ = np.linalg.lstsq(basis[keep], depth[keep], rcond=None)
        residual = depth - basis @ plane
        keep = np.abs(residual) <= max(3 * float(residual[keep].std()), TINY)
    spread = float(residual[keep].std())
    whole = np.full(face.shape, np.nan)
    whole[face] = residual
    steps = np.diff(whole, axis=1) / mm_per_px[0]
    rough = float(np.nanstd(steps)) if np.isfinite(steps).any() else 0.0
    length = spread / rough if rough > 0 else max(mm_per_px)
    independent = max(keep.sum() * np.prod(mm_per_px) / (2 * np.pi * length**2), 3)
    return plane, spread / float(np.sqrt(independent))
