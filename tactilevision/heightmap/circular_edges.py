"""Find circular edges in a slope map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from tactilevision.records.constants import ROUNDING, TINY
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Array, Bools, Floats, Pair, Picture
from tactilevision.robust import MAD_TO_STD, median

# Round rims in a slope map: circles along which the surface drops steeply, with a sharp flank on the inside.
#
# The first circle of a rim is the weighted algebraic fit, two rounds of it, linear in its unknowns; it is good to
# a part of a pixel where the places lie about all of the circle.

STIFFENING = ROUNDING * np.eye(3)  # added to normal equations that one direction may leave open
MIN_STEEP = 12  # pixels; fewer are noise
MAX_SAMPLES = 200  # pixels that determine the first circle of a rim
MIN_RADIUS_PX = 6  # px: a smaller circle has no distinct flank
MIN_ROUND = 1 / 3  # of the rim in the picture
OFF_ROUND_PX = 1.0  # spread of the flank about a circle
MAX_BLUR = 0.12  # of the radius: sigma of a blurred edge; wider flanks are bodies without an edge
BIN_PX = 0.5  # px: step of the profile across the edge
ACROSS = 4  # directions to a sector
CONVERGENCE_TOL = 0.03  # of the flank's spread about a circle: a round that moves the circle by less is the last
ROUNDS = 4  # of reweighting, at most
INNER_PX = 12  # px that the profile reaches inside the edge: past the foot of a blurred flank
OUTER_SHARE = 0.4  # of the radius that the profile reaches outside: the gel's own fall dies out there
MAX_OUTER_SHARE = 0.8  # the same where steep slopes reach far: a layer's surface keeps to the law so far
NEAR_PX = 4  # about the edge alone, this far outside
MEDIAN_STD = 0.93  # of a median of one normal number, in what lies between its quartiles
HALF = 0.6977  # sigma before the edge, where a blurred 1/sqrt(s) has half of its peak; by quadrature
QUARTER = 1.2452  # sigma before the edge, where it has a quarter of its peak; by quadrature


@dataclass(frozen=True, slots=True)
class CircularEdge:
    """`centre_mm` from the middle of the top left pixel; `radius_mm`; `blur_mm` of its flank, one sigma;
    `uneven_mm` rms distance of the flank from a circle.

    `slopes` (J,) towards the centre at `places_mm` from it, the median over directions: on a side away from all
    lights they are read far too low. `highest` (J,) in all but a fifth of them, `std` (J,) of the median by their
    scatter. NaN where unseen.
    """

    centre_mm: Pair
    radius_mm: float
    blur_mm: float
    uneven_mm: float
    places_mm: Floats
    slopes: Floats
    highest: Floats
    std: Floats


def find_circular_edges(slopes: SlopeMap, mm_per_px: Pair, *, limit: float) -> list[CircularEdge]:
    """Return sharp round rims in slopes (H, W), mm/mm, about regions anywhere steeper than `limit`.

    `limit` is the steepest slope that is read reliably.
    """
    # every second pixel: a rim is long, and a frame has little time
    p, q = (np.array(plane[::2, ::2], np.float32) for plane in (slopes.dz_dx, slopes.dz_dy))
    squared = cv2.add(cv2.multiply(p, p, dst=p), cv2.multiply(q, q, dst=q), dst=p)
    beyond = cv2.compare(squared, limit**2, cv2.CMP_GT)
    if 4 * cv2.countNonZero(beyond) < MIN_STEEP:
        return []
    gentle = cv2.compare(squared, 0.25 * limit**2, cv2.CMP_GT)
    _, labels = cv2.connectedComponents(cv2.morphologyEx(gentle, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
    steep = 4 * np.bincount(labels[beyond > 0])
    edges = []
    for label in np.flatnonzero(steep >= MIN_STEEP)[:8]:
        at = np.flatnonzero(labels == label)
        at = at[:: max(1, len(at) // MAX_SAMPLES)]
        rows, columns = np.divmod(at, labels.shape[1])
        x, y = columns * (2.0 * mm_per_px[0]), rows * (2.0 * mm_per_px[1])
        circle = quick_circle(x, y, weight=squared.ravel()[at].astype(np.float64))
        edge = _fit_edge(slopes, mm_per_px, circle, limit=limit)
        if edge is not None:
            edges.append(edge)
    return edges


def quick_circle(x: Floats, y: Floats, *, weight: Floats) -> tuple[float, float, float]:
    """Return centre x, y and radius, in mm or px as the places (n,) are, robust to outliers.

    minimise  sum w (x^2 + y^2 - a x - b y - c)^2      `weight` (n,) w, then times that of Geman & McClure

    Source: Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8.
    """
    terms, squares = np.stack([x, y, np.ones_like(x)]), x * x + y * y
    keep = weight
    for last in (False, True):
        a, b, c = weighted_solution(terms, squares, weights=keep)
        radius = float(np.sqrt(max(c + 0.25 * (a * a + b * b), TINY)))
        if not last:
            off = np.sqrt((x - 0.5 * a) ** 2 + (y - 0.5 * b) ** 2) - radius
            keep = weight * geman_mcclure_weight(off, 2.0 * residual_std(off))
    return 0.5 * float(a), 0.5 * float(b), radius


def weighted_solution(terms: Floats, values: Floats, *, weights: Floats) -> Floats:
    """Return the weighted least squares (3,) of values (n,) over terms (3, n), in their unit."""
    weighted = terms * weights
    normal = weighted @ terms.T + STIFFENING
    return np.asarray(cv2.solve(normal, (weighted @ values)[:, None], flags=cv2.DECOMP_CHOLESKY)[1][:, 0])


def residual_std(off: Floats) -> float:
    """Return the robust deviation of residuals (n,) about 0, in their unit; never 0."""
    ordered = np.sort(np.abs(off))
    middle = 0.5 * (ordered[(len(off) - 1) // 2] + ordered[len(off) // 2])
    return MAD_TO_STD * float(middle) + TINY


def geman_mcclure_weight(residual: Floats, width: float) -> Floats:
    """Return the weight 1 / (1 + (r / width)^2)^2 (n,) of residuals r (n,), in the unit of `width`.

    Source: Geman & McClure, Bull. Int. Statist. Inst. 52 (1987) 5: it falls to a quarter at `width`.
    """
    weight = 1.0 / (1.0 + np.square(residual * (1.0 / width)))
    return np.asarray(weight * weight)


def _fit_edge(
    slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float], *, limit: float
) -> CircularEdge | None:
    """Return the rim near a circle, None where it is not round and sharp.

    Twice: first about the edge alone, by a circle that what lies outside makes too large. Its profile is taken
    farther out where slopes beyond `limit` reach so far that little gentle gel remains outside them.
    """
    px = min(mm_per_px)
    x, y, radius = circle
    if not MIN_RADIUS_PX * px < radius < 2 * px * max(slopes.dz_dx.shape):
        return None
    places, values = _profiles(slopes, mm_per_px, circle, radius + NEAR_PX * px)
    flank = _flanks(places, values, 0.5)
    good = np.isfinite(flank)
    if np.count_nonzero(good) < MIN_ROUND * len(good):
        return None
    (radius, shift_x, shift_y), spread, uneven = _harmonics(flank, good)
    if spread > OFF_ROUND_PX * px or not MIN_RADIUS_PX * px < radius < 2 * px * max(slopes.dz_dx.shape):
        return None
    centre = x + shift_x, y + shift_y
    outer = (1 + OUTER_SHARE) * radius + 8 * px
    places, median, highest, std = _profile(slopes, mm_per_px, (*centre, radius), outer)
    half, quarter = _flanks(places, np.stack([median, median]), np.array([0.5, 0.25]))
    blur = (half - quarter) / (QUARTER - HALF)
    if not blur < MAX_BLUR * radius:  # nor where it is not known
        return None
    steep = float(places[~(highest < limit) & np.isfinite(highest)].max(initial=radius)) - radius
    if 2.0 * steep > outer - radius:
        outer = radius + min(2.0 * steep + px, MAX_OUTER_SHARE * radius)
        places, median, highest, std = _profile(slopes, mm_per_px, (*centre, radius), outer)
    return CircularEdge(centre, half + HALF * blur, blur, uneven, places, median, highest, std)


def _profile(
    slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float], outer: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return places (J,) across a rim up to `outer`; the median slope, that of all but a fifth, and its std."""
    places, values = _profiles(slopes, mm_per_px, circle, outer)
    low, middle, high, highest = _quantiles(values, 0.25, 0.5, 0.75, 0.8)
    count = np.maximum(np.count_nonzero(np.isfinite(values), axis=0), 1)
    return places, middle, highest, MEDIAN_STD * (high - low) / np.sqrt(count)


