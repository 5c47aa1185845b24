"""Round rims in a slope map: circles along which the surface drops steeply, with a sharp flank on the inside."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.middle import median
from tactilevision.records import Floats, Pair, SlopeMap

LEAST_STEEP = 12  # pixels; fewer are noise
LEAST_RADIUS_PX = 6.0
LEAST_ROUND = 1 / 3  # of the rim in the picture
OFF_ROUND_PX = 1.0  # spread of the flank about a circle
SHARP = 0.12  # of the radius: sigma of a blurred edge; wider flanks are bodies without an edge
BIN_PX = 0.5
SETTLED = 0.03  # of the flank's spread about a circle: a round that moves the circle by less is the last
INNER_PX, OUTER = 12.0, 0.6  # the profile reaches this far inside the rim, and this part of the radius outside
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
    p *= p
    q *= q
    squared = cv2.add(p, q, dst=p)
    beyond = squared > limit**2
    if 4 * np.count_nonzero(beyond) < LEAST_STEEP:
        return []
    gentle = np.asarray(squared > 0.25 * limit**2, np.uint8)
    left, top, width, height = cv2.boundingRect(gentle)
    left, top = max(0, left - 2), max(0, top - 2)
    inside = slice(top, top + height + 4), slice(left, left + width + 4)
    squared, beyond, gentle = squared[inside], beyond[inside], gentle[inside]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        cv2.morphologyEx(gentle, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    )
    steep = 4 * np.bincount(labels[beyond], minlength=count)
    sizes = 2 * stats[:, (cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT)].min(axis=1)
    found = []
    for label in np.flatnonzero((steep >= LEAST_STEEP) & (sizes > LEAST_RADIUS_PX))[:8]:
        if label == 0:
            continue
        rows, columns = np.nonzero(labels == label)
        x, y = (columns + left) * (2.0 * mm_per_px[0]), (rows + top) * (2.0 * mm_per_px[1])
        rim = _measure(
            slopes, mm_per_px, _circle(np.asarray(x), np.asarray(y), squared[rows, columns].astype(np.float64))
        )
        if rim is not None:
            found.append(rim)
    return found


def _measure(slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float]) -> Rim | None:
    """The rim near a circle, None where it is not round and sharp."""
    px = min(mm_per_px)
    x, y, radius = circle
    ring = None
    for _ in range(3):
        if not LEAST_RADIUS_PX * px < radius < 2 * px * max(slopes.dz_dx.shape):
            return None
        if ring is None:
            ring = _Ring(slopes, mm_per_px, (x, y), (radius - (INNER_PX + 4) * px, (1 + OUTER) * radius + 12 * px))
        profiles = ring.profiles((x, y), radius, px)
        if profiles is None:
            return None
        places, values, angles = profiles
        flanks = _flanks(places, values)[0]
        good = np.isfinite(flanks)
        if good.mean() < LEAST_ROUND:
            return None
        (_, shift_x, shift_y), spread, uneven = _harmonics(angles[good], flanks[good])
        if spread > OFF_ROUND_PX * px:
            return None
        half, quarter = _flanks(places, part_of(values, 0.5)[None])[:, 0]
        if not np.isfinite(half + quarter):
            return None
        blur = (half - quarter) / (QUARTER - HALF)
        centre = (x, y)
        x, y, radius = x + shift_x, y + shift_y, half + HALF * blur
    return Rim(centre, radius, blur, uneven, places, values) if blur < SHARP * radius else None


class _Ring:
    """Pixels between two distances from a first centre, flat (N,): their places and slopes."""

    def __init__(self, slopes: SlopeMap, mm_per_px: Pair, centre_mm: Pair, bounds_mm: Pair) -> None:
        height, width = slopes.dz_dx.shape
        columns, rows = (
            np.arange(max(0, int((c - bounds_mm[1]) / step)), min(n, int((c + bounds_mm[1]) / step) + 2))
            for c, step, n in zip(centre_mm, mm_per_px, (width, height), strict=True)
        )
        x, y = (np.asarray(n * step, np.float32) for n, step in zip((columns, rows), mm_per_px, strict=True))
        squared = (x[None, :] - centre_mm[0]) ** 2 + (y[:, None] - centre_mm[1]) ** 2
        take = (squared < bounds_mm[1] ** 2) & (squared > max(bounds_mm[0], 1e-9) ** 2)
        window = (
            (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)) if len(rows) * len(columns) else ()
        )
        if slopes.valid is not None:
            take &= slopes.valid[window]
        at = np.nonzero(take)
        self.x, self.y = x[at[1]], y[at[0]]
        self.p, self.q = (np.asarray(s[window][at], np.float32) for s in (slopes.dz_dx, slopes.dz_dy))

    def profiles(self, centre_mm: Pair, radius: float, px: float) -> tuple[Floats, Floats, Floats] | None:
        """Distances (J,), slopes towards the centre (K, J) in K sectors, NaN where unseen, the sectors' angles."""
        dx, dy = self.x - np.float32(centre_mm[0]), self.y - np.float32(centre_mm[1])
        r = np.sqrt(dx * dx + dy * dy)  # np.hypot, safe for any size, takes seven times as long
        sectors = int(np.clip(0.8 * radius / px, 8, 32))
        inner = max(0.4 * radius, radius - INNER_PX * px)
        step = BIN_PX * px
        bins = int(((1 + OUTER) * radius + 8 * px - inner) / step)
        # what lies nearer or farther goes to one more bin at either end, which is left out
        at = np.clip((r - (inner - step)) / step, 0.0, bins + 1.0).astype(np.intp)
        sector = ((np.arctan2(dy, dx) / (2 * np.pi) + 1.0) * sectors).astype(np.intp)
        sector -= sectors * (sector >= sectors)  # a turn starts at half of them
        inward = -(self.p * dx + self.q * dy) / np.maximum(r, 1e-9)
        index = sector * (bins + 2) + at
        size = sectors * (bins + 2)
        count = np.bincount(index, minlength=size).reshape(sectors, -1)[:, 1:-1]
        if not count.any():
            return None
        total = np.bincount(index, inward, size).reshape(sectors, -1)[:, 1:-1]
        values = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        places = np.asarray(inner + step * (np.arange(bins) + 0.5), np.float64)
        return places, np.asarray(values), 2 * np.pi * (np.arange(sectors) + 0.5) / sectors


