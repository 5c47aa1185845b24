"""Compliance of the gel's surface, and its conversion to and from stored arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.errors import InputError
from tactilevision.files.opening import check_numbers
from tactilevision.force.kernel import REACH, WAVES, CellCompliance, layer_cells
from tactilevision.force.lateral_boundaries import (
    LOAD_MM,
    STATION_MM,
    VERSION,
    SideTable,
    from_side,
    side_table,
    station_shape,
)
from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Gel

# The unbounded layer's exact compliance, and the contribution of the gel's free sides:
#
#     C = C_layer (Fourier, exact) + C_sides (finite elements, smooth: within about two thicknesses of a side)
#
# Superposition: the opposite of the layer's stress at the side acts on the free side (lateral_boundaries.py). Only
# that smooth part is discretised coarsely. E scales both; both are computed for one nu.

POISSON_STEP = 1e-3  # step in Poisson's ratio of the compliance's derivative
SIDE_POISSON_STEP = 4e-3  # the same of the sides, whose table has a relative error of some 1e-4


@dataclass(frozen=True, slots=True)
class Slopes:
    """Derivative of the layer's compliance by nu, and the sides for a smaller nu."""

    layer: CellCompliance
    sides: SideTable | None


@dataclass(frozen=True)
class GelCompliance:
    """Compliance between cells at modulus 1 MPa; `inside` (rows, columns): the cells on the gel.

    `slopes` is for the derivative by nu; None: not computed.
    """

    gel: Gel
    poisson_ratio: float
    layer: CellCompliance
    inside: Bools = field(repr=False)
    sides: SideTable | None = None
    slopes: Slopes | None = field(default=None, repr=False)

    @property
    def grid(self) -> NodeGrid:
        """The cells."""
        return self.layer.grid

    def block(self, cells: Cells, parts: int = 3) -> Floats:
        """Return displacement by traction between cells, (parts C, parts C), as CellCompliance does."""
        block = self.layer.block(cells, parts)
        return block if self.sides is None else block + self.sides.block(cells, parts)

    def depth(self, cells: Cells, traction: Floats) -> Floats:
        """Return the depth (rows, columns) everywhere that `traction` (3 or 1, C) at `cells` makes.

        Sides are neglected.
        """
        rows, columns = self.grid.shape
        shape, waves = self._depth_waves
        fields = np.zeros((len(traction), rows * columns), dtype=np.float32)
        fields[:, cells] = traction
        spectra = fft.rfft2(fields.reshape(-1, rows, columns), shape)
        moved = fft.irfft2((waves[-len(traction) :] * spectra).sum(axis=0), shape)[
            rows - 1 : 2 * rows - 1, columns - 1 : 2 * columns - 1
        ]
        return np.asarray(moved, dtype=np.float64)

    @cached_property
    def _depth_waves(self) -> tuple[tuple[int, int], npt.NDArray[np.complex64]]:
        """Shape of the transform, and (3, ky, kx): depth by t_x, t_y, t_z."""
        rows, columns = self.grid.shape
        # a convolution of length 2 n - 1 wraps only outside the part that is read
        shape = (fft.next_fast_len(2 * rows - 1, real=True), fft.next_fast_len(2 * columns - 1, real=True))
        table = self.layer.table.reshape(2 * rows - 1, 2 * columns - 1, 3, 3)[:, :, 2].astype(np.float32)
        return shape, np.stack([fft.rfft2(table[..., k], shape) for k in range(3)])

    def by_poisson(self, cells: Cells, parts: int) -> Floats:
        """Return the derivative of the cells' own block by nu, (parts C, parts C)."""
        assert self.slopes is not None
        layer = self.slopes.layer.block(cells, parts)
        if self.sides is None or self.slopes.sides is None:
            return layer
        change = self.sides.block(cells, parts) - self.slopes.sides.block(cells, parts)
        return np.asarray(layer + change / SIDE_POISSON_STEP)


