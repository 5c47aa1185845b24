"""Find marks on the gel (printed dots, cuts), and fill them from around before slopes are computed.

A mark is dark in every colour, whichever way the gel slopes; a shaded slope is dark in one and bright in another.
So

    d = min over colours of (closing(I) - I) / (closing(I) + s)         closing: larger than a mark

and Otsu's threshold of the untouched picture separates marks from gel, if there are enough of them, evenly spaced.
In a frame the same threshold finds them wherever the gel has carried them; patches much larger than a mark
(grooves of an object) do not count. Each mark is filled by the quadratic in x and y fitted to the gel around it
with Gaussian weights, so that slopes continue through it. Larger holes are filled by local means, by push-pull
over halved pictures. Assumes marks smaller than the closing, a nineteenth of the height of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bytes, Floats, Picture

MIN_COUNT = 12  # spots that make a pattern
DARK_GREY = 20  # below which a colour does not count
SOFTENING_GREY = 20  # s, grey levels: limits the noise of dark places
MIN_AREA_PX = 4  # px of a spot; noise and hot pixels make smaller ones
LARGEST = 2.5  # typical areas of a mark at most: larger patches are grooves of an object
FAINTEST = 0.05  # relative darkness of a mark at least
LEVELS = 4  # halvings: a hole of 16 pixels is bridged
USUAL_PERCENT = 90  # percentile of mark widths for the window of the quadratic
MARGIN_PX = 5  # px of gel around a mark that its quadratic is fitted to
EVERY_PX = 2  # px between fitted pixels: all of them are no better and cost 1 ms
RIDGE = 1e-4  # of the sum of weights, added to the normal equations, for marks at the border
MIN_GEL_PX = 12  # fitted px of gel, two for each coefficient
TERMS = 6  # coefficients of a quadratic in x and y

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Marks:
    """Threshold `level` (0 to 255) of darkness, typical `area_px`, `mask` (H, W) uint8 on the untouched gel."""

    level: float
    area_px: float
    mask: Bytes


def find_marks(rgb: Bytes) -> Marks | None:
    """Return the marks in a picture (H, W, 3) of the untouched gel, or None without a pattern."""
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
    """Return whether there are MIN_COUNT spots (N, 2) or more, evenly spaced.

    The coefficient of variation of their nearest distance is below a third; that of random spots is a half.
    """
    from scipy.spatial import KDTree

    if len(places_px) < MIN_COUNT:
        return False
    nearest = np.asarray(KDTree(places_px).query(places_px, 2)[0])[:, 1]
    return bool(np.std(nearest) < np.mean(nearest) / 3)


def marked(rgb: Bytes, marks: Marks) -> Bytes:
    """Return the mask (H, W), 1 or 0, of marks in a frame, including their blurred rim."""
    _, spots = cv2.threshold(_darkness(rgb), marks.level, 1, cv2.THRESH_BINARY)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(spots)
    area = stats[:, cv2.CC_STAT_AREA]
    kept = ((area >= MIN_AREA_PX) & (area <= LARGEST * marks.area_px)).astype(np.uint8)
    kept[0] = 0
    return np.asarray(cv2.dilate(kept[labels], np.ones((3, 3), np.uint8)))


def fill(planes: Picture, mask: Bytes) -> None:
    """Fill `planes` (C, H, W) in place where `mask` (H, W) is not 0, by means of their surroundings."""
    share = [1.0 - mask.astype(np.float32)]
    for _ in range(LEVELS):
        share.append(cv2.pyrDown(share[-1]))
    trust = [np.maximum(s, TINY) for s in share]
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


def fill_marks(planes: Picture, mask: Bytes) -> None:
    """Fill `planes` (C, H, W) in place at marks in `mask` (H, W), by quadratics."""
    count, labels, stats, centres = cv2.connectedComponentsWithStatsWithAlgorithm(
        mask, 8, cv2.CV_16U, cv2.CCL_DEFAULT
    )
    if count < 2:
        return
    width = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    half = int(np.percentile(width[1:], USUAL_PERCENT)) // 2 + MARGIN_PX
    x, y = np.rint(centres).astype(np.intp).T
    gel = _around(np.asarray(1 - mask, np.float32), x, y, half)
    fitted = (width < 2 * half) & (gel.sum(axis=1) > MIN_GEL_PX)
    fitted[0] = True  # the gel itself, which is not filled
    hole = mask.view(np.bool_)
    if not fitted.all():
        fill(planes, mask)
        hole = fitted[labels] & hole
    rows, columns = np.nonzero(hole)
    mark, side = labels[rows, columns].astype(np.intp), 2 * half + 1
    at = (mark * side + rows - y[mark] + half) * side + columns - x[mark] + half
    surfaces = _quadratics([_around(plane, x, y, half) for plane in planes], gel, half)
    for plane, surface in zip(planes, surfaces, strict=True):
        plane[rows, columns] = surface.ravel().take(at)


def _around(plane: Picture, x: Indices, y: Indices, half: int) -> Picture:
    """Return every EVERY_PX-th pixel (N, n) of `plane` (H, W) in windows about x, y (N,); 0 beyond the border."""
    padded = cv2.copyMakeBorder(plane, half, half, half, half, cv2.BORDER_CONSTANT, value=0)
    windows = sliding_window_view(padded, (2 * half + 1, 2 * half + 1))
    return np.asarray(windows[y, x, ::EVERY_PX, ::EVERY_PX].reshape(len(x), -1))


def _quadratics(values: list[Picture], gel: Picture, half: int) -> list[Picture]:
    """Return the quadratics (N, side * side) fitted to each of `values` (N, n) where `gel` (N, n) is 1."""
    basis, weighted, products = _window(half)
    first, second = np.triu_indices(TERMS)
    normal = np.empty((len(gel), TERMS, TERMS), np.float32)
    normal[:, first, second] = normal[:, second, first] = gel @ products
    normal[:, range(TERMS), range(TERMS)] += RIDGE * (1.0 + normal[:, :1, 0])
    known = np.stack([(plane * gel) @ weighted for plane in values], axis=2)
    terms = np.linalg.solve(normal, known)
    return [np.asarray(np.ascontiguousarray(terms[:, :, number]) @ basis) for number in range(len(values))]


@lru_cache(4)
def _window(half: int) -> tuple[Picture, Picture, Picture]:
    """Return terms (6, side * side) in a window; weighted terms (n, 6), products (n, 21) at fitted pixels."""
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
        cv2.min(least, cv2.bitwise_or(depth, dim), dst=least)  # a dim colour does not count
        unlit = dim if unlit is None else cv2.bitwise_and(unlit, dim)
    assert unlit is not None
    least[unlit > 0] = 0
    return least