def _profiles(
    slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float], outer: float
) -> tuple[Floats, Floats]:
    """Return distances (J,) up to `outer` from a circle's centre, and slopes (K, J) towards it in K sectors.

    A circle is (x, y, radius); slopes are NaN where unseen.
    """
    px = min(mm_per_px)
    sectors = int(min(max(0.8 * circle[2] / px, 8), 32))
    _, across, down = _waves(sectors * ACROSS).astype(np.float32)[:, :, None]
    inner = max(0.4 * circle[2], circle[2] - INNER_PX * px)
    places = np.arange(inner + 0.5 * BIN_PX * px, outer, BIN_PX * px)
    r = places.astype(np.float32)
    x, y = across * (r / np.float32(mm_per_px[0])), down * (r / np.float32(mm_per_px[1]))
    x += np.float32(circle[0] / mm_per_px[0])
    y += np.float32(circle[1] / mm_per_px[1])
    inward = _sampled(slopes.dz_dx, x, y)
    inward *= -across
    along_y = _sampled(slopes.dz_dy, x, y)
    along_y *= down
    inward -= along_y
    if slopes.valid is not None and not slopes.valid.all():
        inward[cv2.remap(slopes.valid.view(np.uint8), x, y, cv2.INTER_NEAREST) == 0] = np.nan
    means = np.add.reduce(inward.reshape(sectors, ACROSS, -1), axis=1)
    return places, np.asarray(means, np.float64) / ACROSS


