"""Integrate slopes to a surface: Poisson's equation by cosine transforms."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from scipy import fft

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.photometric.colour_change import Window
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Array, Bools, Floats, Pair, Picture

# The unweighted normal equations, solved by one pair of cosine transforms.
#
# The cosine transform of type II diagonalises the 5-point Laplacian with natural borders, with the eigenvalues
# (2 - 2 cos(pi k/N))/d^2, k = 0 .. N-1, per axis.


def solve_poisson(right: Array, mm_per_px: Pair) -> Array:
    """Return the depth (H, W) mm of mean 0 whose 5-point Laplacian is `right` (H, W), which sums to 0."""
    modes = fft.dctn(right, norm="ortho")
    modes *= inverse_eigenvalues(right.shape, mm_per_px, right.dtype.char)
    return np.asarray(fft.idctn(modes, norm="ortho", overwrite_x=True))


def edge_divergence(dz_dx: Array, dz_dy: Array, mm_per_px: Pair) -> Array:
    """Return the divergence (H, W) of slopes (H, W) at the edges: a central difference, halved at borders."""
    half = np.array([0.5 / step for step in mm_per_px], dz_dx.dtype)
    out: Array = np.empty_like(dz_dx, order="C")
    if dz_dx.flags.c_contiguous:  # as one long row, which is twice as fast; both ends of each row are set below
        flat = dz_dx.reshape(-1)
        np.subtract(flat[2:], flat[:-2], out=out.reshape(-1)[1:-1])
    else:
        np.subtract(dz_dx[:, 2:], dz_dx[:, :-2], out=out[:, 1:-1])
    np.add(dz_dx[:, 0], dz_dx[:, 1], out=out[:, 0])
    # not np.negative in place: numpy 2.4 spoils a column of doubles with a stride of 64 bytes
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
def inverse_eigenvalues(shape: tuple[int, int], mm_per_px: Pair, dtype: str) -> Array:
    """Return 1 over the Laplacian's eigenvalues (H, W), none above 0; 0 for the undetermined mean."""
    along_y, along_x = (
        (2.0 - 2.0 * np.cos(np.pi * np.arange(count) / count)) / step**2
        for count, step in zip(shape, mm_per_px[::-1], strict=True)
    )
    total = along_y[:, None] + along_x[None, :]
    total[0, 0] = np.inf
    return np.asarray(-1.0 / total, dtype)


# Slopes to depth: the least-squares surface of a field of slopes, with its borders free.
#
# Unknown: the depth z at the pixels. The slopes p = dz/dx, q = dz/dy are known at the pixels too, so each is
# averaged onto the half-pixel edge between two neighbours, where the difference of their depths lives:
#
#     minimise  sum_edges w_e [ (z_(i+1) - z_i)/d - (p_i + p_(i+1))/2 ]^2      d: mm per pixel, per axis
#
# With w = 1 the normal equations are a 5-point Laplacian with natural (Neumann) borders, which cosine transforms
# solve. The solution is exact for the scheme: a plane, a tilt and a paraboloid come back to
# rounding error. The error on a smooth surface falls with the square of the pixel. The mean of the surface is left
# at 0 (the slopes do not know it); `tactilevision.heightmap.zero_plane` finds the untouched gel.

FLOOR = 1e-4  # weight of an edge that is not known: it only keeps an island's level from floating


def integrate(slopes: SlopeMap, mm_per_px: Pair) -> Array:
    """Return depth (H, W) in mm of `slopes`, its mean 0; in float32 for float32 slopes, else float64.

    The surface is carried over pixels outside `slopes.valid`, or not finite. Raises InputError on shapes that do
    not match, ConvergenceError where the solution with such pixels does not settle.
    """
    dz_dx, dz_dy = _checked(slopes)
    if slopes.valid is None or _known(slopes).all():
        with np.errstate(invalid="ignore"):
            depth = solve_poisson(edge_divergence(dz_dx, dz_dy, mm_per_px), mm_per_px)
        if np.isfinite(depth[0, 0]):  # one slope that is not finite leaves no depth finite
            return depth
    known = _known(slopes)
    along_x, along_y = known[:, 1:] & known[:, :-1], known[1:] & known[:-1]
    p, q = np.where(known, dz_dx, 0.0), np.where(known, dz_dy, 0.0)
    depth = solve_edges(
        np.where(along_x, 0.5 * (p[:, 1:] + p[:, :-1]), 0.0),  # unknown: stretched like a membrane
        np.where(along_y, 0.5 * (q[1:] + q[:-1]), 0.0),
        w_x=np.where(along_x, 1.0, FLOOR),
        w_y=np.where(along_y, 1.0, FLOOR),
        mm_per_px=mm_per_px,
    )
    return depth.astype(slopes.dz_dx.dtype)


