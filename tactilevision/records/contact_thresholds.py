"""Detection limits of a contact in each quantity: colour, slope, depth, live depth, force and cells.

Each of these is tested before the next quantity exists, so there are six limits, each in its own unit:

    colour      r^2    > (4 s)^2                     blocks, normalised by their noise; s the picture's own scale
    slope       |g|    > 4 median |g| + .001         blocks, without a reference for the colours
    depth       d      > max(5 s_rough, .01 mm)      regions, of which MIN_PX must pass the wide limit too,
                                                     or a few in a hundred the limit of strong slope
                                                     or strong colour
    live        d      > 5 s                         pixels, s of untouched gel
    reading     F      > max(5 s, .03 F_top)         readings of one press, tared
    cell        d      > max(3 s, .03 d_top)         cells of the force map; a patch's deepest must pass 5 s

At each multiple false contacts are rarer than one in a run, for the number of places tested.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records.measured import Array, Floats


@dataclass(frozen=True, slots=True)
class ContactThresholds:
    """The thresholds; `CONTACT` holds those in use."""

    colour_sigma: float = 4  # standard deviations of a block's colour; benchmarks.light_drift
    slope_medians: float = 4  # medians of the blocks' slopes
    slope_floor: float = 1e-3  # mm/mm: rounding in a perfectly flat map
    depth_sigma: float = 5  # standard deviations of a map's shallower half; tests/contact/test_region.py
    depth_min_mm: float = 0.01  # mm: the size of a drifting zero
    depth_wave_mm: float = 1.0  # mm: correlation length of depth errors, which are integrated noise
    depth_min_px: int = 16  # pixels beyond the wide limit: a map's outermost are noisier than it states
    depth_std_share: float = 0.3  # relative uncertainty of a standard deviation from a few free frames
    depth_speck: float = 0.1  # of the largest region's area: smaller regions are specks
    depth_top_share: float = 0.5  # of the deepest: bounds the roughness where a contact fills half of the map
    strong_slope: float = 0.15  # mm/mm: outside 182 real contacts .12 at most, in the shallowest .19
    strong_colour_sigma: float = 80  # standard deviations of a block: outside contacts 53 at most, inside 127
    strong_share: float = 0.03  # of a region that must be so steep or so coloured; less may be a speck in it
    strong_blind_mm: float = 0.25  # mm: median deviation of a map without information; half black it is .36
    live_sigma: float = 5  # standard deviations of untouched gel; benchmarks.stream
    live_min_px: int = 20  # pixels that reach it: fewer are noise
    live_unknown_std_mm: float = 0.02  # mm: deviation of a map that states none
    live_blind_mm: float = 0.5  # mm: limit beyond which a picture may hide a contact and is not untouched gel
    reading_sigma: float = 5  # standard deviations of one reading: one false reading in three million
    reading_share: float = 0.03  # of the press's top: less may be a drifting zero
    reading_top_sigma: float = 10  # standard deviations that the top of a press must reach
    cell_sigma: float = 3  # standard deviations of a cell's depth: candidates, which the solution narrows
    cell_share: float = 0.03  # of the deepest cell: a contact's edge is at least a third as deep (Hertz: a half)
    cell_neighbours: int = 3  # cells out of 3 x 3, itself included: an isolated deep cell is noise
    patch_sigma: float = 5  # standard deviations of a patch's deepest cell: by chance once in thousands of frames


CONTACT = ContactThresholds()


def slope_limit(median_slope: float) -> float:
    """Return the slope of a block (mm/mm) beyond which it is touched, from the median over all blocks."""
    return CONTACT.slope_medians * median_slope + CONTACT.slope_floor


def depth_limit_mm(roughness_mm: float, top_mm: float) -> float:
    """Return the depth (mm) beyond which a region is in question, from the deviation of the map's shallower half.

    No more than half of the deepest, `top_mm`.
    """
    rough_mm = min(CONTACT.depth_sigma * roughness_mm, CONTACT.depth_top_share * top_mm)
    return max(rough_mm, CONTACT.depth_min_mm)


def wide_depth_limit_mm(std_mm: Array, area_mm2: float) -> Array:
    """Return the depth (H, W) mm that untouched gel of deviation `std_mm` (H, W) reaches nowhere in one picture of
    two.

    The largest of N normal numbers is about sqrt(2 ln N) standard deviations, N the number of patches of
    `depth_wave_mm` in the picture. `depth_std_share` is added, the relative uncertainty of the deviations.
    """
    patches = area_mm2 / CONTACT.depth_wave_mm**2
    return np.asarray((1.0 + CONTACT.depth_std_share) * np.sqrt(2.0 * np.log(max(patches, np.e))) * std_mm)


def live_limit_mm(std_mm: Array) -> Array:
    """Return the depth (H, W) mm beyond which a pixel of the stream is pressed, from that of untouched gel (H, W)
    mm.
    """
    return CONTACT.live_sigma * std_mm


def reading_limit(noise: float, top: float) -> float:
    """Return the reading beyond which the indenter touches, in the unit of its `noise` and of the press's
    `top`.
    """
    return max(CONTACT.reading_sigma * noise, CONTACT.reading_share * top)


def cell_limit_mm(std_mm: Floats, deepest_mm: float) -> Floats:
    """Return the depth (rows, columns) mm beyond which a cell may carry force, from its deviation (rows, columns)
    mm.
    """
    return np.asarray(np.maximum(CONTACT.cell_sigma * std_mm, CONTACT.cell_share * deepest_mm))
