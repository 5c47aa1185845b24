"""Marks on the gel (printed dots, cuts): found, and filled from around, before slopes are read.

A mark is dark in every colour, whichever way the gel slopes; a shade is dark in one and bright in another. So

    d = min over colours of (closing(I) - I) / (closing(I) + s)         closing: larger than a mark

and Otsu's threshold of the untouched picture parts marks from gel. A pattern counts as marks when there are enough
of them, evenly spaced: dirt and grain are not. In a frame the same threshold finds them wherever the gel has
carried them; patches much larger than a mark (grooves of what is pressed) are left alone.
Each mark is filled by the quadratic in x and y that fits the gel round it best, weighed by a Gaussian of the
distance from its centre, so that a dent's slopes go on through it. A mean of what lies round flattens dents.
Larger holes are filled by such means, push and pull over halved pictures: near the rim the colours beside it,
deeper in those further off.
Assumes marks smaller than the closing, a nineteenth of the picture's height.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from tactilevision.records.measured import Bytes, Floats

MIN_COUNT = 12  # spots that make a pattern; fewer may be dirt that happens to lie evenly
DARK_GREY = 20  # below which a colour says nothing of marks
SOFTENING_GREY = 20  # s, grey levels: keeps the noise of dark places from passing for marks
MIN_AREA_PX = 4  # px of a spot; noise and hot pixels make smaller ones
LARGEST = 2.5  # usual areas that a mark may have: larger patches are grooves of what is pressed
FAINTEST = 0.05  # darker than the gel beside by less, noise and rounding are
LEVELS = 4  # halvings: a hole of 16 pixels is bridged
USUAL_PERCENT = 90  # percent of the marks for which the window of the quadratic is wide enough with its margin
MARGIN_PX = 5  # px of gel beside a mark that its quadratic is fitted to, as on three real sets
EVERY_PX = 2  # px between those that are fitted: all of them tell real dents no better and cost 1 ms
RIDGE = 1e-4  # of the sum of weights, added to the normal equations: marks at the border lack a side
MIN_GEL_PX = 12.0  # px of gel that are fitted, two for each coefficient: fewer tell no quadratic
TERMS = 6  # coefficients of a quadratic in x and y, which is no judgement

Indices = npt.NDArray[np.intp]
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


def fill_marks(planes: Planes, mask: Bytes) -> None:
    """Fill `planes` (C, H, W) in place where `mask` (H, W) shows marks: slopes go on through them."""
    count, labels, stats, centres = cv2.connectedComponentsWithStatsWithAlgorithm(
        mask, 8, cv2.CV_16U, cv2.CCL_DEFAULT
    )
    if count < 2:
        return
    width = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    half = int(np.percentile(width[1:], USUAL_PERCENT)) // 2 + MARGIN_PX
    x, y = np.rint(centres).astype(np.intp).T
    gel = _around(np.asarray(1 - mask, np.float32), x, y, half)
    told = (width < 2 * half) & (gel.sum(axis=1) > MIN_GEL_PX)
    told[0] = True  # the gel itself, which is not filled
    hole = mask.view(np.bool_)
    if not told.all():
        fill(planes, mask)
        hole = told[labels] & hole
    rows, columns = np.nonzero(hole)
    mark, side = labels[rows, columns].astype(np.intp), 2 * half + 1
    at = (mark * side + rows - y[mark] + half) * side + columns - x[mark] + half
    surfaces = _quadratics([_around(plane, x, y, half) for plane in planes], gel, half)
    for plane, surface in zip(planes, surfaces, strict=True):
        plane[rows, columns] = surface.ravel().take(at)


def _around(plane: Planes, x: Indices, y: Indices, half: int) -> Planes:
    """Every EVERY_PX-th pixel (N, n) of `plane` (H, W) in windows about places x, y (N,); 0 beyond the border."""
    padded = cv2.copyMakeBorder(plane, half, half, half, half, cv2.BORDER_CONSTANT, value=0)
    windows = sliding_window_view(padded, (2 * half + 1, 2 * half + 1))
    return np.asarray(windows[y, x, ::EVERY_PX, ::EVERY_PX].reshape(len(x), -1))


def _quadratics(values: list[Planes], gel: Planes, half: int) -> list[Planes]:
    """The quadratics (N, side * side) that fit each of `values` (N, n) best where `gel` (N, n) is 1."""
    basis, weighted, products = _window(half)
    first, second = np.triu_indices(TERMS)
    normal = np.empty((len(gel), TERMS, TERMS), np.float32)
    normal[:, first, second] = normal[:, second, first] = gel @ products
    normal[:, range(TERMS), range(TERMS)] += RIDGE * (1.0 + normal[:, :1, 0])
    known = np.stack([(one * gel) @ weighted for one in values], axis=2)
    found = np.linalg.solve(normal, known)
    return [np.asarray(np.ascontiguousarray(found[:, :, number]) @ basis) for number in range(len(values))]


@lru_cache(4)
def _window(half: int) -> tuple[Planes, Planes, Planes]:
    """A quadratic's terms (6, side * side) in a window; these (n, 6) and their products (n, 21), weighed, where it
    is fitted."""
    y, x = np.indices((2 * half + 1, 2 * half + 1)) / half - 1.0
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    fitted = terms[:, ::EVERY_PX, ::EVERY_PX].reshape(TERMS, -1)
    weighted = fitted * np.exp(-0.5 * (fitted[3] + fitted[5]))
    first, second = np.triu_indices(TERMS)
    tables = terms.reshape(TERMS, -1), weighted.T, (weighted[first] * fitted[second]).T
    basis, at, products = (np.ascontiguousarray(table, np.float32) for table in tables)
    return basis, at, products


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