def divergence(x_edges: Array, y_edges: Array, mm_per_px: Pair) -> Array:
    """Divergence (H, W) of `x_edges` (H, W-1) and `y_edges` (H-1, W): minus the adjoint of `gradient`.

    No flow crosses the border, so the divergence sums to 0.
    """
    out = np.zeros((x_edges.shape[0], y_edges.shape[1]), dtype=x_edges.dtype)
    along_x, along_y = x_edges / mm_per_px[0], y_edges / mm_per_px[1]
    out[:, :-1] += along_x
    out[:, 1:] -= along_x
    out[:-1] += along_y
    out[1:] -= along_y
    return out


def gradient(depth: Array, mm_per_px: Pair) -> tuple[Array, Array]:
    """Return differences of `depth` (H, W) over the edges: (H, W-1) along x, (H-1, W) along y, mm per mm."""
    return np.diff(depth, axis=1) / mm_per_px[0], np.diff(depth, axis=0) / mm_per_px[1]


def solve_edges(
    target_x: Array,
    target_y: Array,
    *,
    w_x: Array,
    w_y: Array,
    mm_per_px: Pair,
    tolerance: float = 1e-6,
    max_iterations: int = 500,
) -> Array:
    """Return depth, mean 0, with differences nearest to the targets (H, W-1), (H-1, W), weighted by edge.

    By conjugate gradients, preconditioned by the unweighted solution: the spectrum lies in [FLOOR, 1], gathered at
    both ends, so that tens of iterations do. `tolerance`: relative residual at which they stop.
    """

    def stiffness(depth: Array) -> Array:
        g_x, g_y = gradient(depth, mm_per_px)
        return -divergence(w_x * g_x, w_y * g_y, mm_per_px)

    right = -divergence(w_x * target_x, w_y * target_y, mm_per_px)
    depth, residual = np.zeros_like(right), right.copy()
    step = solve_poisson(-residual, mm_per_px)
    energy, direction = float(np.vdot(residual, step)), step
    goal = tolerance**2 * abs(energy)
    for _ in range(max_iterations):
        if energy <= goal:
            return np.asarray(depth - depth.mean())
        pushed = stiffness(direction)
        length = energy / float(np.vdot(direction, pushed))
        depth = depth + length * direction
        residual = residual - length * pushed
        step = solve_poisson(-residual, mm_per_px)
        before, energy = energy, float(np.vdot(residual, step))
        direction = step + (energy / before) * direction
    raise ConvergenceError(
        f"weighted integration stopped after {max_iterations} iterations at a relative residual of "
        f"{np.sqrt(energy / goal) * tolerance:.1e}, {tolerance:.1e} was asked for"
    )


def _known(slopes: SlopeMap) -> Bools:
    finite = np.isfinite(slopes.dz_dx) & np.isfinite(slopes.dz_dy)
    return np.asarray(finite if slopes.valid is None else finite & slopes.valid)


def _checked(slopes: SlopeMap) -> tuple[Array, Array]:
    shape = slopes.dz_dx.shape
    if len(shape) != 2 or slopes.dz_dy.shape != shape or min(shape) < 2:
        raise InputError(
            "slopes are two fields (H, W) alike, at least 2 by 2",
            where="integrate",
            value=(shape, slopes.dz_dy.shape),
        )
    if slopes.dz_dx.dtype == np.float32 and slopes.dz_dy.dtype == np.float32:
        return slopes.dz_dx, slopes.dz_dy
    return np.asarray(slopes.dz_dx, dtype=np.float64), np.asarray(slopes.dz_dy, dtype=np.float64)


# Slopes on squares to depth on squares twice as wide, without the blur that wide squares would bring.
#
# The difference of the depths of two neighbouring squares is the mean slope between their middles:
#
#     (z_(i+1) - z_i)/d = mean of p over the square of side d that is centred on their common edge
#
# which is four squares half as wide. The mean of the two squares' own slopes instead reaches over 2 d: it blurs a
# surface with a deviation of .5 d, and around a punch it lowers nu by .001 to .002 at d = .25 mm.


