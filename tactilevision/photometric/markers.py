"""Marks on the gel (printed dots, cuts): found, and filled from around, before slopes are read.

A mark is dark in every colour, whichever way the gel slopes; a shade is dark in one and bright in another. So

    d = min over colours of (closing(I) - I) / (closing(I) + s)         closing: larger than a mark

and Otsu's threshold of the untouched picture parts marks from gel. A pattern counts as marks when there are enough
of them, evenly spaced: dirt and grain are not. In a frame the same threshold finds them wherever the gel has
carried them; patches much larger than a mark (grooves of what is pressed) are left alone. They are filled by push
and pull over halved pictures: near the rim the colours beside it, deeper in those further off.
Assumes marks smaller than the closing, a nineteenth of the picture's height.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Bytes, Floats

MIN_COUNT = 12  # spots that make a pattern; fewer may be dirt that happens to lie evenly
DARK_GREY = 20  # below which a colour says nothing of marks
SOFTENING_GREY = 20  # s, grey levels: keeps the noise of dark places from passing for marks
MIN_AREA_PX = 4  # px of a spot; noise and hot pixels make smaller ones
LARGEST = 2.5  # usual areas that a mark may have: larger patches are grooves of what is pressed
FAINTEST = 0.05  # darker than the gel beside by less, noise and rounding are
LEVELS = 4  # halvings: a hole of 16 pixels is bridged

Planes = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Marks:
    """`level` (0 to 255) of darkness that parts marks from gel, their usual `area_px`, and where (H, W) uint8 they
    are on the untouched gel."""

    level: float
    area_px: float
    mask: Bytes


def find_marks(rgb: Bytes) -> Marks | None:
    """The marks of an untouched gel's picture (H, W, 3), or None where there is no pattern of them."""
    dark = _darkness(rgb)
    level, spots = cv2.threshold(dark, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    if level < 255 * FAINTEST:
        return None
    _, _, stats, centres = cv2.connectedComponentsWithStats(spots)
    area, places = stats[1:, cv2.CC_STAT_AREA].astype(float), np.asarray(centres[1:], np.float64)
    large = area >= MIN_AREA_PX
    if np.count_nonzero(large) < MIN_COUNT:
        return None
    typical_area = float(np.median(area[large]))
    alike = large & (area > typical_area / LARGEST) & (area < typical_area * LARGEST)
    if not evenly_spaced(places[alike]):
        return None
    marks = Marks(float(level), typical_area, spots)
    return Marks(float(level), typical_area, marked(rgb, marks))


def evenly_spaced(places_px: Floats) -> bool:
    """Whether spots (N, 2) lie as marks do: enough of them, the coefficient of variation of their distance to
    the next below a third (spots strewn at random have a half)."""
    from scipy.spatial import KDTree

    if len(places_px) < MIN_COUNT:
        return False
    nearest = np.asarray(KDTree(places_px).query(places_px, 2)[0])[:, 1]
    return bool(np.std(nearest) < np.mean(nearest) / 3)


def marked(rgb: Bytes, marks: Marks) -> Bytes:
    """Where (H, W) a frame shows marks, their blurred rim included: 1 there, else 0."""
    _, spots = cv2.threshold(_darkness(rgb), marks.level, 1, cv2.THRESH_BINARY)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(spots)
    area = stats[:, cv2.CC_STAT_AREA]
    kept = ((area >= MIN_AREA_PX) & (area <= LARGEST * marks.area_px)).astype(np.uint8)
    kept[0] = 0
    return np.asarray(cv2.dilate(kept[labels], np.ones((3, 3), np.uint8)))


def fill(planes: Planes, mask: Bytes) -> None:
    """Fill `planes` (C, H, W) in place where `mask` (H, W) is not 0, from what lies around."""
    share = [1.0 - mask.astype(np.float32)]
    for _ in range(LEVELS):
        share.append(cv2.pyrDown(share[-1]))
    trust = [np.maximum(s, 1e-6) for s in share]
    hole = mask > 0
    for plane in planes:
        sums = [plane * share[0]]
        for _ in range(LEVELS):
            sums.append(cv2.pyrDown(sums[-1]))
        guess = sums[-1] / trust[-1]
        for level in range(LEVELS - 1, 0, -1):
            guess = cv2.pyrUp(guess, dstsize=sums[level].shape[::-1])
            guess += sums[level] - share[level] * guess
        guess = cv2.pyrUp(guess, dstsize=plane.shape[::-1])
        np.copyto(plane, guess, where=hole)


def _darkness(rgb: Bytes) -> Bytes:
    side = 2 * (rgb.shape[0] // 38) + 1
    window = np.ones((side, side), np.uint8)
    least = np.full(rgb.shape[:2], 255, np.uint8)
    unlit = None
    for grey in cv2.split(rgb):
        around = cv2.morphologyEx(grey, cv2.MORPH_CLOSE, window)
        depth = cv2.divide(cv2.subtract(around, grey), cv2.add(around, SOFTENING_GREY), scale=255)
        dim = cv2.compare(around, DARK_GREY, cv2.CMP_LT)
        cv2.min(least, cv2.bitwise_or(depth, dim), dst=least)  # a dim colour has no say
        unlit = dim if unlit is None else cv2.bitwise_and(unlit, dim)
    assert unlit is not None
    least[unlit > 0] = 0
    return least
