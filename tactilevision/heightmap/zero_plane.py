"""Fit the plane of zero depth to the untouched gel.

Slopes do not determine the mean of the surface, and a small error common to all slopes tilts all of it. The
untouched gel is flat and at depth 0, so

    z(x, y) = c_0 + c_x X + c_y Y + c_d (1 + e d / L) exp(-d / L)      on the untouched part

is fitted there and the plane subtracted everywhere. The last term is the gel's own rise (or sinking) outside the
contact, at distance d, which is no error of the zero. In a bonded layer of thickness h it decays over .75 h around
flat punches (finite elements) and over h around balls (layer theory): e is the relative deviation of the picture's
L from the usual .9 h, with a prior of that spread and of h's. Its remaining uncertainty is in the plane's
deviation. With L fixed at .75 h the plane lay 12 um too low (now 2) around a ball of 5.7 mm in contact radius on
gels of 2 to 4 mm, and up to 3 um (1) around smaller contacts.
Only the untouched part is fitted, so the tilt of a punch is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from tactilevision.photometric.drift import block_means, blocks_of, distance_px, inverse
from tactilevision.records.constants import ROUNDING, TINY
from tactilevision.records.contact_thresholds import slope_limit
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Array, Bools, Floats, Pair, Picture
from tactilevision.robust import MAD_TO_STD, filled, masked_median, namespace

DECAY_PER_THICKNESS = 0.9  # of the thickness: decay length of the rise: punches .75, balls 1
DECAY_STD = 0.17  # relative, from contact to contact
USUAL_THICKNESS_MM = 3  # mm, of gel whose thickness is not stated
THICKNESS_STD = 0.3  # relative deviation of such a thickness
FIRST_WEIGHT = 1000  # relative to all blocks: the first round keeps L
MIN_RISE = 1e-3  # of the blocks' scatter: no rise at all
CORRELATED = 50  # blocks, a tenth of the picture: correlation of integrated slope errors
MIN_BLOCKS = 12  # untouched blocks; fewer do not determine a tilt
MAX_DROP = 0.5  # of the depth from end to end: a piece of gel that lies so far below another is a face
DENTED = 5  # of the untouched blocks' scatter, beyond which the deepest of the others is a dent; as for a region
MAX_ITERATIONS = 4  # rounds of reweighting, limited by the time per frame
CONVERGENCE_TOL = 0.1  # of the blocks' scatter about the plane: a round that moves it by less is the last
STIFFENING = 1.0 + ROUNDING * np.eye(5)  # factor on normal equations: similar terms make them singular
SAMPLED = 8  # sampled places along each side of a block


@dataclass(frozen=True, slots=True)
class ZeroPlane:
    """`offset_mm`, `tilt` (per X, Y from -1 to 1, mm).

    `std_mm` of the plane at the picture's centre, `tilt_std_mm` of its tilt; `share` untouched. `takes`
    (3, blocks): weights of each block's depth in offset and tilt, None where the plane is not fitted.
    """

    offset_mm: float
    tilt_mm: Pair
    std_mm: float
    share: float
    takes: Picture | None = None
    tilt_std_mm: Pair = (0.0, 0.0)


def find_zero_plane(
    depth: Array,
    untouched: Bools,
    *,
    mm_per_px: Pair,
    thickness_mm: float | None = None,
    trusted: Bools | None = None,
) -> ZeroPlane:
    """Return the zero plane of `depth` (H, W), in mm.

    `untouched` (h, w) are its blocks, a coarser picture of the same view. The plane is fitted to `trusted` ones,
    all where None; the others, too dark to be read, are no contact that gel would rise around.

    With too little untouched gel to determine a tilt only the offset is fitted, and with none at all it is the
    median,
    with the spread of the whole map as its uncertainty.
    """
    blocks = _means(np.asarray(depth), untouched.shape)
    gel = _outer_gel(untouched if trusted is None else untouched | ~trusted, blocks)
    flat = (gel if trusted is None else gel & trusted).ravel()
    count = np.count_nonzero(flat)
    if count < MIN_BLOCKS:
        return ZeroPlane(float(np.median(blocks)), (0.0, 0.0), float(np.std(blocks)), float(flat.mean()))
    decay, decay_std = decay_of(depth.shape, gel.shape, mm_per_px=mm_per_px, thickness_mm=thickness_mm)
    terms = plane_terms(depth.shape, gel.shape)
    if rises := not gel.all() and bool(has_dent(blocks, gel.ravel(), flat, terms)):
        terms = with_rise(terms, gel, decay)
    used = list(range(len(terms)))
    if 3 * count < 2 * len(flat):  # two thirds of them never lie within half of the picture
        used = [k for k in used if k not in (1, 2) or np.ptp(terms[k, flat]) > 1.0]
    full, std, takes = np.zeros(5), np.zeros(5), np.zeros((5, len(flat)), np.float32)
    full[used], std[used], takes[used] = _reweighted_fit(
        terms if len(used) == len(terms) else terms[used], blocks, flat, rises=rises, decay_std=decay_std
    )
    offset, *tilt = full[:3].tolist()
    std_mm, *tilt_std = std[:3].tolist()
    return ZeroPlane(offset, (tilt[0], tilt[1]), std_mm, count / len(flat), takes[:3], (tilt_std[0], tilt_std[1]))


def level(depth: Array, zero: ZeroPlane) -> None:
    """Subtract the plane from `depth` (H, W), in mm, in place."""
    y, x = (_places(count, depth.dtype.char) for count in depth.shape)
    depth -= x * depth.dtype.type(zero.tilt_mm[0]) + depth.dtype.type(zero.offset_mm)
    depth -= (y * depth.dtype.type(zero.tilt_mm[1]))[:, None]


@lru_cache(maxsize=16)
def _places(count: int, dtype: str) -> Array:
    return np.linspace(-1, 1, count).astype(dtype)


def slope_of(zero: ZeroPlane, shape: tuple[int, ...], *, mm_per_px: Pair) -> Pair:
    """Return the slope (x, y) of the plane, mm per mm, over a picture (H, W)."""
    across, down = (step * (count - 1) for step, count in zip(mm_per_px, shape[::-1], strict=True))
    return 2.0 * zero.tilt_mm[0] / across, 2.0 * zero.tilt_mm[1] / down


def flat_blocks(slopes: SlopeMap) -> Bools:
    """Return the blocks (h, w) of the picture whose mean slope (mm/mm) is not significant."""
    size, _ = blocks_of(slopes.dz_dx.shape)
    p, q = (block_means(slope, size) for slope in (slopes.dz_dx, slopes.dz_dy))
    steep = np.hypot(p - np.median(p), q - np.median(q))
    return np.asarray(steep < slope_limit(np.median(steep)))


def _means(picture: Array, blocks: tuple[int, ...]) -> Floats:
    """Return means (rows * columns,) of a smooth picture over its blocks, from evenly spread places."""
    size = (blocks[1], blocks[0])
    few = (size[0] * SAMPLED, size[1] * SAMPLED)  # whole pixels per block are averaged many times faster
    if picture.size > few[0] * few[1]:
        picture = cv2.resize(picture, few, interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float64).ravel()


@lru_cache(maxsize=16)
def plane_terms(shape: tuple[int, ...], blocks: tuple[int, ...]) -> Floats:
    """Return terms 1, X, Y (3, blocks) of a picture of `shape`; X and Y are -1 and 1 at its ends."""
    x, y = np.meshgrid(np.linspace(-1, 1, shape[1]), np.linspace(-1, 1, shape[0]))
    places = [_means(ramp, blocks) for ramp in (x, y)]
    return np.stack([np.ones_like(places[0]), *places])


def _outer_gel(untouched: Bools, depth: Floats) -> Bools:
    """Return the untouched blocks around all contacts; a flat face, which has no slopes, is excluded.

    All of it that is connected to one piece at the picture's border: the largest, unless the blocks' `depth`
    (rows * columns,) shows another to lie higher by more than MAX_DROP of the depth range.
    """
    if untouched.all():
        return untouched
    rows, columns = untouched.shape
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(untouched.view(np.uint8), connectivity=4)
    pieces = [
        (size, label)
        for label, (left, top, width, height, size) in enumerate(boxes.tolist())
        if label and (left == 0 or top == 0 or left + width == columns or top + height == rows)
    ]
    if not pieces:
        return np.zeros_like(untouched)
    _, chosen = max(pieces)
    large = [label for size, label in pieces if size >= CORRELATED]
    if len(large) > 1:
        means = {label: float(depth[labels.ravel() == label].mean()) for label in large}
        highest = min(large, key=means.__getitem__)
        if means[chosen] - means[highest] > MAX_DROP * float(np.ptp(depth)):
            chosen = highest
    return np.asarray(labels == chosen)


def has_dent(depth: Any, gel: Any, flat: Any, plane: Any) -> Any:
    """Return whether (...) a block of the `depth` (..., n) outside the `gel` lies significantly deeper under a
    `plane` (3, n) than the `flat` blocks scatter: blocks that differ only in colour are no contact that gel would
    rise around. Of arrays or tensors, as the next two.
    """
    xp, weighted = namespace(depth), plane * flat[..., None, :]
    stiffening = 1.0 + ROUNDING * xp.eye(3, dtype=depth.dtype, device=depth.device)
    inverted, _ = inverse((weighted @ plane.T) * stiffening)
    off = depth - (inverted @ (weighted @ depth[..., None]))[..., 0] @ plane
    limit = DENTED * MAD_TO_STD * masked_median(abs(off), flat)
    return xp.amax(filled(off, gel, -np.inf), -1) > limit


def with_rise(plane: Any, gel: Any, decay: float) -> Any:
    """Return terms 1, X, Y, exp(-d / L), d / L exp(-d / L) (..., 5, blocks), d away from `gel` (..., h, w)."""
    xp, before = namespace(gel), gel.shape[:-2]
    away = (distance_px(gel) * decay).reshape(*before, 1, -1)
    near, plane = xp.exp(-away), xp.broadcast_to(plane, (*before, *plane.shape)) if before else plane
    return xp.concatenate([plane, near, away * near], -2)


def decay_of(
    shape: tuple[int, ...], blocks: tuple[int, ...], *, mm_per_px: Pair, thickness_mm: float | None
) -> Pair:
    """Return the side of a block of a picture of `shape` in units of L, and the prior deviation of e."""
    block_mm = 0.5 * (shape[1] * mm_per_px[0] / blocks[1] + shape[0] * mm_per_px[1] / blocks[0])
    std = DECAY_STD if thickness_mm else float(np.hypot(DECAY_STD, THICKNESS_STD))
    return block_mm / (DECAY_PER_THICKNESS * (thickness_mm or USUAL_THICKNESS_MM)), std


def _reweighted_fit(
    terms: Floats, depth: Floats, untouched: Bools, *, rises: bool, decay_std: float
) -> tuple[Floats, Floats, Floats]:
    """Return the reweighted least squares of terms (k, n) where `untouched` (n,): coefficients, their deviations
    (k,), and
    the weights (k, n) of the depths in each coefficient.

    Where it `rises`, the last coefficient has a prior of `decay_std` times the one before.
    """
    count, touched = np.count_nonzero(untouched), ~untouched
    correlated, prior_weight = min(CORRELATED, float(count)), FIRST_WEIGHT * count if rises else 0.0
    rows, weighted = np.concatenate([terms, depth[None]]), terms * untouched
    solution: Floats = np.zeros(len(terms))
    for _ in range(MAX_ITERATIONS):
        sums = weighted @ rows.T
        normal = sums[:, :-1] * STIFFENING[: len(terms), : len(terms)]
        normal[-1, -1] += prior_weight
        before, solution = solution, cv2.solve(normal, sums[:, -1:], flags=cv2.DECOMP_CHOLESKY)[1][:, 0]
        square = solution @ terms
        square -= depth
        square *= square
        square[touched] = np.inf
        scale = MAD_TO_STD * float(np.partition(square, count // 2)[count // 2]) ** 0.5 + TINY
        if np.abs(solution[:3] - before[:3]).max() < CONVERGENCE_TOL * scale:
            break
        if rises:
            prior_weight = correlated * (scale / (decay_std * abs(float(solution[-2])) + scale * MIN_RISE)) ** 2
        square *= 1 / (3 * scale) ** 2
        square += 1.0
        square *= square  # 1 over the weight of Geman & McClure
        weighted = terms / square
    inverse = cv2.invert(normal)[1]
    return solution, scale * np.sqrt(correlated * inverse.diagonal()), np.asarray(inverse @ weighted)
