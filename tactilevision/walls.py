"""Walls too steep to read: what a flat punch's edge hides of the depth, out of the gel beside it.

Beside the sharp edge of a rigid flat face of radius a the gel's surface falls away as (s: distance from the edge)

    u(s) = w - sum_k c_k U_k(s)      U_k' = a s^k / (r sqrt(r^2 - a^2)),  r = a + s,  k = 0, 1, 2

k = 0 is Boussinesq's punch on a half-space; a layer, friction and large depth leave the root at the edge and
change the smooth factor, which k = 1, 2 follow. The slope has no bound at the edge: for two or three pixels it is
steeper than any ball showed, colours saturate, and a quarter of a deep face's height hides there. Slopes
farther out, and those at the foot of the blurred wall inside, are gentle and well read. They fix all unknowns of

    seen slope = <sin t> / <cos t>      t = arctan(u'), u blurred by the edge's rounding, < > blurred by the camera

(light is blurred, not slope, so a steep pixel counts by its normal), and the law carries the depth through.

Only round rims with a sharp inner flank are treated so: the slopes of balls, cones and ridges grow gently and are
left alone. Assumes a flat face, at least a third of whose rim is in the picture.
Source: Johnson, Contact Mechanics (1985), eq. 3.38 (k = 0).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Floats, Pair, SlopeMap
from tactilevision.rim import Rim, find_rims, part_of, solved, window_of

Picture = npt.NDArray[np.floating[Any]]
FOOT_PX, FAR = 6.0, 0.4  # read from this far inside the edge to this part of the radius outside
CAMERA_PX, EDGE_PX = (0.8, 0.5), (0.5, 0.8)  # usual blur of camera and edge, and its spread (log)
SLOPE_ERROR, SLOPE_FLOOR = 0.03, 0.01  # of the mean slope round the rim
LEAST_READ = 8  # bins
LEAST_FACE = 50  # pixels
FINE = 0.2  # px: grid of the law
ROUNDS, DAMPING = 8, 1e-3
SETTLED = 0.02  # by which a step would still lessen the squares of what is left, in deviations: a seventh of one


@dataclass(frozen=True, slots=True)
class Wall:
    """The wall round one flat face.

    `centre_mm` from the middle of the picture's top left pixel; `radius_mm` of the edge; `reach_mm` from the edge
    within which slopes are replaced; `places_mm`, `fall_mm` (n,): distances from the edge, and how far the
    surface lies below the face there; `depth_mm` of the face over the gel at the profile's end, about;
    `missing_mm` what the slopes as read lack of the step, `std_mm` how far the step may be off.
    """

    centre_mm: Pair
    radius_mm: float
    reach_mm: float
    places_mm: Floats
    fall_mm: Floats
    depth_mm: float
    missing_mm: float
    std_mm: float


def find_walls(slopes: SlopeMap, mm_per_px: Pair, limit: float) -> list[Wall]:
    """The walls round flat faces in `slopes`; `limit` is the steepest slope that is read reliably."""
    walls = [_through(rim, limit, min(mm_per_px)) for rim in find_rims(slopes, mm_per_px, limit)]
    return [wall for wall in walls if wall is not None]


def restore(slopes: SlopeMap, walls: list[Wall], mm_per_px: Pair) -> None:
    """Put the law's slopes in place of those that the walls hide, in place.

    Along the rim nothing slopes but what the face's own tilt t, gentle and well read, makes of a rigid face:
    slope = -u'(s) (1 + t.x/w) r/|r| + t (1 - u/w).
    """
    for wall in walls:
        outer = wall.radius_mm + wall.reach_mm
        window, x, y = window_of(slopes.dz_dx.shape, wall.centre_mm, mm_per_px, outer)
        r = np.sqrt(x * x + y * y)
        p, q = slopes.dz_dx[window], slopes.dz_dy[window]
        inner = wall.radius_mm + wall.places_mm[0]
        face = np.asarray(r < inner - min(mm_per_px), np.uint8)
        known = cv2.countNonZero(face) >= LEAST_FACE
        tilt = (cv2.mean(p, face)[0], cv2.mean(q, face)[0]) if known else (0.0, 0.0)
        band = np.divmod(np.flatnonzero((r >= inner) & (r < outer)), r.shape[1])
        at, half = r[band], 0.5 * min(mm_per_px)
        x, y = x[0, band[1]], y[band[0], 0]
        s = at - wall.radius_mm
        below, above = (np.interp(s + d, wall.places_mm, wall.fall_mm) for d in (half, -half))
        leaning = 1.0 + (tilt[0] * x + tilt[1] * y) / wall.depth_mm
        steep = (above - below) / (2 * half) * leaning / at
        left = 1.0 - 0.5 * (above + below) / wall.depth_mm
        p[band] = steep * x + tilt[0] * left
        q[band] = steep * y + tilt[1] * left


def _through(rim: Rim, limit: float, px: float) -> Wall | None:
    """The law through the gentle slopes beside a wall; None where too few of them are seen."""
    # the median: on a side away from all lights the slopes are read far too low
    mean, highest = part_of(rim.slopes, 0.5, 0.8)
    count = np.maximum(np.isfinite(rim.slopes).sum(axis=0), 1)
    scatter = 1.86 * part_of(np.abs(rim.slopes - mean), 0.5)[0] / np.sqrt(count)  # of a median of normal numbers
    s = rim.places_mm - rim.radius_mm
    far = max(FAR * rim.radius_mm, 8 * px)
    steep = np.isfinite(mean) & ~(highest < limit)
    use = np.isfinite(mean) & ~steep & (s > -FOOT_PX * px) & (s < far)
    if not steep.any() or s[steep].max() > 0.5 * far or (use & (s > 0)).sum() < LEAST_READ:
        return None
    std = np.sqrt(SLOPE_FLOOR**2 + (SLOPE_ERROR * mean) ** 2 + scatter**2)[use]
    law = _Law(rim.radius_mm, px, far)
    usual = law.usual(s[use], mean[use])
    loose = np.array([2 * px, EDGE_PX[1], CAMERA_PX[1], 10 * usual[3],
                      3 * usual[3] / rim.radius_mm, 3 * usual[3] / rim.radius_mm**2])  # fmt: skip

    def misfit(unknowns: Floats) -> Floats:
        return np.concatenate([(law.seen(unknowns, s[use]) - mean[use]) / std, (unknowns - usual) / loose], axis=1)

    found, covariance = _least_squares(misfit, usual, loose)
    reach = float(s[steep].max() + px)
    aside = np.diag(1e-3 * loose)
    falls = law.falls_at(np.concatenate([found[None], found + aside, found - aside]), reach)
    rate = (falls[1:7] - falls[7:]) / (2e-3 * loose)
    with_edge = rate @ covariance[:, 0] / covariance[0, 0]  # all else following the edge
    inner = -3.0 * float(np.hypot(*np.exp(found[1:3])))
    band = (s > inner + found[0]) & (s < reach)
    read, beyond = (float(np.nansum(mean[part])) * (s[1] - s[0]) for part in (band, s >= reach))
    places = np.arange(inner, reach - found[0] + 2 * px, FINE * px)
    fall = float(falls[0])
    return Wall(rim.centre_mm, rim.radius_mm + float(found[0]), reach - float(found[0]), places,
                law.table(found, places), fall + beyond, fall - read,
                float(np.hypot(np.sqrt(rate @ covariance @ rate), with_edge * rim.uneven_mm)))  # fmt: skip


class _Law:
    """The law on a fine grid. Unknowns: shift of the edge, log of its blur and the camera's (mm), c_0 to c_2."""

    def __init__(self, radius_mm: float, px: float, far: float) -> None:
        self.step, self.px = FINE * px, px
        self.grid = np.arange(-14 * px, far + 14 * px, self.step)
        r = radius_mm + np.maximum(self.grid, 0.0)
        angle, log = np.arccos(radius_mm / r), np.arccosh(r / radius_mm)
        root = np.sqrt(np.maximum(r * r - radius_mm**2, 0.0))
        self.falls = np.stack(
            [angle, radius_mm * (log - angle), radius_mm * (root - radius_mm * (2 * log - angle))]
        )
        self.rates = np.diff(self.falls, axis=1) / self.step

    def usual(self, s: Floats, mean: Floats) -> Floats:
        """Unknowns to start from: usual blur, and the half-space's law through what lies outside."""
        rate = np.interp(s, self.grid, np.gradient(self.falls[0], self.step)) * (s > 3 * self.px)
        return np.array([0.0, np.log(EDGE_PX[0] * self.px), np.log(CAMERA_PX[0] * self.px),
                         float(rate @ mean / (rate @ rate)), 0.0, 0.0])  # fmt: skip

    def falls_at(self, unknowns: Floats, s: float) -> Floats:
        """Falls (K,) at `s` for unknowns (K, 6)."""
        rows = self._blurred(self.falls, unknowns)
        return np.array([np.interp(s - row[0], self.grid, line) for row, line in zip(unknowns, rows, strict=True)])

    def table(self, unknown: Floats, s: Floats) -> Floats:
        return np.asarray(np.interp(s, self.grid, self._blurred(self.falls, unknown[None])[0]))

    def seen(self, unknowns: Floats, s: Floats) -> Floats:
        """Slopes (K, n) that the picture shows at `s` (n,), for unknowns (K, 6)."""
        slope, count = self._blurred(self.rates, unknowns), len(unknowns)
        up = 1.0 / np.sqrt(1.0 + slope * slope)
        light = np.concatenate([slope * up, up])
        blurred = _blur(light, np.exp(unknowns[0, 2]) / self.step)
        for i in np.flatnonzero(unknowns[:, 2] != unknowns[0, 2]):
            blurred[i::count] = _blur(light[i::count], np.exp(unknowns[i, 2]) / self.step)
        places, shifts = self.grid[:-1] + 0.5 * self.step, unknowns[:, 0]
        rows = zip(shifts, blurred[:count] / blurred[count:], strict=True)
        return np.stack([np.interp(s - shift, places, row) for shift, row in rows])

    def _blurred(self, lines: Floats, unknowns: Floats) -> Floats:
        """Sums (K, n) of lines (3, n) blurred by the edge, for unknowns (K, 6), most with the first's blur."""
        rows = unknowns[:, 3:] @ _blur(lines, np.exp(unknowns[0, 1]) / self.step)
        for i in np.flatnonzero(unknowns[:, 1] != unknowns[0, 1]):
            rows[i] = unknowns[i, 3:] @ _blur(lines, np.exp(unknowns[i, 1]) / self.step)
        return np.asarray(rows)


