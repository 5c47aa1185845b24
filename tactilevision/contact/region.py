"""Contact regions of a height map: what is deeper than noise explains, each region bounded by its edge.

Gel slopes down to a contact from far off, so the region deeper than noise is up to four times the contact. The
surface is steepest at the edge of a ball, a cone or a flat face. With g(z) the mean slope of a region's surface at
depth z,

    edge = the shallowest z with g(z) >= STEEPEST max g

and contact is what is deeper. For balls of 6 to 60 px in radius and flat steps the area is .9 to 1.15 of the true
one; for a ball wider than twice the gel's thickness, whose rim rises above untouched gel, a fifth is missing.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.deviation import DepthError
from tactilevision.records.contact_thresholds import CONTACT, depth_limit_mm, wide_depth_limit_mm
from tactilevision.records.maps import BEYOND_BALLS, BORDER, HeightMap
from tactilevision.records.measured import Array, Bools, Pair
from tactilevision.robust import mad_std, median

STEEPEST = 0.9  # of the greatest mean slope, at the edge; tests/contact/test_region.py
LEVELS = 20  # of depth, between the shallowest and the deepest of a region
SMOOTH_PX = 1.0  # px: sigma of the blur before slopes are computed
STD_STEP_PX = 4  # px: step of the pixels from which the median deviation of a map is taken
MIN_SLOPE_PX = 3  # least number of pixels for a slope

Places = npt.NDArray[np.intp]  # of pixels in the flattened map


def find_contact(height: HeightMap, error: DepthError | None = None) -> Bools:
    """Return the mask (H, W) of contact.

    A region deeper than the depth limit may be a slow, wide error of untouched gel. It counts if enough of its
    pixels exceed the wide limit, by the deviation that the method's `error` states, or are steeper or of another
    colour than untouched gel (`strong_evidence`), which does not depend on the deviation. Specks do not count.
    Limits: records/contact_thresholds.py.
    """
    noise_mm = map_noise_mm(height)
    deep = in_question(height, noise_mm)
    found = np.zeros_like(deep)
    if not deep.any():
        return found
    places, box = np.flatnonzero(deep), _bounds(deep)
    count, labels = cv2.connectedComponents(deep[box].view(np.uint8), connectivity=4)
    region = labels[deep[box]]
    sure = height.depth_mm.take(places) > _surely_mm(height, places, error=error, noise_mm=noise_mm)
    sizes, surely = (np.bincount(some, minlength=count) for some in (region, region[sure]))
    unsure = (surely < CONTACT.depth_min_px) & (sizes >= CONTACT.depth_min_px)
    if unsure.any():
        strongly = np.bincount(region[strong_evidence(height).take(places)], minlength=count)
        unsure &= strongly < np.maximum(CONTACT.strong_share * sizes, CONTACT.depth_min_px)
    sizes[unsure | (sizes < CONTACT.depth_min_px)] = 0
    for k in np.flatnonzero((sizes > 0) & (sizes >= CONTACT.depth_speck * sizes.max())):
        whole = labels == k
        window = _bounds(whole)
        found[box][window] |= _to_its_edge(height.depth_mm[box][window], whole[window], height.mm_per_px)
    return found


def in_question(height: HeightMap, noise_mm: float | None = None) -> Bools:
    """Return the mask (H, W) of what is deeper than the map is rough: its `noise_mm` (map_noise_mm) where
    known.
    """
    if not height.valid.any():
        return height.valid
    deepest_mm = cv2.minMaxLoc(height.depth_mm, mask=height.valid.view(np.uint8))[1]
    limit_mm = depth_limit_mm(map_noise_mm(height) if noise_mm is None else noise_mm, deepest_mm)
    return np.asarray(height.valid & (height.depth_mm > limit_mm))


def strong_evidence(height: HeightMap) -> Bools:
    """Return the mask (H, W) of slopes or colours that untouched gel hardly has, whatever error the depth has.

    Empty for a map without information.
    """
    depth, std_mm = np.asarray(height.depth_mm, np.float32), height.std_mm
    strong = np.zeros(depth.shape, np.bool_)
    if std_mm is not None and median(std_mm[::STD_STEP_PX, ::STD_STEP_PX].ravel()) > CONTACT.strong_blind_mm:
        return strong
    across = cv2.norm(depth[:, 1:], depth[:, :-1], cv2.NORM_INF) / height.mm_per_px[0]
    down = cv2.norm(depth[1:], depth[:-1], cv2.NORM_INF) / height.mm_per_px[1]
    if np.hypot(across, down) > CONTACT.strong_slope:  # else no mean of these slopes is so steep
        strong |= _smooth_slope(depth, height.mm_per_px)[1] > CONTACT.strong_slope
    if height.colour_change is not None and height.colour_change.max() > CONTACT.strong_colour_sigma:
        blocks = (height.colour_change > CONTACT.strong_colour_sigma).astype(np.uint8)
        strong |= cv2.resize(blocks, strong.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    return strong


def _bounds(mask: Bools) -> tuple[slice, slice]:
    """Return the smallest window that holds all pixels of a mask (h, w)."""
    left, top, across, down = cv2.boundingRect(mask.view(np.uint8))
    return slice(top, top + down), slice(left, left + across)


def at_border(contact: Bools) -> bool:
    """Return whether a contact (H, W) reaches the picture's border."""
    return bool(contact[0].any() or contact[-1].any() or contact[:, 0].any() or contact[:, -1].any())


