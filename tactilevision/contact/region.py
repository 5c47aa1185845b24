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

from tactilevision.records import Bools, HeightMap
from tactilevision.records.contact_thresholds import CONTACT, depth_limit_mm, wide_depth_limit_mm
from tactilevision.uncertainty.depth import DepthError
from tactilevision.uncertainty.untouched_noise import map_noise_mm, untouched_std

STEEPEST = 0.9  # of the greatest mean slope: where the edge is; tests/contact/test_region.py
LEVELS = 20  # of depth, between the shallowest and the deepest of a region
SMOOTH_PX = 1.0  # px: sigma of the blur before slopes are taken
SAMPLED = 4  # pixels along each side, of which one tells how much is known of a map
MIN_SLOPE_PX = 3  # pixels, too few to tell a slope

Array = npt.NDArray[np.floating[Any]]


def find_contact(height: HeightMap, error: DepthError | None = None) -> Bools:
    """Mask (H, W) of where something presses.

    A region is deeper than the limit of depth. Slow waves of untouched gel go as deep over wide areas. So it
    counts where enough pixels of it pass the wide limit, by the `error` of the method that made the map. That
    widens with the stated deviation; slopes and colours do not, and a region counts, too, where enough of it is
    steeper, or of another colour, than untouched gel is (`strong_evidence`). Specks do not count. Limits:
    records/contact_thresholds.py.
    """
    found = np.zeros(height.depth_mm.shape, np.bool_)
    deep = in_question(height)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(deep.view(np.uint8), connectivity=4)
    sizes = stats[:, cv2.CC_STAT_AREA]
    surely = np.bincount(labels[deep & (height.depth_mm > _surely_mm(height, error))], minlength=len(sizes))
    unsure = (surely < CONTACT.depth_min_px) & (sizes >= CONTACT.depth_min_px)
    if unsure[1:].any():
        strong = np.bincount(labels[deep & strong_evidence(height)], minlength=len(sizes))
        unsure &= strong < np.maximum(CONTACT.strong_share * sizes, CONTACT.depth_min_px)
    sizes[unsure | (sizes < CONTACT.depth_min_px)] = 0
    sizes[0] = 0
    for k in np.flatnonzero((sizes > 0) & (sizes >= CONTACT.depth_speck * sizes.max())):
        left, top, across, down = stats[k, :4]
        window = slice(top, top + down), slice(left, left + across)
        found[window] |= _to_its_edge(height, window, labels[window] == k)
    return found


def in_question(height: HeightMap) -> Bools:
    """Mask (H, W) of what is deeper than the map is rough."""
    if not height.valid.any():
        return height.valid
    limit_mm = depth_limit_mm(map_noise_mm(height), float(height.depth_mm[height.valid].max()))
    return np.asarray(height.valid & (height.depth_mm > limit_mm))


def strong_evidence(height: HeightMap) -> Bools:
    """Mask (H, W) of where slope or colour are such as untouched gel hardly has them, whatever depth may be off.

    Empty for a map of which next to nothing is known: its slopes tell nothing either.
    """
    if height.std_mm is not None and np.median(height.std_mm[::SAMPLED, ::SAMPLED]) > CONTACT.strong_blind_mm:
        return np.zeros(height.depth_mm.shape, np.bool_)
    smooth = cv2.GaussianBlur(np.asarray(height.depth_mm, np.float32), (0, 0), SMOOTH_PX)
    down, across = np.gradient(smooth, height.mm_per_px[1], height.mm_per_px[0])
    strong = np.hypot(across, down) > CONTACT.strong_slope
    if height.colour_change is not None:
        coloured = (height.colour_change > CONTACT.strong_colour_sigma).astype(np.uint8)
        strong |= cv2.resize(coloured, strong.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    return np.asarray(strong)


def at_border(contact: Bools) -> bool:
    """Whether a contact (H, W) reaches the picture's border."""
    return bool(contact[0].any() or contact[-1].any() or contact[:, 0].any() or contact[:, -1].any())


def _to_its_edge(height: HeightMap, window: tuple[slice, slice], region: Bools) -> Bools:
    """The part of a `region` (h, w) of the map's `window` that lies behind its steepest line."""
    if min(region.shape) < MIN_SLOPE_PX:
        return region
    smooth = cv2.GaussianBlur(np.asarray(height.depth_mm[window], np.float32), (0, 0), SMOOTH_PX)
    down, across = np.gradient(smooth, height.mm_per_px[1], height.mm_per_px[0])
    depth, slope = smooth[region], np.hypot(across, down)[region]
    least, most = float(depth.min()), float(depth.max())
    step = (most - least) / LEVELS
    if step <= 0:
        return region
    level = np.minimum(((depth - least) / step).astype(int), LEVELS - 1)
    count = np.bincount(level, minlength=LEVELS)
    mean = np.where(count >= MIN_SLOPE_PX, np.bincount(level, slope, LEVELS) / np.maximum(count, 1), 0.0)
    edge = least + step * (float(np.argmax(mean >= STEEPEST * mean.max())) + 0.5)
    return np.asarray(region & (smooth > edge))


def _surely_mm(height: HeightMap, error: DepthError | None) -> Array | float:
    """Depth (H, W) mm that untouched gel reaches nowhere in one picture of two; 0 where no deviation is known."""
    std_mm = untouched_std(height, error)
    if std_mm is None:
        return 0.0
    return wide_depth_limit_mm(std_mm, height.depth_mm.size * height.mm_per_px[0] * height.mm_per_px[1])