def _blur(rows: Floats, sigma: float) -> Floats:
    """Lines (K, n) blurred by `sigma` of their steps."""
    sigma = min(max(sigma, 0.3), 0.25 * rows.shape[1])  # a step of the fit may stray
    size = round(8.0 * sigma + 1.0) | 1
    return np.asarray(cv2.GaussianBlur(rows, (size, 1), sigma, borderType=cv2.BORDER_REPLICATE))


def _least_squares(misfit: Callable[[Floats], Floats], start: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """Damped Gauss-Newton from `start`, differences in parts of `scale`: the minimum and its covariance.

    `misfit` gives what is left (K, n) for each of (K, m) unknowns.
    """
    steps = 1e-4 * scale
    aside = np.concatenate([np.zeros((1, len(start))), np.diag(steps)])
    unknown, left, damping = start, misfit(start + aside), DAMPING
    for _ in range(ROUNDS):
        slope = (left[1:] - left[0]) / steps[:, None]
        normal, uphill = slope @ slope.T, slope @ left[0]
        if uphill @ solved(normal, uphill) < SETTLED:
            break
        for _ in range(5):
            damped = 1.0 + damping * np.eye(len(start))
            trial = unknown - solved(normal * damped, uphill)
            after = misfit(trial + aside)
            if after[0] @ after[0] < left[0] @ left[0]:
                break
            damping *= 30.0
        else:
            break
        unknown, left, damping = trial, after, max(0.1 * damping, DAMPING)
    return unknown, np.linalg.inv(normal)
