"""How far one loaded cell moves every other one, on an unbounded layer: the exact compliance, cell to cell.

A cell's constant traction and a cell's mean displacement are both the field filtered with the cell's box b, so

    K(x) = d^2/(2 pi)^2 Int C(k) b(k)^2 exp(i k x) d^2k,     b = sinc(kx d/2) sinc(ky d/2),

with C the layer's compliance. K depends on the offset alone, is symmetric and positive definite. The integral is
a sum over waves up to `WAVES` times the grid's own, on a period that is longer than the view by `REACH`
thicknesses: the layer forgets a load within two, so that the images of the period are not felt. The traction is
padded with nothing; the displacement is never padded.
Modulus 1 MPa: divide by E. (2 rows - 1, 2 columns - 1, 3, 3), mm/MPa, displacement by traction over x, y, z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.force.nodes import NodeGrid
from tactilevision.mechanics.layer import surface_compliance
from tactilevision.records import Floats

WAVES = 4  # times the grid's own: shorter ones average out over a cell
REACH = 8.0  # thicknesses of gel between a load and its next image, so that they do not feel each other


@dataclass(frozen=True, slots=True)
class CellCompliance:
    """`table` (offsets, 9) at modulus 1 MPa for every offset of two cells of `grid`."""

    grid: NodeGrid
    table: Floats

    def block(self, receivers: npt.NDArray[np.intp], sources: npt.NDArray[np.intp]) -> Floats:
        """(3 R, 3 S): displacement (x of all, y of all, z of all) by traction, for flat indices of cells."""
        rows, columns = self.grid.shape
        r_row, r_column = np.divmod(receivers, columns)
        s_row, s_column = np.divmod(sources, columns)
        wide = 2 * columns - 1
        offset = (r_row * wide + r_column + (rows - 1) * wide + columns - 1)[:, None] - (s_row * wide + s_column)
        entries = self.table.take(offset.ravel(), axis=0).reshape(len(receivers), len(sources), 3, 3)
        return np.asarray(entries.transpose(2, 0, 3, 1).reshape(3 * len(receivers), 3 * len(sources)))

    def normal_block(self, cells: npt.NDArray[np.intp]) -> Floats:
        """(C, C): depth by pressure alone."""
        rows, columns = self.grid.shape
        row, column = np.divmod(cells, columns)
        wide = 2 * columns - 1
        place = row * wide + column
        offset = (place + (rows - 1) * wide + columns - 1)[:, None] - place
        return np.asarray(np.ascontiguousarray(self.table[:, 8]).take(offset))


def layer_cells(grid: NodeGrid, *, thickness_mm: float, poisson_ratio: float) -> CellCompliance:
    """The compliance between all cells of `grid` on an unbounded layer bonded to a rigid base."""
    fine = grid.spacing_mm / WAVES
    counts = [
        WAVES * fft.next_fast_len(2 * n + int(np.ceil(REACH * thickness_mm / grid.spacing_mm))) for n in grid.shape
    ]
    k_x = 2 * np.pi * np.fft.fftfreq(counts[1], fine)[None, : counts[1] // 2 + 1]
    k_y = 2 * np.pi * np.fft.fftfreq(counts[0], fine)[:, None]
    compliance = surface_compliance(
        k_x, k_y, youngs_modulus_MPa=1.0, poisson_ratio=poisson_ratio, thickness_mm=thickness_mm
    )
    box = np.sinc(k_x * grid.spacing_mm / (2 * np.pi)) * np.sinc(k_y * grid.spacing_mm / (2 * np.pi))
    weight = box**2 * WAVES**2
    steps = [np.arange(-n + 1, n) * WAVES % c for n, c in zip(grid.shape, counts, strict=True)]
    table = np.empty((len(steps[0]), len(steps[1]), 3, 3))
    for i in range(3):
        for j in range(3):
            field = fft.irfft2(compliance[..., i, j] * weight, counts)
            table[..., i, j] = field[np.ix_(*steps)]
    return CellCompliance(grid, np.ascontiguousarray(table.reshape(-1, 9)))