def gel_compliance(
    gel: Gel, grid: NodeGrid, *, poisson_ratio: float, sides: bool = True, slopes: bool = False
) -> GelCompliance:
    """Build, or read from the cache, the compliance of `gel` for the cells of `grid`, with `slopes` if asked for.

    Raises InputError if no cell is on the gel.
    """
    inside = on_gel(gel, grid)
    if not inside.any():
        raise InputError(
            "no part of the view is on the gel",
            where="gel_compliance",
            value=gel,
            remedy="Check radius_mm or size_mm of [sensor.gel].",
        )
    h = gel.thickness_mm
    layer = layer_cells(grid, thickness_mm=h, poisson_ratio=poisson_ratio)
    table = side_table(gel, grid, poisson_ratio=poisson_ratio) if sides else None
    lower, change = None, None
    if slopes:
        below = layer_cells(grid, thickness_mm=h, poisson_ratio=poisson_ratio - POISSON_STEP)
        if table is not None:
            lower = side_table(gel, grid, poisson_ratio=poisson_ratio - SIDE_POISSON_STEP)
        change = Slopes(CellCompliance(grid, (layer.table - below.table) / POISSON_STEP), lower)
    return GelCompliance(gel, poisson_ratio, layer, inside, table, change)


def on_gel(gel: Gel, grid: NodeGrid) -> Bools:
    """Return the mask (rows, columns) of the cells that lie wholly on the gel."""
    half = grid.spacing_mm / 2
    x, y = np.meshgrid(np.abs(grid.x_mm) + half, np.abs(grid.y_mm) + half)
    return np.asarray(from_side(gel, np.stack([x, y], axis=-1)) >= -ROUNDING)


# A gel's compliance as arrays, since it takes a second, or half a minute with free sides. The key names all that
# the numbers depend on; arrays of another key are not used.

Arrays = Mapping[str, npt.NDArray[Any]]
KEY, LAYER, LAYER_SLOPE, SIDES, SIDES_LOWER = "key", "layer", "layer_slope", "sides", "sides_lower"


def as_arrays(made: GelCompliance) -> dict[str, npt.NDArray[Any]]:
    """Return all that is computed of a compliance with slopes, mm/MPa at modulus 1 MPa, under its key."""
    assert made.slopes is not None
    key = np.array(_key(made.gel, made.grid, made.poisson_ratio))
    sides = {SIDES: made.sides, SIDES_LOWER: made.slopes.sides}
    arrays = {KEY: key, LAYER: made.layer.table, LAYER_SLOPE: made.slopes.layer.table}
    return arrays | {name: one.table for name, one in sides.items() if one is not None}


def of_arrays(arrays: Arrays, gel: Gel, *, grid: NodeGrid, poisson_ratio: float, where: object) -> GelCompliance:
    """Restore the compliance from `as_arrays`, mm/MPa, of any shape.

    Another gel's, or version's, is computed anew. Raises InputError if the arrays have the key and do not fit it.
    """
    if KEY not in arrays or str(arrays[KEY]) != _key(gel, grid, poisson_ratio):
        return gel_compliance(gel, grid, poisson_ratio=poisson_ratio, slopes=True)
    cells = (2 * grid.shape[0] - 1) * (2 * grid.shape[1] - 1), 9
    sides = (3 * math.prod(station_shape(grid)),) * 2
    layer, slope = (CellCompliance(grid, _checked(arrays, name, cells, where)) for name in (LAYER, LAYER_SLOPE))
    here, lower = (
        SideTable(grid, _checked(arrays, name, sides, where)) if name in arrays else None
        for name in (SIDES, SIDES_LOWER)
    )
    return GelCompliance(gel, poisson_ratio, layer, on_gel(gel, grid), here, Slopes(slope, lower))


def _checked(arrays: Arrays, name: str, shape: tuple[int, ...], where: object) -> npt.NDArray[Any]:
    found = arrays.get(name)
    fits = found is not None and found.shape == shape and found.dtype.kind in "fi"
    if found is None or not fits or not np.isfinite(found).all():
        raise InputError(f"the compliance's {name} is missing or has another shape", where=where, value=shape)
    check_numbers(found, what=f"a number of the compliance's {name}", where=where)
    return found


def _key(gel: Gel, grid: NodeGrid, poisson_ratio: float) -> str:
    """Return all that the numbers depend on."""
    outline = gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, round(poisson_ratio, 9)
    steps = VERSION, WAVES, REACH, POISSON_STEP, SIDE_POISSON_STEP, STATION_MM, LOAD_MM
    return repr((*outline, grid.shape, grid.spacing_mm, *steps))