def contact_flags(contact: Bools, error: DepthError | None = None) -> tuple[str, ...]:
    """Return the flags of a `contact`, a mask (H, W) without unit, by where it lies.

    `error` is that of the map's method.
    """
    border = (BORDER,) if at_border(contact) else ()
    return (*border, BEYOND_BALLS) if error and contact.any() and error.beyond_balls(contact) else border


def _to_its_edge(depth_mm: Array, region: Bools, mm_per_px: Pair) -> Bools:
    """Return the part of a `region` (h, w) of depths (h, w) mm that lies behind its steepest line."""
    if min(region.shape) < MIN_SLOPE_PX:
        return region
    smooth, steepness = _smooth_slope(depth_mm, mm_per_px)
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
    """Return the smoothed depth (h, w) mm and its slope, mm per mm."""
    smooth = cv2.GaussianBlur(np.asarray(depth_mm, np.float32), (0, 0), SMOOTH_PX)
    border = cv2.BORDER_REPLICATE
    across = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=1, scale=0.5 / mm_per_px[0], borderType=border)
    down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=1, scale=0.5 / mm_per_px[1], borderType=border)
    across[:, [0, -1]] *= 2  # one-sided differences
    down[[0, -1]] *= 2
    return smooth, cv2.magnitude(across, down, across)


def _surely_mm(height: HeightMap, places: Places, *, error: DepthError | None, noise_mm: float) -> Array | float:
    """Return the depth (n,) mm that untouched gel reaches at none of the `places` in one picture of two.

    0 if no deviation is known.
    """
    std_mm = untouched_std(height, error, noise_mm=noise_mm, places=places)
    if std_mm is None:
        return 0.0
    return wide_depth_limit_mm(std_mm, height.depth_mm.size * height.mm_per_px[0] * height.mm_per_px[1])


# Does anything touch the gel? The deviation of untouched gel, with which a depth is compared.
#
# `HeightMap.std_mm` includes the uncertainty of the depth's scale, a part g of the depth. It makes the depth of a
# contact uncertain, but not its presence: with g of a fifth no contact would reach five deviations. So it is
# removed, and applied to the deviation of untouched gel, which has that scale,
#
#     s^2 = (1 + g)^2 [ max(std^2 - g^2 depth^2, u^2) + r^2 ]
#
# u: the least local deviation of untouched gel; r: roughness of the shallow part of the map itself, in excess of
# the method's stated noise (median distance of the shallower half from its median, as a standard deviation).

SAMPLED = 4000  # approximate number of pixels that determine a map's roughness


def untouched_std(
    height: HeightMap, error: DepthError | None, *, noise_mm: float, places: Places | None = None
) -> Array | None:
    """Return the standard deviation (H, W) mm of untouched depth in a map of this noise, or at its `places` (n,).

    `error` is that of the method which made the map; None: the map's own deviation, which may itself be None.
    """
    if height.std_mm is None:
        return None

    def wanted(grid: Array) -> Array:
        return grid if places is None else grid.take(places)

    if error is None:
        return wanted(height.std_mm)
    depth, std = (np.asarray(wanted(grid), np.float32) for grid in (height.depth_mm, height.std_mm))
    gain_square, least = map(wanted, error.in_pixels(height.depth_mm.shape))
    square = np.maximum(std * std - gain_square * depth * depth, least)
    return np.asarray((1.0 + np.sqrt(gain_square)) * np.sqrt(square + np.float32(noise_mm**2)))


def map_noise_mm(height: HeightMap) -> float:
    """Return the standard deviation (mm) of the shallower half of a map (H, W), from the median distance to its
    median.

    0 of nothing.
    """
    step = max(1, int(np.sqrt(height.depth_mm.size / SAMPLED)))
    depth = height.depth_mm[::step, ::step][height.valid[::step, ::step]]
    if not depth.size:
        return 0.0
    shallow = depth[depth <= median(depth)]
    return mad_std(shallow)
