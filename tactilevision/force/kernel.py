"""Displacement and stress in an unbounded bonded layer under a loaded cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.mechanics.layer import surface_compliance
from tactilevision.records.measured import Floats

# Exact compliance between cells on an unbounded layer. A cell's constant traction and a cell's mean displacement
# are both the field filtered with the cell's box b, so
#
#     K(x) = d^2/(2 pi)^2 Int C(k) b(k)^2 exp(i k x) d^2k,     b = sinc(kx d/2) sinc(ky d/2),
#
# with C the layer's compliance. K depends on the offset alone, is symmetric and positive definite. The integral is
# a sum over waves up to `WAVES` times the grid's own, on a period that is longer than the view by `REACH`
# thicknesses: a load has no effect beyond two, so the periodic images do not matter. The traction is zero-padded;
# the displacement is not padded. Modulus 1 MPa: divide by E. (2 rows - 1, 2 columns - 1, 3, 3), mm/MPa,
# displacement by traction over x, y, z.

WAVES = 4  # times the grid's own: shorter ones average out over a cell
REACH = 8  # thicknesses of gel between a load and its next image


@dataclass(frozen=True)
class CellCompliance:
    """`table` (offsets, 9) at modulus 1 MPa for every offset of two cells of `grid`."""

    grid: NodeGrid
    table: Floats

    def block(self, cells: Cells, parts: int = 3) -> Floats:
        """Return displacement by traction between cells, flat indices, (parts C, parts C).

        For 3 parts x of all, then y of all, then z of all; for 1 part depth by pressure alone.
        """
        rows, columns = self.grid.shape
        row, column = np.divmod(cells, columns)
        wide = 2 * columns - 1
        place = row * wide + column
        offset = (place + (rows - 1) * wide + columns - 1)[:, None] - place
        found = np.empty((parts, len(cells), parts, len(cells)))
        for i, j in np.ndindex(parts, parts):
            found[i, :, j] = self._components[3 - parts + i, 3 - parts + j].take(offset)
        return found.reshape(parts * len(cells), parts * len(cells))

    @cached_property
    def _components(self) -> Floats:
        """Return the table as (3, 3, offsets)."""
        return np.ascontiguousarray(self.table.T).reshape(3, 3, -1)


def layer_cells(grid: NodeGrid, *, thickness_mm: float, poisson_ratio: float) -> CellCompliance:
    """Return the compliance between all cells of `grid` on an unbounded layer bonded to a rigid base."""
    fine = grid.spacing_mm / WAVES
    counts = [
        WAVES * fft.next_fast_len(2 * n + int(np.ceil(REACH * thickness_mm / grid.spacing_mm))) for n in grid.shape
    ]
    k_x, k_y = _wave_numbers(counts, fine)
    compliance = surface_compliance(
        k_x, k_y, youngs_modulus_MPa=1.0, poisson_ratio=poisson_ratio, thickness_mm=thickness_mm
    )
    weight = _box(k_x, k_y, grid.spacing_mm) ** 2 * WAVES**2
    steps = [np.arange(-n + 1, n) * WAVES % c for n, c in zip(grid.shape, counts, strict=True)]
    table = np.empty((len(steps[0]), len(steps[1]), 3, 3))
    for i in range(3):
        for j in range(3):
            field = fft.irfft2(compliance[..., i, j] * weight, counts)
            table[..., i, j] = field[np.ix_(*steps)]
    return CellCompliance(grid, np.ascontiguousarray(table.reshape(-1, 9)))


def _wave_numbers(counts: Sequence[int], step_mm: float) -> tuple[Floats, Floats]:
    """Return (1, kx) and (ky, 1) of a real transform over `counts` (y, x) places, 1/mm."""
    k_y, k_x = (np.asarray(2 * np.pi * np.fft.fftfreq(count, step_mm), dtype=float) for count in counts)
    return k_x[None, : counts[1] // 2 + 1], k_y[:, None]


def _box(k_x: Floats, k_y: Floats, width_mm: float) -> Floats:
    """Return the transform of a square cell of constant traction over its area."""
    return np.asarray(np.sinc(k_x * width_mm / (2 * np.pi)) * np.sinc(k_y * width_mm / (2 * np.pi)))


# Stress inside an unbounded bonded layer under a loaded cell on its face, at modulus 1 MPa.
#
# Wave by wave, with k along L and z into the gel: u = (i a, b) exp(i k L) from four solutions of Navier's
# equations,
#
#   (a, b) = (1, -1) e^(-kz),  (-kz, kappa + kz) e^(-kz),  (1, 1) e^(-ks),  (ks, kappa + ks) e^(-ks),   s = h - z,
#
# kappa = 3 - 4 nu, fitted to u = 0 at the base and to the load at the face; across k, u = sinh(ks)/(mu k cosh kh).
# Stresses are even or odd in place and real; they are read from a fine grid of offsets, from the load to the
# place.
#
# Source: Papkovich-Neuber solutions; Johnson, Contact Mechanics (1985), section 3.1.

STEP_MM_OF_CELL = 0.5  # of a cell: step of the table over distance
Waves = npt.NDArray[np.inexact[Any]]
PAIRS = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])  # xx yy zz xy xz yz
VOIGT = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # place of each component among them


@dataclass(frozen=True, slots=True)
class LayerStress:
    """`stress` (levels, n, n, 3 loads, 6) on offsets of `step_mm`, the load in the middle; xx yy zz xy xz yz."""

    stress: Floats
    step_mm: float

    def at(self, level: int, offset_mm: Floats) -> Floats:
        """Return the stress (P, 3 loads, 3, 3) at `offset_mm` (P, 2) from the load; 0 beyond the grid."""
        from scipy.interpolate import RegularGridInterpolator

        axis = (np.arange(self.stress.shape[1]) - self.stress.shape[1] // 2) * self.step_mm
        field = RegularGridInterpolator((axis, axis), self.stress[level], bounds_error=False, fill_value=0.0)
        return np.asarray(field(offset_mm[:, ::-1])[:, :, VOIGT])


def layer_stress(
    depths_mm: Floats, cell_mm: float, *, thickness_mm: float, poisson_ratio: float, reach_mm: float
) -> LayerStress:
    """Return the stress (MPa) at `depths_mm` (n,) of a cell `cell_mm` wide that carries the force 1 N (traction
    1/cell^2).
    """
    step = STEP_MM_OF_CELL * cell_mm
    count = fft.next_fast_len(2 * int(np.ceil(1.5 * reach_mm / step)))
    k_x, k_y = _wave_numbers((count, count), step)
    k = np.hypot(k_x, k_y)
    k[0, 0] = 1e-2 / thickness_mm  # the mean wave: as long as accuracy allows
    cosine, sine = k_x / k, k_y / k
    cosine[0, 0], sine[0, 0] = 1.0, 0.0
    box = _box(k_x, k_y, cell_mm) / step**2
    field = np.empty((len(depths_mm), count, count, 3, 6))
    for level, depth in enumerate(depths_mm):
        waves = _stress_waves(k, cosine, sine, depth, thickness_mm=thickness_mm, poisson_ratio=poisson_ratio)
        entries = fft.irfft2(waves[:, *PAIRS] * box, (count, count))
        field[level] = np.moveaxis(np.fft.fftshift(entries, axes=(-2, -1)), (0, 1), (2, 3))
    return LayerStress(field, step)


def wave_stress(k: Floats, depth_mm: float, *, thickness_mm: float, poisson_ratio: float) -> Floats:
    """Return (8, ...) real parts: LL, TT, zz, Lz by a normal load, the same by one along L, in that order.

    For the normal load LL, TT, zz are real and Lz imaginary (i times the number given); for the load along L
    the other way round with LL, TT, zz = -i times, Lz = 1 times the number given.
    """
    mu = 1 / (2 * (1 + poisson_ratio))
    lame = 2 * mu * poisson_ratio / (1 - 2 * poisson_ratio)
    kappa, h = 3 - 4 * poisson_ratio, thickness_mm

    def basis(z: float) -> tuple[Floats, Floats, Floats, Floats]:
        down, up, t, s = np.exp(-k * z), np.exp(-k * (h - z)), k * z, k * (h - z)
        a = np.stack([down, -t * down, up, s * up])
        b = np.stack([-down, (kappa + t) * down, up, (kappa + s) * up])
        a_z = k * np.stack([-down, (t - 1) * down, up, (s - 1) * up])
        b_z = k * np.stack([down, (1 - kappa - t) * down, up, (kappa + s - 1) * up])
        return a, b, a_z, b_z

    a, b, a_z, b_z = basis(0.0)
    base = basis(h)
    system = np.stack([mu * (a_z + k * b), (lame + 2 * mu) * b_z - lame * k * a, base[0], base[1]])
    loads = np.zeros((*k.shape, 4, 2))
    loads[..., 1, 0], loads[..., 0, 1] = -1.0, -1.0
    weights = np.linalg.solve(np.moveaxis(system, (0, 1), (-2, -1)), loads)
    a, b, a_z, b_z = (np.einsum("n...,...nl->l...", part, weights) for part in basis(depth_mm))
    spread = b_z - k * a
    parts = [(lame * spread[i] - 2 * mu * k * a[i], lame * spread[i], lame * spread[i] + 2 * mu * b_z[i],
              mu * (a_z[i] + k * b[i])) for i in (0, 1)]  # fmt: skip
    return np.stack([*parts[0], *parts[1]])


def _stress_waves(
    k: Floats, c: Floats, s: Floats, depth_mm: float, *, thickness_mm: float, poisson_ratio: float
) -> Waves:
    """Return the stress (3 loads, 3, 3, ky, kx) in x, y, z, from that along L = (c, s), T = (-s, c) and z."""
    p = wave_stress(k, depth_mm, thickness_mm=thickness_mm, poisson_ratio=poisson_ratio)
    (lt, tz), o = _across(k, depth_mm, thickness_mm), np.zeros_like(k)
    along = [[-1j * p[4], o, p[7]], [o, -1j * p[5], o], [p[7], o, -1j * p[6]]]
    across = [[o, 1j * lt, o], [1j * lt, o, tz], [o, tz, o]]
    normal = [[p[0], o, 1j * p[3]], [o, p[1], o], [1j * p[3], o, p[2]]]
    turn = np.array([[c, -s, o], [s, c, o], [o, o, np.ones_like(k)]])
    stress = np.array([along, across, normal])
    return np.asarray(np.einsum("la...,im...,jn...,amn...->lij...", turn, turn, turn, stress, optimize=True))


def _across(k: Floats, depth_mm: float, thickness_mm: float) -> tuple[Floats, Floats]:
    """Return sinh(ks)/cosh(kh) and -cosh(ks)/cosh(kh), s = h - z: LT over i and Tz of a load across k."""
    down, mirrored = np.exp(-k * depth_mm), np.exp(-k * (2 * thickness_mm - depth_mm))
    below = 1 + np.exp(-2 * k * thickness_mm)
    return (down - mirrored) / below, -(down + mirrored) / below
