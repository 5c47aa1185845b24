"""The gel as the inverse sees it: the unbounded layer's exact compliance, and what the gel's free sides add.

    C = C_layer (Fourier, exact) + C_sides (finite elements, smooth: felt within about two thicknesses of a side)

Superposition: the layer's own stress acts on the place where the side is; the side is free, so the opposite
traction is put on it (sides.py). Only that smooth part is discretised coarsely. E scales both; both are made
for one nu.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tactilevision.errors import InputError
from tactilevision.force.inverse import Cells
from tactilevision.force.kernel import CellCompliance, layer_cells
from tactilevision.force.nodes import NodeGrid
from tactilevision.force.sides.table import SideTable, side_table
from tactilevision.records import Bools, Floats, Gel

POISSON_STEP = 1e-3


@dataclass(frozen=True)
class GelCompliance:
    """Compliance between cells at modulus 1 MPa; `inside` (rows, columns) says which cells lie on the gel."""

    gel: Gel
    poisson_ratio: float
    layer: CellCompliance
    inside: Bools = field(repr=False)
    sides: SideTable | None = None

    @property
    def grid(self) -> NodeGrid:
        """The cells."""
        return self.layer.grid

    def block(self, receivers: Cells, sources: Cells) -> Floats:
        """(3 R, 3 S), x of all, y of all, z of all."""
        block = self.layer.block(receivers, sources)
        return block if self.sides is None else self.sides.add(block, self.grid, receivers, sources)

    def normal_block(self, cells: Cells) -> Floats:
        """(C, C), depth by pressure."""
        block = self.layer.normal_block(cells)
        return block if self.sides is None else self.sides.add_normal(block, self.grid, cells)

    def by_poisson(self, cells: Cells, parts: int) -> Floats:
        """Derivative of the cells' own block by nu, (parts C, parts C); the sides' part of it is left out."""
        if parts == 1:
            return self._poisson_slope.normal_block(cells)
        return self._poisson_slope.block(cells, cells)

    @cached_property
    def _poisson_slope(self) -> CellCompliance:
        lower = layer_cells(
            self.grid, thickness_mm=self.gel.thickness_mm, poisson_ratio=self.poisson_ratio - POISSON_STEP
        )
        return CellCompliance(self.grid, (self.layer.table - lower.table) / POISSON_STEP)


def gel_compliance(gel: Gel, grid: NodeGrid, *, poisson_ratio: float, sides: bool = True) -> GelCompliance:
    """Build, or read from the cache, the compliance of `gel` for the cells of `grid`.

    Raises InputError where no cell lies on the gel.
    """
    inside = _on_gel(gel, grid)
    if not inside.any():
        raise InputError("no part of the view lies on the gel", where="gel_compliance", value=gel,
                         remedy="Check radius_mm or size_mm of [sensor.gel].")  # fmt: skip
    layer = layer_cells(grid, thickness_mm=gel.thickness_mm, poisson_ratio=poisson_ratio)
    table = side_table(gel, grid, poisson_ratio=poisson_ratio) if sides else None
    return GelCompliance(gel, poisson_ratio, layer, inside, table)


def _on_gel(gel: Gel, grid: NodeGrid) -> Bools:
    """Cells that lie wholly on the gel."""
    half = grid.spacing_mm / 2
    x, y = np.abs(grid.x_mm)[None, :] + half, np.abs(grid.y_mm)[:, None] + half
    if gel.shape == "disc" and gel.radius_mm is not None:
        return np.asarray(np.hypot(x, y) <= gel.radius_mm)
    if gel.shape == "rectangle" and gel.size_mm is not None:
        return np.asarray((x <= gel.size_mm[0] / 2 + 1e-9) & (y <= gel.size_mm[1] / 2 + 1e-9))
    return np.ones(grid.shape, dtype=bool)