def part_of(values: Floats, share: float) -> Floats:
    """The value (J,) that `share` of the known ones in each column of (K, J) do not exceed; NaN without any."""
    last = np.maximum(np.isfinite(values).sum(axis=0) - 1, 0)
    ordered = np.sort(values, axis=0)  # NaN last
    return np.asarray(np.take_along_axis(ordered, (share * last).astype(np.intp)[None], axis=0)[0])


def _circle(x: Floats, y: Floats, weight: Floats) -> tuple[float, float, float]:
    """Centre and radius of the weighted algebraic circle, robust to what lies off it."""
    terms = np.stack([x, y, np.ones_like(x)], axis=1)
    keep = weight
    for _ in range(3):
        heavy = terms * keep[:, None]
        a, b, c = np.linalg.solve(heavy.T @ terms + 1e-9 * np.eye(3), heavy.T @ (x * x + y * y))
        radius = float(np.sqrt(max(c + 0.25 * (a * a + b * b), 1e-12)))
        off = np.sqrt((x - 0.5 * a) ** 2 + (y - 0.5 * b) ** 2) - radius
        keep = weight / (1.0 + (off / (2.0 * _scale(off))) ** 2) ** 2
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
    terms = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)
    off = places - median(places)
    solution = np.zeros(3)
    for _ in range(6):
        weights = 1.0 / (1.0 + (off / (2.0 * _scale(off))) ** 2) ** 2
        heavy = terms * weights[:, None]
        before, solution = solution, np.linalg.solve(heavy.T @ terms + 1e-9 * np.eye(3), heavy.T @ places)
        off = places - terms @ solution
        if np.abs(solution - before).max() < SETTLED * _scale(off):
            break
    return np.asarray(solution), _scale(off), float(np.sqrt(np.mean(off**2)))


def _scale(off: Floats) -> float:
    return 1.4826 * float(median(np.abs(off))) + 1e-9
