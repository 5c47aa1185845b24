"""Fit circles robustly, and find circular edges in a slope map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Bytes, Floats, Pair
from tactilevision.robust import frame_mad_std, geman_mcclure_weight, mad_std, median, tukey_weight

# The circle through places some of which are not its own: quickly for every frame, or as well as can be.
#
# `quick_circle` is the weighted algebraic fit, two rounds of it, linear in its unknowns; it is good to a part of a
# pixel where the places lie about all of the circle. `fit_circle` is the geometric one, with its deviation:
#
#     minimise  sum_i w_i rho( |p_i - c| - R )        rho: Tukey's biweight, its scale from the residuals
#
# RANSAC (Fischler & Bolles, Comm. ACM 24 (1981) 381) finds the circle that most points agree on, whatever the
# others do; the weighted geometric (orthogonal distance) fit then refines it. Units: mm.

TRIALS = 200  # circles through three points: with half of all points wild none is good once in 4e11, 1/(7/8)^200
STIFFENING = 1e-9 * np.eye(3)  # added to normal equations that one direction may leave open


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
    well_spread = np.abs(twice) > 1e-9 * start_radius**2
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
    distance = np.hypot(*(points.T[:, None] - centres.T[..., None]))
    best = int(np.argmax(np.count_nonzero(np.abs(distance - radii[:, None]) < tolerance, axis=1)))
    return centres[best], float(radii[best])


def _refine(points: Floats, start: tuple[Floats, float], scale_mm: float) -> tuple[Floats, float, Floats]:
    centre, radius = np.array(start[0], dtype=np.float64), start[1]
    weights = np.ones(len(points))
    for _ in range(20):
        jacobian, residual = _linearised(points, centre, radius)
        weights = _tukey(residual, scale_mm)
        step, *_ = np.linalg.lstsq(jacobian * weights[:, None] ** 0.5, -residual * weights**0.5, rcond=None)
        centre, radius = centre + step[:2], radius + float(step[2])
        if np.abs(step).max() < 1e-6 * radius:
            break
    return centre, radius, weights


def _linearised(points: Floats, centre: Floats, radius: float) -> tuple[Floats, Floats]:
    offset = points - centre
    distance = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-9)
    return np.c_[-offset / distance[:, None], -np.ones(len(points))], distance - radius


def _inverse_diagonal(information: Floats) -> Floats:
    """Return it for a matrix (k, k) >= 0; a short arc gives very large values, never below 0."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(vectors**2 @ (1 / np.maximum(values, np.finfo(float).eps * values[-1])))


def _tukey(residual: Floats, scale_mm: float) -> Floats:
    spread = max(mad_std(residual, centre=0.0), 0.5 * scale_mm)
    return tukey_weight(residual, spread)


def quick_circle(x: Floats, y: Floats, *, weight: Floats) -> tuple[float, float, float]:
    """Return centre x, y and radius, in mm or px as the places (n,) are, robust to outliers.

    minimise  sum w (x^2 + y^2 - a x - b y - c)^2      `weight` (n,) w, then times that of Geman & McClure

    Source: Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8.
    """
    terms, squares = np.stack([x, y, np.ones_like(x)]), x * x + y * y
    keep = weight
    for _ in range(2):
        a, b, c = weighted_solution(terms, squares, weights=keep)
        radius = float(np.sqrt(max(c + 0.25 * (a * a + b * b), 1e-12)))
        off = np.sqrt((x - 0.5 * a) ** 2 + (y - 0.5 * b) ** 2) - radius
        keep = weight * geman_mcclure_weight(off, 2.0 * residual_std(off))
    return 0.5 * float(a), 0.5 * float(b), radius


def weighted_solution(terms: Floats, values: Floats, *, weights: Floats) -> Floats:
    """Return the weighted least squares (3,) of values (n,) over terms (3, n), in their unit."""
    weighted = terms * weights
    normal = weighted @ terms.T + STIFFENING
    return solved(normal, weighted @ values)


def solved(normal: Floats, right: Floats) -> Floats:
    """Return the solution (k,) of normal equations (k, k) x = right (k,), in their unit.

    They must be positive definite.
    """
    return np.asarray(cv2.solve(normal, right[:, None], flags=cv2.DECOMP_CHOLESKY)[1][:, 0])


def residual_std(off: Floats) -> float:
    """Return the robust deviation of residuals (n,) about 0, in their unit; never 0."""
    return frame_mad_std(off, centre=0.0) + 1e-9


# Round rims in a slope map: circles along which the surface drops steeply, with a sharp flank on the inside.

MIN_STEEP = 12  # pixels; fewer are noise
MAX_SAMPLES = 200  # pixels that determine the first circle of a rim
MIN_RADIUS_PX = 6.0  # px: a smaller circle has no distinct flank
MIN_ROUND = 1 / 3  # of the rim in the picture
OFF_ROUND_PX = 1.0  # spread of the flank about a circle
MAX_BLUR = 0.12  # of the radius: sigma of a blurred edge; wider flanks are bodies without an edge
BIN_PX = 0.5  # px: step of the profile across the edge
ACROSS = 4  # directions to a sector
CONVERGENCE_TOL = 0.03  # of the flank's spread about a circle: a round that moves the circle by less is the last
ROUNDS = 4  # of reweighting, at most
INNER_PX = 12.0  # px that the profile reaches inside the edge: past the foot of a blurred flank
OUTER_SHARE = 0.4  # of the radius that the profile reaches outside: the gel's own fall dies out there
MAX_OUTER_SHARE = 0.8  # the same where steep slopes reach far: a layer's surface keeps to the law so far
NEAR_PX = 4.0  # about the edge alone, this far outside
MEDIAN_STD = 0.93  # of a median of one normal number, in what lies between its quartiles
HALF = 0.6977  # sigma before the edge, where a blurred 1/sqrt(s) has half of its peak; by quadrature
QUARTER = 1.2452  # sigma before the edge, where it has a quarter of its peak; by quadrature

