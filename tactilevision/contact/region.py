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
REACH_PX = 6  # px: radius of the blur and the slope's stencil
STD_STEP_PX = 4  # px: step of the pixels from which the median deviation of a map is taken
MIN_SLOPE_PX = 3  # least number of pixels for a slope

Window = tuple[slice, ...]
WHOLE: Window = (slice(None), slice(None))


def find_contact(height: HeightMap, error: DepthError | None = None) -> Bools:
    """Return the mask (H, W) of contact.

    A region deeper than the depth limit may be a slow, wide error of untouched gel. It counts if enough of its
    pixels exceed the wide limit, by the deviation that the method's `error` states, or are steeper or of another
    colour than untouched gel (`strong_evidence`), which does not depend on the deviation. Specks do not count.
    Limits: records/contact_thresholds.py.
    """
    found = np.zeros(height.depth_mm.shape, np.bool_)
    noise_mm = map_noise_mm(height)
    deep = in_question(height, noise_mm)
    places = np.flatnonzero(deep)
    if not places.size:
        return found
    box = _bounds(deep)
    sure = height.depth_mm.take(places) > _surely_mm(height, places, error=error, noise_mm=noise_mm)
    strong = None
    if np.count_nonzero(sure) < CONTACT.depth_min_px:
        strong = _strong(height, places)
        if np.count_nonzero(strong) < CONTACT.depth_min_px:
            return found  # no region can have enough of either
    count, labels = cv2.connectedComponents(deep[box].view(np.uint8), connectivity=4)
    region = labels[deep[box]]
    sizes = np.bincount(region, minlength=count)
    surely = np.bincount(region[sure], minlength=count)
    unsure = (surely < CONTACT.depth_min_px) & (sizes >= CONTACT.depth_min_px)
    if unsure.any():
        where = unsure[region]
        strong = _strong(height, places[where]) if strong is None else strong[where]
        strongly = np.bincount(region[where][strong], minlength=count)
        unsure &= strongly < np.maximum(CONTACT.strong_share * sizes, CONTACT.depth_min_px)
    sizes[unsure | (sizes < CONTACT.depth_min_px)] = 0
    for k in np.flatnonzero((sizes > 0) & (sizes >= CONTACT.depth_speck * sizes.max())):
        whole = labels == k
        inner = _bounds(whole)
        window = tuple(slice(o.start + i.start, o.start + i.stop) for o, i in zip(box, inner, strict=True))
        found[window] |= _to_its_edge(height, window, whole[inner])
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


def strong_evidence(height: HeightMap, window: Window = WHOLE, *, among: Bools | None = None) -> Bools:
    """Return the mask (h, w) of slopes or colours that untouched gel hardly has, whatever error the depth has.

    Of a `window` of the map. `among` (h, w): the pixels searched for steep ones. Empty for a map without
    information.
    """
    depth = height.depth_mm[window]
    coloured = height.colour_change is not None and height.colour_change.max() > CONTACT.strong_colour_sigma
    steep = _steep_window(depth, height.mm_per_px, among=among)
    strong = np.zeros(depth.shape, np.bool_)
    if not (coloured or steep) or _is_blind(height):
        return strong
    if steep:
        strong[steep] = _smooth_slope(depth[steep], height.mm_per_px)[1] > CONTACT.strong_slope
    if coloured and height.colour_change is not None:
        blocks = (height.colour_change > CONTACT.strong_colour_sigma).astype(np.uint8)
        size = height.depth_mm.shape[::-1]
        strong |= cv2.resize(blocks, size, interpolation=cv2.INTER_NEAREST)[window] > 0
    return strong


def _is_blind(height: HeightMap) -> bool:
    if height.std_mm is None:
        return False
    return bool(median(height.std_mm[::STD_STEP_PX, ::STD_STEP_PX].ravel()) > CONTACT.strong_blind_mm)


def _strong(height: HeightMap, places: npt.NDArray[np.intp]) -> Bools:
    """Return `strong_evidence` of some pixels (n,), by their places in the flattened map, computed around them
    alone.
    """
    among = np.zeros(height.depth_mm.shape, np.bool_)
    among.reshape(-1)[places] = True
    window = _widened(_bounds(among), among.shape)
    strong = np.zeros_like(among)
    strong[window] = strong_evidence(height, window, among=among[window])
    return strong.take(places)


def _bounds(mask: Bools) -> Window:
    """Return the smallest window that holds all pixels of a mask (h, w); empty where there are none."""
    left, top, across, down = cv2.boundingRect(mask.view(np.uint8))
    return slice(top, top + down), slice(left, left + across)


