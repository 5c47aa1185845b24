"""Round rims in a slope map: circles along which the surface drops steeply, with a sharp flank on the inside."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.middle import median
from tactilevision.records import Floats, Pair, SlopeMap

LEAST_STEEP = 12  # pixels; fewer are noise
ENOUGH = 500  # pixels that tell a circle to look for a rim on
LEAST_RADIUS_PX = 6.0
LEAST_ROUND = 1 / 3  # of the rim in the picture
OFF_ROUND_PX = 1.0  # spread of the flank about a circle
SHARP = 0.12  # of the radius: sigma of a blurred edge; wider flanks are bodies without an edge
BIN_PX = 0.5
SETTLED = 0.03  # of the flank's spread about a circle: a round that moves the circle by less is the last
INNER_PX, OUTER = 12.0, 0.6  # the profile reaches this far inside the rim, and this part of the radius outside
NEAR_PX = 4.0  # about the edge alone, this far outside
STIFFENING = 1e-9 * np.eye(3)
HALF, QUARTER = 0.6977, 1.2452  # sigma before the edge, where a blurred 1/sqrt(s) has these parts of its peak


@dataclass(frozen=True, slots=True)
class Rim:
    """`centre_mm` from the middle of the top left pixel; `radius_mm`; `blur_mm` of its flank, one sigma;
    `uneven_mm` rms distance of the flank from a circle.

    `slopes` (K, J) towards the centre, in K sectors, at `places_mm` (J,) from it; NaN where unseen.
    """

    centre_mm: Pair
    radius_mm: float
    blur_mm: float
    uneven_mm: float
    places_mm: Floats
    slopes: Floats


def find_rims(slopes: SlopeMap, mm_per_px: Pair, limit: float) -> list[Rim]:
    """Sharp round rims about regions that are anywhere steeper than `limit`."""
    # every second pixel: a rim is long, and a frame has little time
    p, q = (np.array(plane[::2, ::2], np.float32) for plane in (slopes.dz_dx, slopes.dz_dy))
    squared = cv2.add(cv2.multiply(p, p, dst=p), cv2.multiply(q, q, dst=q), dst=p)
    beyond = cv2.compare(squared, limit**2, cv2.CMP_GT)
    if 4 * cv2.countNonZero(beyond) < LEAST_STEEP:
        return []
    gentle = cv2.compare(squared, 0.25 * limit**2, cv2.CMP_GT)
    _, labels = cv2.connectedComponents(cv2.morphologyEx(gentle, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
    steep = 4 * np.bincount(labels[beyond > 0])
    found = []
    for label in np.flatnonzero(steep >= LEAST_STEEP)[:8]:
        at = np.flatnonzero(labels == label)
        at = at[:: max(1, len(at) // ENOUGH)]
        rows, columns = np.divmod(at, labels.shape[1])
        x, y = columns * (2.0 * mm_per_px[0]), rows * (2.0 * mm_per_px[1])
        rim = _measure(slopes, mm_per_px, _circle(x, y, squared.ravel()[at].astype(np.float64)))
        if rim is not None:
            found.append(rim)
    return found


def _measure(slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float]) -> Rim | None:
    """The rim near a circle, None where it is not round and sharp.

    Twice: first about the edge alone, by a circle that what lies outside makes too large.
    """
    px = min(mm_per_px)
    x, y, radius = circle
    for part, more in ((0.0, NEAR_PX), (OUTER, 8.0)):
        if not LEAST_RADIUS_PX * px < radius < 2 * px * max(slopes.dz_dx.shape):
            return None
        inner, outer = max(0.4 * radius, radius - INNER_PX * px), (1 + part) * radius + more * px
        profiles = _profiles(slopes, mm_per_px, (x, y, radius), (inner, outer))
        if profiles is None:
            return None
        places, values, angles = profiles
        flanks = _flanks(places, np.concatenate([values, part_of(values, 0.5)]))
        sectors, (half, quarter) = flanks[0, :-1], flanks[:, -1]
        good = np.isfinite(sectors)
        if good.mean() < LEAST_ROUND or not np.isfinite(half + quarter):
            return None
        (_, shift_x, shift_y), spread, uneven = _harmonics(angles[good], sectors[good])
        if spread > OFF_ROUND_PX * px:
            return None
        blur = (half - quarter) / (QUARTER - HALF)
        centre, (x, y, radius) = (x, y), (x + shift_x, y + shift_y, half + HALF * blur)
    return Rim(centre, radius, blur, uneven, places, values) if blur < SHARP * radius else None


def _profiles(
    slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float], bounds_mm: Pair
) -> tuple[Floats, Floats, Floats] | None:
    """Distances (J,) within bounds from a circle's centre, slopes (K, J) towards it in K sectors, their angles.

    A circle is (x, y, radius); slopes are NaN where unseen.
    """
    px, step = min(mm_per_px), BIN_PX * min(mm_per_px)
    window, x, y = window_of(slopes.dz_dx.shape, circle[:2], mm_per_px, bounds_mm[1])
    if not x.size * y.size:
        return None
    dx, dy = (np.array(np.broadcast_to(d, (y.size, x.size)), np.float32) for d in (x, y))
    r, angle = cv2.cartToPolar(dx, dy)
    inward = slopes.dz_dx[window] * dx
    inward += slopes.dz_dy[window] * dy
    inward /= -np.maximum(r, np.float32(1e-9))
    sectors = int(min(max(0.8 * circle[2] / px, 8), 32))
    bins = int((bounds_mm[1] - bounds_mm[0]) / step)
    # what lies nearer or farther goes to one more bin at either end, which is left out
    r -= np.float32(bounds_mm[0] - step)
    r *= np.float32(1.0 / step)
    np.clip(r, 0.0, bins + 1.0, out=r)
    if slopes.valid is not None:
        r *= slopes.valid[window]
    angle *= np.float32(sectors / (2 * np.pi))
    index = np.minimum(np.floor(angle), sectors - 1.0) * (bins + 2) + np.floor(r)
    at, size = index.ravel().astype(np.intp), sectors * (bins + 2)
    count = np.bincount(at, minlength=size).reshape(sectors, -1)[:, 1:-1]
    if not count.any():
        return None
    total = np.bincount(at, inward.ravel(), size).reshape(sectors, -1)[:, 1:-1]
    values = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    places = np.asarray(bounds_mm[0] + step * (np.arange(bins) + 0.5), np.float64)
    return places, np.asarray(values), 2 * np.pi * (np.arange(sectors) + 0.5) / sectors


def window_of(
    shape: tuple[int, ...], centre_mm: Pair, mm_per_px: Pair, outer_mm: float
) -> tuple[tuple[slice, slice], Floats, Floats]:
    """Rows and columns within `outer_mm` of a centre, and their places x (1, w), y (h, 1) from it in mm."""
    (x0, x1), (y0, y1) = (
        (max(0, int((c - outer_mm) / step)), max(0, min(n, int((c + outer_mm) / step) + 2)))
        for c, step, n in zip(centre_mm, mm_per_px, shape[::-1], strict=True)
    )
    x = (np.arange(x0, x1) * mm_per_px[0] - centre_mm[0])[None, :]
    y = (np.arange(y0, y1) * mm_per_px[1] - centre_mm[1])[:, None]
    return (slice(y0, y1), slice(x0, x1)), np.asarray(x, np.float64), np.asarray(y, np.float64)


def part_of(values: Floats, *shares: float) -> Floats:
    """The values (shares, J) that a share of the known ones in each column of (K, J) do not exceed, or NaN."""
    last = np.maximum(np.isfinite(values).sum(axis=0) - 1, 0)
    ordered = np.sort(values.T, axis=1)  # NaN last
    return np.stack([ordered[np.arange(len(last)), (share * last).astype(np.intp)] for share in shares])


def _circle(x: Floats, y: Floats, weight: Floats) -> tuple[float, float, float]:
    """Centre and radius of the weighted algebraic circle, robust to what lies off it."""
    terms, squares = np.stack([x, y, np.ones_like(x)]), x * x + y * y
    keep = weight
    for _ in range(3):
        a, b, c = _solved(terms, squares, keep)
        radius = float(np.sqrt(max(c + 0.25 * (a * a + b * b), 1e-12)))
        off = np.sqrt((x - 0.5 * a) ** 2 + (y - 0.5 * b) ** 2) - radius
        keep = weight * _trust(off, _scale(off))
    return 0.5 * float(a), 0.5 * float(b), radius


def _flanks(places: Floats, profiles: Floats) -> Floats:
    """Places (2, K) where profiles (K, J), inwards from their peak, fall to a half and a quarter of it; or NaN."""
    filled = np.where(np.isfinite(profiles), profiles, -np.inf)
    top = np.argmax(filled, axis=1)
    before = np.arange(profiles.shape[1])[None, :] < top[:, None]
    peak = filled[np.arange(len(filled)), top]
    found = np.full((2, len(profiles)), np.nan)
    for row, part in enumerate((0.5, 0.25)):
        level = part * peak
        below = before & np.isfinite(profiles) & (profiles < level[:, None])
        some = np.flatnonzero(below.any(axis=1) & np.isfinite(peak))
        j = profiles.shape[1] - 1 - np.argmax(below[some, ::-1], axis=1)
        low, high = profiles[some, j], profiles[some, j + 1]
        found[row, some] = places[j] + (level[some] - low) / (high - low) * (places[1] - places[0])
    return found


def _harmonics(angles: Floats, places: Floats) -> tuple[Floats, float, float]:
    """Mean, cos and sin part of places over angles, robust; the usual spread and the rms of what is left.

    Starts from the median: a side in shadow, whose flank lies farther out, would pass for a shift of the centre.
    """
    terms = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    off = places - median(places)
    solution, scale = np.zeros(3), _scale(off)
    for _ in range(6):
        before, solution = solution, _solved(terms, places, _trust(off, scale))
        off = places - solution @ terms
        scale = _scale(off)
        if np.abs(solution - before).max() < SETTLED * scale:
            break
    return solution, scale, float(np.sqrt(np.mean(off**2)))


def _solved(terms: Floats, values: Floats, weights: Floats) -> Floats:
    """Weighted least squares of values (n,) over terms (3, n)."""
    heavy = terms * weights
    normal = heavy @ terms.T + STIFFENING
    return solved(normal, heavy @ values)


def solved(normal: Floats, right: Floats) -> Floats:
    """The solution (k,) of normal equations (k, k)."""
    return np.asarray(cv2.solve(normal, right[:, None], flags=cv2.DECOMP_CHOLESKY)[1][:, 0])


def _trust(off: Floats, scale: float) -> Floats:
    """Weight of what is `off` by that much."""
    return np.asarray((1.0 + (off * (0.5 / scale)) ** 2) ** -2)


def _scale(off: Floats) -> float:
    return 1.4826 * float(median(np.abs(off))) + 1e-9