Picture = npt.NDArray[np.float32]


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
    places, values = _profiles(slopes, mm_per_px, circle, _bounds(radius, px, radius + NEAR_PX * px))
    flank = _flanks(places, values, 0.5)
    good = np.isfinite(flank)
    if np.count_nonzero(good) < MIN_ROUND * len(good):
        return None
    (radius, shift_x, shift_y), spread, uneven = _harmonics(flank, good)
    if spread > OFF_ROUND_PX * px or not MIN_RADIUS_PX * px < radius < 2 * px * max(slopes.dz_dx.shape):
        return None
    centre = x + shift_x, y + shift_y
    outer = (1 + OUTER_SHARE) * radius + 8.0 * px
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
    places, values = _profiles(slopes, mm_per_px, circle, _bounds(circle[2], min(mm_per_px), outer))
    low, middle, high, highest = _quantiles(values, 0.25, 0.5, 0.75, 0.8)
    count = np.maximum(np.count_nonzero(np.isfinite(values), axis=0), 1)
    return places, middle, highest, MEDIAN_STD * (high - low) / np.sqrt(count)


def _bounds(radius: float, px: float, outer: float) -> Pair:
    return max(0.4 * radius, radius - INNER_PX * px), outer


def _profiles(
    slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float], bounds_mm: Pair
) -> tuple[Floats, Floats]:
    """Return distances (J,) from a circle's centre, and slopes (K, J) towards it in K sectors.

    A circle is (x, y, radius); slopes are NaN where unseen.
    """
    px = min(mm_per_px)
    sectors = int(min(max(0.8 * circle[2] / px, 8), 32))
    across, down = _directions(sectors * ACROSS)
    places = np.arange(bounds_mm[0] + 0.5 * BIN_PX * px, bounds_mm[1], BIN_PX * px)
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
        inward[_known(slopes.valid, x, y) == 0] = np.nan
    means = np.add.reduce(inward.reshape(sectors, ACROSS, -1), axis=1)
    return places, np.asarray(means, np.float64) / ACROSS


def _sampled(plane: npt.NDArray[np.floating], x: Picture, y: Picture) -> Picture:
    plane = np.asarray(plane, np.float32)
    return np.asarray(cv2.remap(plane, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan))


def _known(valid: Bools, x: Picture, y: Picture) -> Bytes:
    return np.asarray(cv2.remap(valid.view(np.uint8), x, y, cv2.INTER_NEAREST))


@lru_cache(maxsize=64)
def _directions(count: int) -> tuple[Picture, Picture]:
    """Return cosines and sines (count, 1) of evenly spread directions."""
    angle = 2 * np.pi * (np.arange(count)[:, None] + 0.5) / count
    return np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)


@lru_cache(maxsize=64)
def _waves(sectors: int) -> Floats:
    """Return 1, cos and sin (3, sectors) of the sectors' angles."""
    angle = 2 * np.pi * (np.arange(sectors) + 0.5) / sectors
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])


def window_of(
    shape: tuple[int, ...], centre_mm: Pair, *, mm_per_px: Pair, outer_mm: float
) -> tuple[tuple[slice, slice], Floats, Floats]:
    """Return rows and columns within `outer_mm` of a centre, and places x (1, w), y (h, 1) from it in mm."""
    (x0, x1), (y0, y1) = (
        (max(0, int((c - outer_mm) / step)), max(0, min(n, int((c + outer_mm) / step) + 2)))
        for c, step, n in zip(centre_mm, mm_per_px, shape[::-1], strict=True)
    )
    x = (np.arange(x0, x1) * mm_per_px[0] - centre_mm[0])[None, :]
    y = (np.arange(y0, y1) * mm_per_px[1] - centre_mm[1])[:, None]
    return (slice(y0, y1), slice(x0, x1)), np.asarray(x, np.float64), np.asarray(y, np.float64)


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


def _harmonics(places: Floats, good: npt.NDArray[np.bool_]) -> tuple[Floats, float, float]:
    """Return mean, cos and sin part of `good` places over sectors; the usual spread and rms residual.

    Starts from the median: a side in shadow, whose flank lies farther out, would pass for a shift of the centre.
    """
    terms, places = _waves(len(places))[:, good], places[good]
    off = places - median(places)
    solution, scale = np.zeros(3), residual_std(off)
    for _ in range(ROUNDS):
        before, solution = (
            solution,
            weighted_solution(terms, places, weights=geman_mcclure_weight(off, 2.0 * scale)),
        )
        off = places - solution @ terms
        scale = residual_std(off)
        if np.abs(solution - before).max() < CONVERGENCE_TOL * scale:
            break
    return solution, scale, float(np.sqrt(np.mean(off**2)))