def _widened(box: Window, shape: tuple[int, ...]) -> Window:
    """Return the window of a map of this shape that holds all that enters the slopes of a box."""
    return tuple(
        slice(max(0, side.start - REACH_PX), min(size, side.stop + REACH_PX))
        for side, size in zip(box, shape, strict=True)
    )


def at_border(contact: Bools) -> bool:
    """Return whether a contact (H, W) reaches the picture's border."""
    return bool(contact[0].any() or contact[-1].any() or contact[:, 0].any() or contact[:, -1].any())


def contact_flags(contact: Bools, error: DepthError | None = None) -> tuple[str, ...]:
    """Return the flags of a `contact`, a mask (H, W) without unit, by where it lies.

    `error` is that of the map's method.
    """
    border = (BORDER,) if at_border(contact) else ()
    return (*border, BEYOND_BALLS) if error and contact.any() and error.beyond_balls(contact) else border


def _to_its_edge(height: HeightMap, window: Window, region: Bools) -> Bools:
    """Return the part of a `region` (h, w) of the map's `window` that lies behind its steepest line."""
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
    """Return the smoothed depth (h, w) mm and its slope, mm per mm."""
    smooth = cv2.GaussianBlur(np.asarray(depth_mm, np.float32), (0, 0), SMOOTH_PX)
    wide = cv2.copyMakeBorder(smooth, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    across, down = wide[1:-1, 2:] - wide[1:-1, :-2], wide[2:, 1:-1] - wide[:-2, 1:-1]
    across *= 0.5 / mm_per_px[0]
    down *= 0.5 / mm_per_px[1]
    across[:, [0, -1]] *= 2  # one-sided differences
    down[[0, -1]] *= 2
    return smooth, cv2.magnitude(across, down)


def _steep_window(depth_mm: Array, mm_per_px: Pair, *, among: Bools | None) -> Window | None:
    """Return the window of a map (h, w) in mm that holds all pixels of too steep a smooth slope.

    None if there are none. A smooth slope is a mean of pixel-to-pixel slopes within REACH_PX, so no steeper than
    the steepest of them.
    """
    depth = np.asarray(depth_mm, np.float32)
    across = cv2.norm(depth[:, 1:], depth[:, :-1], cv2.NORM_INF) / mm_per_px[0]
    down = cv2.norm(depth[1:], depth[:-1], cv2.NORM_INF) / mm_per_px[1]
    if np.hypot(across, down) <= CONTACT.strong_slope:
        return None
    if among is None:
        return WHOLE
    steps = np.zeros(depth.shape, np.uint8)  # a step in either direction of at least 1 / sqrt(2) of the limit
    limit = CONTACT.strong_slope / np.sqrt(2.0)
    steps[:, 1:] |= ~(cv2.absdiff(depth[:, 1:], depth[:, :-1]) <= np.float32(limit * mm_per_px[0]))
    steps[1:] |= ~(cv2.absdiff(depth[1:], depth[:-1]) <= np.float32(limit * mm_per_px[1]))
    near = cv2.dilate(steps, np.ones((2 * REACH_PX + 1, 2 * REACH_PX + 1), np.uint8)).view(np.bool_) & among
    return _widened(_bounds(near), depth.shape) if near.any() else None


def _surely_mm(
    height: HeightMap, places: npt.NDArray[np.intp], *, error: DepthError | None, noise_mm: float
) -> Array | float:
    """Return the depth (n,) mm that untouched gel reaches at none of the pixels at `places` (n,) of the flattened
    map in one picture of two; 0 if no deviation is known.
    """
    std_mm = untouched_std(height, error, places=places, noise_mm=noise_mm)
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
    height: HeightMap,
    error: DepthError | None,
    *,
    every: int = 1,
    places: npt.NDArray[np.intp] | None = None,
    noise_mm: float | None = None,
) -> Array | None:
    """Return the standard deviation (h, w) in mm of untouched depth, of every `every`th pixel each way.

    Only at the `places` (n,) of the flattened (h, w) where they are given, (n,). `error` is that of the method
    which made the map; None: the map's own deviation, which may itself be None. `noise_mm` of the map where it is
    known.
    """

    def wanted(grid: Array) -> Array:
        return grid if places is None else grid.take(places)

    if height.std_mm is None or error is None:
        return None if height.std_mm is None else wanted(height.std_mm[::every, ::every])
    depth, std = (np.asarray(many[::every, ::every], np.float32) for many in (height.depth_mm, height.std_mm))
    gain_square, least = map(wanted, error.in_pixels(depth.shape))
    depth, std = wanted(depth), wanted(std)
    noise_mm = map_noise_mm(height) if noise_mm is None else noise_mm
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
