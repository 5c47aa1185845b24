"""Which part of a height map is contact: what is pressed in beyond what noise explains, each region to its edge.

Gel slopes down to a contact from far off, so what is deeper than noise is up to four times the contact. At the
edge of a ball, a cone or a flat face the surface is steepest; beyond it the slope falls off. With g(z) the mean
slope of a region's surface at depth z,

    edge = the shallowest z with g(z) >= STEEPEST max g

and contact is what lies deeper. On balls of 6 to 60 px in radius and flat steps the area so comes out between .9
and 1.15 of the true one; of a ball wider than twice the gel is thick, whose rim rises above untouched gel, a fifth
is missing.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools, HeightMap, Pair
from tactilevision.records.contact_thresholds import CONTACT, depth_limit_mm, wide_depth_limit_mm
from tactilevision.robust import median
from tactilevision.uncertainty.depth import DepthError
from tactilevision.uncertainty.untouched_noise import map_noise_mm, untouched_std

STEEPEST = 0.9  # of the greatest mean slope: where the edge is; tests/contact/test_region.py
LEVELS = 20  # of depth, between the shallowest and the deepest of a region
SMOOTH_PX = 1.0  # px: sigma of the blur before slopes are taken
REACH_PX = 6  # px, from which the blur and a slope still take something
SAMPLED = 4  # pixels along each side, of which one tells how much is known of a map
MIN_SLOPE_PX = 3  # pixels, too few to tell a slope

Array = npt.NDArray[np.floating[Any]]
Window = tuple[slice, ...]
WHOLE: Window = (slice(None), slice(None))


def find_contact(height: HeightMap, error: DepthError | None = None) -> Bools:
    """Mask (H, W) of where something presses.

    A region is deeper than the limit of depth. Slow waves of untouched gel go as deep over wide areas. So it
    counts where enough pixels of it pass the wide limit, by the `error` of the method that made the map. That
    widens with the stated deviation; slopes and colours do not, and a region counts, too, where enough of it is
    steeper, or of another colour, than untouched gel is (`strong_evidence`). Specks do not count. Limits:
    records/contact_thresholds.py.
    """
    found = np.zeros(height.depth_mm.shape, np.bool_)
    noise_mm = map_noise_mm(height)
    deep = in_question(height, noise_mm)
    places = np.flatnonzero(deep)
    if not places.size:
        return found
    left, top, across, down = cv2.boundingRect(deep.view(np.uint8))
    box = slice(top, top + down), slice(left, left + across)
    count, labels = cv2.connectedComponents(deep[box].view(np.uint8), connectivity=4)
    region = labels[deep[box]]
    sizes = np.bincount(region, minlength=count)
    sure = height.depth_mm.take(places) > _surely_mm(height, places, error=error, noise_mm=noise_mm)
    surely = np.bincount(region[sure], minlength=count)
    unsure = (surely < CONTACT.depth_min_px) & (sizes >= CONTACT.depth_min_px)
    if unsure.any():
        where = unsure[region]
        strong = np.bincount(region[where][_strong(height, places[where])], minlength=count)
        unsure &= strong < np.maximum(CONTACT.strong_share * sizes, CONTACT.depth_min_px)
    sizes[unsure | (sizes < CONTACT.depth_min_px)] = 0
    for k in np.flatnonzero((sizes > 0) & (sizes >= CONTACT.depth_speck * sizes.max())):
        whole = labels == k
        left, top, across, down = cv2.boundingRect(whole.view(np.uint8))
        inner = slice(top, top + down), slice(left, left + across)
        window = tuple(slice(o.start + i.start, o.start + i.stop) for o, i in zip(box, inner, strict=True))
        found[window] |= _to_its_edge(height, window, whole[inner])
    return found


def in_question(height: HeightMap, noise_mm: float | None = None) -> Bools:
    """Mask (H, W) of what is deeper than the map is rough: its `noise_mm` (map_noise_mm) where that is known."""
    if not height.valid.any():
        return height.valid
    deepest_mm = cv2.minMaxLoc(height.depth_mm, mask=height.valid.view(np.uint8))[1]
    limit_mm = depth_limit_mm(map_noise_mm(height) if noise_mm is None else noise_mm, deepest_mm)
    return np.asarray(height.valid & (height.depth_mm > limit_mm))


def strong_evidence(height: HeightMap, window: Window = WHOLE) -> Bools:
    """Mask (h, w) of where slope or colour are such as untouched gel hardly has them, whatever depth may be off.

    Of a `window` of the map. Empty for a map of which next to nothing is known: its slopes tell nothing either.
    """
    depth = height.depth_mm[window]
    coloured = height.colour_change is not None and height.colour_change.max() > CONTACT.strong_colour_sigma
    steep = not _greatest_slope(depth, height.mm_per_px) <= CONTACT.strong_slope
    strong = np.zeros(depth.shape, np.bool_)
    if not (coloured or steep) or _is_blind(height):
        return strong
    if steep:
        strong = _smooth_slope(depth, height.mm_per_px)[1] > CONTACT.strong_slope
    if coloured and height.colour_change is not None:
        blocks = (height.colour_change > CONTACT.strong_colour_sigma).astype(np.uint8)
        size = height.depth_mm.shape[::-1]
        strong |= cv2.resize(blocks, size, interpolation=cv2.INTER_NEAREST)[window] > 0
    return np.asarray(strong)


def _is_blind(height: HeightMap) -> bool:
    if height.std_mm is None:
        return False
    return bool(median(height.std_mm[::SAMPLED, ::SAMPLED].ravel()) > CONTACT.strong_blind_mm)


def _strong(height: HeightMap, places: npt.NDArray[np.intp]) -> Bools:
    """`strong_evidence` of some pixels (n,), by their places in the flattened map; looked for round them alone."""
    shape = height.depth_mm.shape
    rows, columns = np.divmod(places, shape[1])
    window = tuple(
        slice(max(0, int(at.min()) - REACH_PX), min(size, int(at.max()) + REACH_PX + 1))
        for at, size in zip((rows, columns), shape, strict=True)
    )
    strong = strong_evidence(height, window)
    return np.asarray(strong[rows - window[0].start, columns - window[1].start])


def at_border(contact: Bools) -> bool:
    """Whether a contact (H, W) reaches the picture's border."""
    return bool(contact[0].any() or contact[-1].any() or contact[:, 0].any() or contact[:, -1].any())


