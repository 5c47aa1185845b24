"""Integrate coarse slopes with fine windows to a surface on two grids.

The coarse slopes, in a window the means of its fine ones, are integrated on their own grid (`poisson.py`), and the
surface z is interpolated linearly to the single pixels. The residual of a window's fine equations,

    L e = div (p, q) - L z      e = 0 on the window's rim; no flux across the picture's border

(L: 5-point Laplacian) is solved by products with L's eigenvectors along either axis: at the size of a window as
fast as transforms. Between equal ends they are even and odd alternately, so that half of each is sufficient. Means
of a gradient are the gradient of means, so that a step has equal height on both grids, and e is small and local:
the depth of contacts is within .1 um of that of one solution.
Assumes gentle slopes at the rims of windows, as `multiresolution.py` cuts them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.poisson import edge_divergence, integrate, transform_solver
from tactilevision.photometric.colour_change import Planes
from tactilevision.photometric.windows import Window
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Floats, Pair

LARGE = 10000  # points, above which a coarse grid is solved by transforms: not faster on smaller ones
FOLDED = 120  # points, from which half waves are faster than whole ones

Picture = npt.NDArray[np.float32]
Halves = tuple[Picture, Picture | None]  # even and odd waves on the first half of a line; or whole waves
Ends = tuple[bool, bool]  # whether the first and last of a line are free (no flux) or fixed (0 a step beyond)


class TwoGridPoisson:
    """Integrates for one size (H, W) of picture, means of `px` by `px` pixels and scale.

    `coarse_mm` (x, y) is the step of the coarse grid (H // px, W // px).
    """

    def __init__(self, shape: tuple[int, int], px: int, mm_per_px: Pair) -> None:
        self.shape, self.px, self.mm_per_px = shape, px, mm_per_px
        self.size = shape[0] // px, shape[1] // px
        self.coarse_mm = px * mm_per_px[0], px * mm_per_px[1]
        along_x, along_y = (1.0 / step**2 for step in mm_per_px)
        self.half = np.array([0.5 / step for step in mm_per_px], np.float32)
        self.bend = np.array([[0, along_y, 0], [along_x, -2 * (along_x + along_y), along_x], [0, along_y, 0]])

    def coarse(self, slopes: Planes, windows: Sequence[Window], *, fine: Sequence[Planes]) -> Picture:
        """Return depth (h, w), mean 0, of slopes (2, h, w) and of fine ones (2, rows, columns) for each window."""
        slopes = slopes.copy()
        for (rows, columns), inside in zip(windows, fine, strict=True):
            top, left = rows.start // self.px, columns.start // self.px
            down, across = min(rows.stop // self.px, self.size[0]), min(columns.stop // self.px, self.size[1])
            size = across - left, down - top
            for plane, part in zip(slopes, inside, strict=True):
                cut = part[: size[1] * self.px, : size[0] * self.px]
                plane[top:down, left:across] = cv2.resize(cut, size, interpolation=cv2.INTER_AREA)
        return integrate_small(slopes, self.coarse_mm)

    def whole(
        self, coarse: Picture, windows: Sequence[Window], *, fine: Sequence[Planes], tilt: Pair = (0.0, 0.0)
    ) -> Picture:
        """Return depth (H, W) from a coarse one, reduced by a plane of slope `tilt`, and the windows' slopes."""
        depth: Picture = np.empty(self.shape, np.float32)
        down, across = (self.px * count for count in self.size)
        cv2.resize(coarse, (across, down), dst=depth[:down, :across], interpolation=cv2.INTER_LINEAR)
        _extrapolate(depth[:, :across], down, self.px // 2)
        _extrapolate(depth.T, across, self.px // 2)
        for window, slopes in zip(windows, fine, strict=True):
            self._refine(depth, window, slopes, tilt)
        return depth

    def _refine(self, depth: Picture, window: Window, slopes: Planes, tilt: Pair) -> None:
        """Write the surface of a window's slopes, minus those of a plane, into `depth`, in place."""
        p, q = (plane - np.float32(lean) for plane, lean in zip(slopes, tilt, strict=True))
        ends = [(along.start == 0, along.stop == count) for along, count in zip(window, self.shape, strict=True)]
        z = depth[window]
        if all(side for sides in ends for side in sides):
            z[...] = integrate(SlopeMap(p, q), self.mm_per_px) + z.mean()
            return
        residual = edge_divergence(p, q, half=self.half)
        residual -= cv2.filter2D(z, cv2.CV_32F, self.bend, borderType=cv2.BORDER_REPLICATE)
        rows, columns = (slice(0 if low else 1, None if high else -1) for low, high in ends)
        z[rows, columns] += _solved(residual[rows, columns], self.mm_per_px, (ends[0], ends[1]))


def integrate_small(slopes: Planes, step_mm: Pair) -> Picture:
    """Return depth (h, w) in mm, mean 0, of slopes (2, h, w) on a grid of steps (x, y) in mm: as
    `poisson.integrate`.

    Faster than that on small grids.
    """
    right = edge_divergence(slopes[0], slopes[1], half=np.array([0.5 / step for step in step_mm], np.float32))
    if right.size > LARGE:
        return np.asarray(transform_solver(right.shape, step_mm, "f").solve(right))
    return _solved(right, step_mm, ((True, True), (True, True)))


def _solved(right: Picture, step_mm: Pair, free: tuple[Ends, Ends]) -> Picture:
    """Return the surface (h, w) with 5-point Laplacian `right`, ends along y and x as `free`; else mean 0."""
    down, _ = _waves(right.shape[0], free[0])
    across, _ = _waves(right.shape[1], free[1])
    modes = _of_modes(_to_modes(_to_modes(right, down), across) * _inverse(right.shape, step_mm, free), across)
    return _of_modes(modes, down)


def _to_modes(values: Picture, halves: Halves) -> Picture:
    """Return even modes (w, n) of values (n, w) along their first axis, then odd ones."""
    even, odd = halves
    if odd is None:
        return np.asarray(values.T @ even)
    out = np.empty(values.T.shape, values.dtype)
    first, second = values[: len(odd)], values[: -len(odd) - 1 : -1]
    total = values[: len(even)].copy()
    total[: len(odd)] += second
    np.matmul(total.T, even, out=out[:, : len(even)])
    np.matmul((first - second).T, odd, out=out[:, len(even) :])
    return out


def _of_modes(modes: Picture, halves: Halves) -> Picture:
    """Return the values (n, w) of even modes (w, n), then odd ones."""
    even, odd = halves
    if odd is None:
        return np.asarray(even @ modes.T)
    out, half = np.empty(modes.T.shape, modes.dtype), len(odd)
    total, difference = even @ modes[:, : len(even)].T, odd @ modes[:, len(even) :].T
    np.subtract(total[:half], difference, out=out[: -half - 1 : -1])
    out[: len(even)] = total
    out[:half] += difference
    return out


@lru_cache(maxsize=32)
def _inverse(shape: tuple[int, int], step_mm: Pair, free: tuple[Ends, Ends]) -> Picture:
    """Return 1 over the eigenvalues (h, w) of the Laplacian, 0 for the zero one."""
    bend_y, bend_x = (_waves(count, ends)[1] for count, ends in zip(shape, free, strict=True))
    bend = (bend_y / step_mm[1] ** 2)[:, None] + (bend_x / step_mm[0] ** 2)[None, :]
    return np.asarray(-1.0 / np.where(bend > 0.0, bend, np.inf), np.float32)


def _extrapolate(lines: Picture, known: int, clamped: int) -> None:
    """Extrapolate the rows linearly, in place, beyond `known` and where the coarse grid ends (`clamped`)."""
    steps = np.arange(1, len(lines) - known + clamped + 1, dtype=np.float32)[:, None]
    first, last = lines[clamped], lines[known - clamped - 1]
    lines[:clamped] = first + steps[:clamped][::-1] * (first - lines[clamped + 1])
    lines[known - clamped :] = last + steps * (last - lines[known - clamped - 2])


@lru_cache(maxsize=32)
def _waves(count: int, free: Ends) -> tuple[Halves, Floats]:
    """Return eigenvectors (columns) and eigenvalues (count,) of minus the second difference, even first."""
    i, k = np.arange(count)[:, None], np.arange(count)[None, :]
    fixed = 1.0 - 0.5 * sum(free)
    angle = np.pi * (k + fixed) / (count + fixed)
    waves = np.cos(angle * (i + 0.5)) if free[0] else np.sin(angle * (i + 1))
    values = 2.0 - 2.0 * np.cos(angle[0])
    waves = np.asarray(waves / np.sqrt(np.sum(waves**2, axis=0)), np.float32)
    if free[0] != free[1] or count < FOLDED:
        return (np.ascontiguousarray(waves), None), values
    even, odd = waves[: count - count // 2, ::2], waves[: count // 2, 1::2]  # waves are even and odd alternately
    return (np.ascontiguousarray(even), np.ascontiguousarray(odd)), np.concatenate([values[::2], values[1::2]])
