"""Where depth is zero: the plane of the untouched gel, found far from the contact.

Slopes leave the mean of the surface open, and a small error common to all slopes tilts the whole of it.
The gel that nobody touches is flat and at depth 0, so

    z(x, y) = c_0 + c_x X + c_y Y + c_d exp(-d / L)      on the untouched part

is fitted there and the plane taken off everywhere. The last term is the gel's own rise (or sinking) beside
the contact, d away from it, which must not be taken for a zero: in a bonded layer of thickness h it dies out over
L = 0.75 h (from the finite-element profiles of flat punches on layers; any L near it serves, since c_d is free).
Only the untouched part is asked, so the tilt of a punch stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.middle import median
from tactilevision.records import Bools, Floats, Pair

Depth = npt.NDArray[np.floating[Any]]
DECAY_PER_THICKNESS = 0.75
USUAL_THICKNESS_MM = 3.0
LEAST_BLOCKS = 12
ROUNDS = 4


@dataclass(frozen=True, slots=True)
class ZeroPlane:
    """`offset_mm`, `tilt` (per X, Y from -1 to 1, mm).

    `std_mm` of the plane at the picture's centre; `share` untouched.
    """

    offset_mm: float
    tilt_mm: Pair
    std_mm: float
    share: float


def find_zero_plane(
    depth: Depth, untouched: Bools, mm_per_px: Pair, *, thickness_mm: float | None = None
) -> ZeroPlane:
    """The zero plane of `depth` (H, W); `untouched` (h, w) are blocks of it, a coarser picture of the same view.

    With too little untouched gel to fix a tilt the offset alone is taken, and with none at all the median, its
    uncertainty then the spread of the whole map.
    """
    size = (untouched.shape[1], untouched.shape[0])
    blocks = cv2.resize(np.asarray(depth), size, interpolation=cv2.INTER_AREA).astype(np.float64).ravel()
    outside = _outside(untouched)
    free = outside.ravel()
    if np.count_nonzero(free) < LEAST_BLOCKS:
        return ZeroPlane(float(np.median(blocks)), (0.0, 0.0), float(np.std(blocks)), float(free.mean()))
    terms = _terms(outside, depth.shape, mm_per_px, thickness_mm)[free]
    spread = terms.max(axis=0) - terms.min(axis=0)
    used = [0, *(k for k in (1, 2) if spread[k] > 1.0), *((3,) if terms[:, 3].max() > 0 else ())]
    solution, std = _robust(terms[:, used], blocks[free])
    full = np.zeros(4)
    full[used] = solution
    return ZeroPlane(float(full[0]), (float(full[1]), float(full[2])), std, float(free.mean()))


def level(depth: Depth, zero: ZeroPlane) -> None:
    """Take the plane off `depth` (H, W), in place."""
    height, width = depth.shape
    x = np.linspace(-1, 1, width) * zero.tilt_mm[0] + zero.offset_mm
    y = np.linspace(-1, 1, height) * zero.tilt_mm[1]
    depth -= x.astype(depth.dtype)[None, :]
    depth -= y.astype(depth.dtype)[:, None]


def _centres(blocks: int, pixels: int) -> Floats:
    """Places (blocks,) of the middles of `blocks` that divide a line of `pixels`, whose ends are at -1 and 1."""
    return np.asarray((2.0 * (np.arange(blocks) + 0.5) * pixels / blocks - pixels) / (pixels - 1))


def _outside(untouched: Bools) -> Bools:
    """The untouched blocks round all contacts; a flat face, whose slopes are none, only looks untouched.

    All of it that hangs together with the largest piece of it at the picture's border.
    """
    count, labels = cv2.connectedComponents(untouched.astype(np.uint8), connectivity=4)
    border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    size = np.bincount(labels.ravel(), minlength=count) * (np.bincount(border, minlength=count) > 0)
    size[0] = 0
    return np.asarray(labels == size.argmax()) if size.any() else np.zeros_like(untouched)


def _terms(untouched: Bools, shape: tuple[int, ...], mm_per_px: Pair, thickness_mm: float | None) -> Floats:
    """Columns 1, X, Y, exp(-d / L) over the blocks; the last is 0 where nothing is touched."""
    rows, columns = untouched.shape
    x, y = np.meshgrid(_centres(columns, shape[1]), _centres(rows, shape[0]))
    beside = np.zeros((rows, columns))
    if not untouched.all():
        block_mm = 0.5 * (shape[1] * mm_per_px[0] / columns + shape[0] * mm_per_px[1] / rows)
        distance = cv2.distanceTransform(untouched.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * block_mm
        beside = np.exp(-distance / (DECAY_PER_THICKNESS * (thickness_mm or USUAL_THICKNESS_MM)))
    return np.stack([np.ones_like(x), x, y, beside], axis=-1).reshape(-1, 4)


def _robust(terms: Floats, depth: Floats) -> tuple[Floats, float]:
    """Reweighted least squares; the coefficients, and the standard deviation of the plane at the centre."""
    weights = np.ones(len(depth))
    stiffening = 1.0 + 1e-9 * np.eye(terms.shape[1])
    for _ in range(ROUNDS):
        heavy = terms.T * weights
        normal = (heavy @ terms) * stiffening
        solution = np.linalg.solve(normal, heavy @ depth)
        left = depth - terms @ solution
        scale = 1.4826 * float(median(np.abs(left))) + 1e-12
        weights = 1.0 / np.square(1.0 + np.square(left / (3.0 * scale)))
    # errors of integrated slopes hang together over about a tenth of the picture: count that few as independent
    independent = max(1.0, len(depth) / 50.0)
    inflation = len(depth) / independent
    return np.asarray(solution, np.float64), float(scale * np.sqrt(inflation * np.linalg.inv(normal)[0, 0]))