def _to_its_edge(height: HeightMap, window: Window, region: Bools) -> Bools:
    """The part of a `region` (h, w) of the map's `window` that lies behind its steepest line."""
    if min(region.shape) < MIN_SLOPE_PX:
        return region
    smooth, steepness = _smooth_slope(height.depth_mm[window], height.mm_per_px)
    depth, slope = smooth[region], steepness[region]
    least, most = float(depth.min()), float(depth.max())
    step = (most - least) / LEVELS
    if step <= 0:
        return region
    level = np.minimum(((depth - least) / step).astype(int), LEVELS - 1)
    count = np.bincount(level, minlength=LEVELS)
    mean = np.where(count >= MIN_SLOPE_PX, np.bincount(level, slope, LEVELS) / np.maximum(count, 1), 0.0)
    edge = least + step * (float(np.argmax(mean >= STEEPEST * mean.max())) + 0.5)
    return np.asarray(region & (smooth > edge))


def _smooth_slope(depth_mm: Array, mm_per_px: Pair) -> tuple[Array, Array]:
    """Depth (h, w) mm without its noise, and how steep it is, mm per mm."""
    smooth = cv2.GaussianBlur(np.asarray(depth_mm, np.float32), (0, 0), SMOOTH_PX)
    wide = cv2.copyMakeBorder(smooth, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    across, down = wide[1:-1, 2:] - wide[1:-1, :-2], wide[2:, 1:-1] - wide[:-2, 1:-1]
    across *= 0.5 / mm_per_px[0]
    down *= 0.5 / mm_per_px[1]
    across[:, [0, -1]] *= 2.0  # over one pixel there, not over two
    down[[0, -1]] *= 2.0
    return smooth, cv2.magnitude(across, down)


def _greatest_slope(depth_mm: Array, mm_per_px: Pair) -> float:
    """What no slope of a map (h, w) without its noise is above: that from one pixel to the next."""
    depth = np.asarray(depth_mm, np.float32)
    across = cv2.norm(depth[:, 1:], depth[:, :-1], cv2.NORM_INF) / mm_per_px[0]
    down = cv2.norm(depth[1:], depth[:-1], cv2.NORM_INF) / mm_per_px[1]
    return float(np.hypot(across, down))


def _surely_mm(
    height: HeightMap, places: npt.NDArray[np.intp], *, error: DepthError | None, noise_mm: float
) -> Array | float:
    """Depth (n,) mm that untouched gel reaches at none of the pixels at `places` (n,) of the flattened map in one
    picture of two; 0 where no deviation is known."""
    std_mm = untouched_std(height, error, places=places, noise_mm=noise_mm)
    if std_mm is None:
        return 0.0
    return wide_depth_limit_mm(std_mm, height.depth_mm.size * height.mm_per_px[0] * height.mm_per_px[1])
