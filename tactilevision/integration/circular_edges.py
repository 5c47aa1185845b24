"""Round rims in a slope map: circles along which the surface drops steeply, with a sharp flank on the inside."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.compiled import compiled
from tactilevision.integration.circle import quick_circle, residual_std, weighted_solution
from tactilevision.records import Bools, Bytes, Floats, Pair, SlopeMap
from tactilevision.robust import geman_mcclure_weight, median

MIN_STEEP = 12  # pixels; fewer are noise
MAX_SAMPLES = 200  # pixels that tell a circle to look for a rim on
MIN_RADIUS_PX = 6.0  # px: of a smaller circle no flank can be told
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


def find_circular_edges(
    slopes: SlopeMap, mm_per_px: Pair, *, limit: float, gentlest: float | None = None
) -> list[CircularEdge]:
    """Sharp round rims in slopes (H, W), mm/mm, about regions that are anywhere steeper than `gentlest`.

    `limit`, which is also the usual `gentlest`, is the steepest slope that is read reliably.
    """
    # every second pixel: a rim is long, and a frame has little time
    p, q = (np.array(plane[::2, ::2], np.float32) for plane in (slopes.dz_dx, slopes.dz_dy))
    squared = cv2.add(cv2.multiply(p, p, dst=p), cv2.multiply(q, q, dst=q), dst=p)
    beyond = cv2.compare(squared, (gentlest or limit) ** 2, cv2.CMP_GT)
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
    """The rim near a circle, None where it is not round and sharp.

    Twice: first about the edge alone, by a circle that what lies outside makes too large. Its profile is taken
    farther out where slopes beyond `limit` reach so far that little gentle gel is seen beside them.
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
    """Places (J,) across a rim up to `outer`; the median slope there, that of all but a fifth, and its std."""
    places, values = _profiles(slopes, mm_per_px, circle, _bounds(circle[2], min(mm_per_px), outer))
    low, middle, high, highest = _quantiles(values, 0.25, 0.5, 0.75, 0.8)
    count = np.maximum(np.count_nonzero(np.isfinite(values), axis=0), 1)
    return places, middle, highest, MEDIAN_STD * (high - low) / np.sqrt(count)


def _bounds(radius: float, px: float, outer: float) -> Pair:
    return max(0.4 * radius, radius - INNER_PX * px), outer


def _profiles(
    slopes: SlopeMap, mm_per_px: Pair, circle: tuple[float, float, float], bounds_mm: Pair
) -> tuple[Floats, Floats]:
    """Distances (J,) within bounds from a circle's centre, and slopes (K, J) towards it in K sectors.

    A circle is (x, y, radius); slopes are NaN where unseen.
    """
    px = min(mm_per_px)
    sectors = int(min(max(0.8 * circle[2] / px, 8), 32))
    across, down = _directions(sectors * ACROSS)
    places = np.arange(bounds_mm[0] + 0.5 * BIN_PX * px, bounds_mm[1], BIN_PX * px)
    r = places.astype(np.float32)
    if compiled():
        from tactilevision.integration.profile_kernels import inward as inward_of, rays

        x, y = np.empty((2, len(across), len(r)), np.float32)
        along_x, along_y = (r / np.float32(mm) for mm in mm_per_px)
        left, top = (at / mm for at, mm in zip(circle, mm_per_px, strict=False))
        rays(across[:, 0], down[:, 0], along_x, along_y, left, top, x, y)
        p, q = _sampled(slopes.dz_dx, x, y), _sampled(slopes.dz_dy, x, y)
        known = np.ones(x.shape, np.uint8) if slopes.valid is None else _known(slopes.valid, x, y)
        return places, inward_of(p, q, known, across[:, 0], down[:, 0], ACROSS)
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
    """Cosines and sines (count, 1) of evenly spread directions."""
    angle = 2 * np.pi * (np.arange(count)[:, None] + 0.5) / count
    return np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)


@lru_cache(maxsize=64)
def _waves(sectors: int) -> Floats:
    """1, cos and sin (3, sectors) of the sectors' angles."""
    angle = 2 * np.pi * (np.arange(sectors) + 0.5) / sectors
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])


def window_of(
    shape: tuple[int, ...], centre_mm: Pair, *, mm_per_px: Pair, outer_mm: float
) -> tuple[tuple[slice, slice], Floats, Floats]:
    """Rows and columns within `outer_mm` of a centre, and their places x (1, w), y (h, 1) from it in mm."""
    (x0, x1), (y0, y1) = (
        (max(0, int((c - outer_mm) / step)), max(0, min(n, int((c + outer_mm) / step) + 2)))
        for c, step, n in zip(centre_mm, mm_per_px, shape[::-1], strict=True)
    )
    x = (np.arange(x0, x1) * mm_per_px[0] - centre_mm[0])[None, :]
    y = (np.arange(y0, y1) * mm_per_px[1] - centre_mm[1])[:, None]
    return (slice(y0, y1), slice(x0, x1)), np.asarray(x, np.float64), np.asarray(y, np.float64)


def _quantiles(values: Floats, *shares: float) -> Floats:
    """The values (shares, J) that a share of the known ones in each column of (K, J) do not exceed, or NaN."""
    if compiled():
        from tactilevision.integration.profile_kernels import quantiles

        return quantiles(values, np.array(shares))
    last = np.maximum(np.count_nonzero(np.isfinite(values), axis=0) - 1, 0)
    ordered = np.sort(values, axis=0)  # NaN last
    return np.asarray(ordered[np.multiply.outer(shares, last).astype(np.intp), np.arange(len(last))])


def _flanks(places: Floats, profiles: Floats, part: Floats | float) -> Floats:
    """Places (K,) where profiles (K, J), inwards from their peak, fall to a part of it (one, or (K,)); or NaN."""
    if compiled():
        from tactilevision.integration.circle_kernels import flanks

        return flanks(places, profiles, np.broadcast_to(part, len(profiles)).astype(np.float64))
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
    """Mean, cos and sin part of `good` places over sectors, robust; the usual spread and the rms of what is left.

    Starts from the median: a side in shadow, whose flank lies farther out, would pass for a shift of the centre.
    """
    terms, places = _waves(len(places))[:, good], places[good]
    if compiled():
        from tactilevision.integration.circle_kernels import harmonics

        return harmonics(places, np.ascontiguousarray(terms), CONVERGENCE_TOL, ROUNDS)
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