def _sampled(plane: Array, x: Picture, y: Picture) -> Picture:
    plane = np.asarray(plane, np.float32)
    return np.asarray(cv2.remap(plane, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan))


@lru_cache(maxsize=64)
def _waves(sectors: int) -> Floats:
    """Return 1, cos and sin (3, sectors) of evenly spread directions."""
    angle = 2 * np.pi * (np.arange(sectors) + 0.5) / sectors
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])


def _quantiles(values: Floats, *shares: float) -> Floats:
    """Return the quantiles (shares, J) of the known values in each column of (K, J), or NaN."""
    last = np.maximum(np.count_nonzero(np.isfinite(values), axis=0) - 1, 0)
    ordered = np.sort(values, axis=0)  # NaN last
    return np.asarray(ordered[np.multiply.outer(shares, last).astype(np.intp), np.arange(len(last))])


def _flanks(places: Floats, profiles: Floats, part: Floats | float) -> Floats:
    """Return places (K,) where profiles (K, J), inwards from their peak, fall to a part of it; or NaN."""
    filled = np.where(np.isnan(profiles), -np.inf, profiles)
    top, each = np.argmax(filled, axis=1), np.arange(len(filled))
    level = part * filled[each, top]
    below = profiles < level[:, None]  # never where NaN
    below &= np.arange(profiles.shape[1]) < top[:, None]
    before = profiles.shape[1] - 1 - np.argmax(below[:, ::-1], axis=1)
    some = below[each, before]
    before[~some] = 0
    low, high = profiles[each, before], profiles[each, before + 1]
    share = (level - low) / np.where(some, high - low, np.nan)
    return np.asarray(places[before] + share * (places[1] - places[0]))


def _harmonics(places: Floats, good: Bools) -> tuple[Floats, float, float]:
    """Return mean, cos and sin part of `good` places over sectors; the usual spread and rms residual.

    Starts from the median: a side in shadow, whose flank lies farther out, would pass for a shift of the centre.
    """
    terms, places = _waves(len(places))[:, good], places[good]
    off = places - median(places)
    solution, scale = np.zeros(3), residual_std(off)
    for _ in range(ROUNDS):
        before, weights = solution, geman_mcclure_weight(off, 2.0 * scale)
        solution = weighted_solution(terms, places, weights=weights)
        off = places - solution @ terms
        scale = residual_std(off)
        if np.abs(solution - before).max() < CONVERGENCE_TOL * scale:
            break
    return solution, scale, float(np.sqrt(np.mean(off**2)))
