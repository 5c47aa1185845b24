"""The unweighted normal equations of `poisson.py`, solved by one pair of cosine transforms.

The cosine transform of type II diagonalises the 5-point Laplacian with natural borders, with the eigenvalues
(2 - 2 cos(pi k/N))/d^2, k = 0 .. N-1, per axis. It is quick where N has small factors alone. Where one axis has
not (427 = 7 * 61), the picture is continued along it by empty columns to a length M that has. What then flows
over the old border is taken back, for each mode k of the other axis, by the solution that grows towards it:

    z(x) += G_k(x) sum_(x' >= N) z(x')      G_k(x) = 2 sinh(t/2) cosh(t (x + 1/2)) / sinh(t N)
    sinh(t/2) = (d_along/d_across) sin(pi k / (2 N_across))

which solves the same equations with nothing on the right, and whose flow is that sum's. So the result is that of
the picture alone, to rounding error, at any size.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.records import Floats, Pair

Array = npt.NDArray[np.floating[Any]]
MAX_FACTOR = 11  # the greatest prime factor that the transform has code of its own for


class TransformSolver:
    """Solves the unweighted normal equations for one size, scale and precision; tables are made once."""

    def __init__(self, shape: tuple[int, int], mm_per_px: Pair, dtype: npt.DTypeLike) -> None:
        self.shape, self.dtype = shape, np.dtype(dtype)
        self.half = np.array([0.5 / mm_per_px[0], 0.5 / mm_per_px[1]], self.dtype)
        self.axis, length = _continued(shape)
        sizes = [shape[0], shape[1]]
        sizes[self.axis] = length
        self.inverse = np.asarray(inverse_eigenvalues((sizes[0], sizes[1]), mm_per_px), dtype=self.dtype)
        self.growing: Array | None = None
        if length > shape[self.axis]:
            across = 1 - self.axis
            ratio = mm_per_px[across] / mm_per_px[self.axis]  # mm_per_px is (x, y), axes are (y, x)
            growing = _growing(shape[self.axis], shape[across], ratio)
            self.growing = np.asarray(growing.T if self.axis == 0 else growing, dtype=self.dtype, order="C")
            self.inside = (slice(None, shape[0]), slice(None, shape[1]))
            beyond = slice(shape[self.axis], None)
            self.beyond = (beyond, slice(None)) if self.axis == 0 else (slice(None), beyond)

    def divergence(self, dz_dx: Array, dz_dy: Array) -> Array:
        """Divergence (H, W) of slopes averaged onto the edges, (H, W) each."""
        return edge_divergence(dz_dx, dz_dy, half=self.half)

    def solve(self, right: Array) -> Array:
        """Depth (H, W) of mean 0 whose 5-point Laplacian is `right`, which sums to 0."""
        right = np.asarray(right, dtype=self.dtype)
        if self.growing is None:
            modes = fft.dctn(right, norm="ortho", overwrite_x=False)
            modes *= self.inverse
            return np.asarray(fft.idctn(modes, norm="ortho", overwrite_x=True))
        across = 1 - self.axis
        modes = np.zeros(self.inverse.shape, self.dtype)
        modes[self.inside] = fft.dct(right, axis=across, norm="ortho")
        modes = fft.dct(modes, axis=self.axis, norm="ortho", overwrite_x=True)
        modes *= self.inverse
        modes = fft.idct(modes, axis=self.axis, norm="ortho", overwrite_x=True)
        depth: Array = self.growing * modes[self.beyond].sum(axis=self.axis, keepdims=True)
        depth += modes[self.inside]
        return np.asarray(fft.idct(depth, axis=across, norm="ortho", overwrite_x=True))


def edge_divergence(dz_dx: Array, dz_dy: Array, *, half: Array) -> Array:
    """Divergence (H, W) of slopes (H, W) averaged onto the edges: a central difference, halved at the borders.

    `half` (2,) is 1/2 over the step along x and y.
    """
    out: Array = np.empty(dz_dx.shape, dtype=half.dtype)
    if dz_dx.flags.c_contiguous:  # as one long row, which is twice as fast; both ends of each row are set below
        flat = dz_dx.reshape(-1)
        np.subtract(flat[2:], flat[:-2], out=out.reshape(-1)[1:-1])
    else:
        np.subtract(dz_dx[:, 2:], dz_dx[:, :-2], out=out[:, 1:-1])
    np.add(dz_dx[:, 0], dz_dx[:, 1], out=out[:, 0])
    # not np.negative in place: numpy 2.4 spoils a column of doubles 64 bytes apart
    out[:, -1] = -(dz_dx[:, -1] + dz_dx[:, -2])
    if half[0] != half[1]:
        dz_dy = dz_dy * (half[1] / half[0])
    out[1:-1] += dz_dy[2:]
    out[1:-1] -= dz_dy[:-2]
    out[0] += dz_dy[0] + dz_dy[1]
    out[-1] -= dz_dy[-1] + dz_dy[-2]
    out *= half[0]
    return out


@lru_cache(maxsize=16)
def transform_solver(shape: tuple[int, int], mm_per_px: Pair, dtype: str) -> TransformSolver:
    """The solver for (H, W), scale and numpy type character, made once and kept."""
    return TransformSolver(shape, mm_per_px, np.float32 if dtype == "f" else np.float64)


def inverse_eigenvalues(shape: tuple[int, int], mm_per_px: Pair) -> Floats:
    """1 over the eigenvalues (H, W) of the Laplacian, none above 0; 0 for the mean, which slopes leave open."""
    along_y, along_x = (
        (2.0 - 2.0 * np.cos(np.pi * np.arange(count) / count)) / step**2
        for count, step in zip(shape, mm_per_px[::-1], strict=True)
    )
    total = along_y[:, None] + along_x[None, :]
    total[0, 0] = np.inf
    return np.asarray(-1.0 / total)


def _continued(shape: tuple[int, int]) -> tuple[int, int]:
    """The axis whose length has the greatest prime factor, and the length that it is continued to."""
    factors = [_greatest_factor(count) for count in shape]
    axis = int(np.argmax(factors))
    count = shape[axis]
    return axis, fft.next_fast_len(count, real=True) if factors[axis] > MAX_FACTOR else count


def _greatest_factor(count: int) -> int:
    factor = 2
    while factor * factor <= count:
        if count % factor:
            factor += 1
        else:
            count //= factor
    return count


def _growing(count: int, across: int, ratio: float) -> Floats:
    """G (across, count); `ratio` is the step along by the step across."""
    half = ratio * np.sin(np.pi * np.arange(1, across) / (2 * across))[:, None]
    rate = 2.0 * np.arcsinh(half)
    x, end = rate * (np.arange(count) + 0.5), rate * count
    share = np.exp(x - end) * (1.0 + np.exp(-2.0 * x)) / (1.0 - np.exp(-2.0 * end))  # cosh(x) / sinh(end)
    return np.concatenate([np.full((1, count), 1.0 / count), 2.0 * half * share])