def integrate_half_squares(
    dz_dx: Floats, dz_dy: Floats, *, share: Floats, least: float, mm_per_px: Pair
) -> tuple[Floats, Bools]:
    """Return depth (h, w) mm, mean 0, and where it is known (h, w), from mean slopes (2h, 2w).

    `share` (2h, 2w), from 0 to 1, of each half square's pixels that are readable; squares and edges with less than
    `least` of theirs are not known, the surface is carried over them. `mm_per_px` (x, y) of half squares.
    """
    rows = share[::2] + share[1::2]
    known = rows[:, ::2] + rows[:, 1::2] > 4 * least
    weights, targets = [], []
    for slope, turned in ((dz_dx, False), (dz_dy, True)):
        part, total = (_between(a.T if turned else a) for a in (share, share * slope))
        ends = known.T if turned else known
        sound = (part > 4 * least) & ends[:, 1:] & ends[:, :-1]
        target = np.where(sound, total / np.where(sound, part, 1.0), 0.0)
        weight = np.where(sound, 1.0, FLOOR)
        weights.append(weight.T if turned else weight)
        targets.append(target.T if turned else target)
    scale = (2 * mm_per_px[0], 2 * mm_per_px[1])
    depth = solve_edges(*targets, w_x=weights[0], w_y=weights[1], mm_per_px=scale)
    return np.asarray(depth, np.float64), known


def _between(values: Floats) -> Floats:
    """Return sums (h, w - 1) over the four half squares around the edge of two neighbours in a row."""
    rows = values[::2] + values[1::2]
    return np.asarray(rows[:, 1:-1:2] + rows[:, 2:-1:2])


# Coarse slopes with fine windows, integrated to a surface on two grids.
#
# The coarse slopes, in a window the means of its fine ones, are integrated on their own grid, and the surface z is
# interpolated linearly to the single pixels. The residual of a window's fine equations,
#
#     L e = div (p, q) - L z      e = 0 on the window's rim; no flux across the picture's border
#
# (L: 5-point Laplacian) is solved by products with L's eigenvectors along either axis: at the size of a window as
# fast as transforms. Between equal ends they are even and odd alternately, so that half of each is sufficient.
# Means of a gradient are the gradient of means, so that a step has equal height on both grids, and e is small and
# local: the depth of contacts is within .1 um of that of one solution.
# Assumes gentle slopes at the rims of windows, as `photometric/method.py` cuts them.

LARGE = 10000  # points, above which a coarse grid is solved by transforms: not faster on smaller ones
FOLDED = 120  # points, from which half waves are faster than whole ones

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
        self.bend = np.array([[0, along_y, 0], [along_x, -2 * (along_x + along_y), along_x], [0, along_y, 0]])

    def coarse(self, slopes: Picture, windows: Sequence[Window], *, fine: Sequence[Picture]) -> Picture:
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
        self, coarse: Picture, windows: Sequence[Window], *, fine: Sequence[Picture], tilt: Pair = (0.0, 0.0)
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

    def _refine(self, depth: Picture, window: Window, slopes: Picture, tilt: Pair) -> None:
        """Write the surface of a window's slopes, minus those of a plane, into `depth`, in place."""
        p, q = (plane - np.float32(lean) for plane, lean in zip(slopes, tilt, strict=True))
        ends = [(along.start == 0, along.stop == count) for along, count in zip(window, self.shape, strict=True)]
        z = depth[window]
        if all(side for sides in ends for side in sides):
            z[...] = integrate(SlopeMap(p, q), self.mm_per_px) + z.mean()
            return
        residual = edge_divergence(p, q, self.mm_per_px)
        residual -= cv2.filter2D(z, cv2.CV_32F, self.bend, borderType=cv2.BORDER_REPLICATE)
        rows, columns = (slice(0 if low else 1, None if high else -1) for low, high in ends)
        z[rows, columns] += _solved(residual[rows, columns], self.mm_per_px, (ends[0], ends[1]))


def integrate_small(slopes: Picture, step_mm: Pair) -> Picture:
    """Return depth (h, w) in mm, mean 0, of slopes (2, h, w) on a grid of steps (x, y) in mm: as
    `poisson.integrate`.

    Faster than that on small grids.
    """
    right = edge_divergence(slopes[0], slopes[1], step_mm)
    if right.size > LARGE:
        return np.asarray(solve_poisson(right, step_mm))
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
