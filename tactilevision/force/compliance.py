"""Compliance of the gel's surface, and its conversion to and from stored arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.errors import InputError
from tactilevision.files.opening import check_numbers
from tactilevision.force.inverse import Cells
from tactilevision.force.kernel import REACH, WAVES, CellCompliance, layer_cells
from tactilevision.force.lateral_boundaries import LOAD_MM, STATION_MM, VERSION, SideTable, side_table
from tactilevision.force.nodes import NodeGrid
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bools, Floats, Material, Pair
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

    `kept` is its stored derivative by nu; None: computed when needed.
    """

    gel: Gel
    poisson_ratio: float
    layer: CellCompliance
    inside: Bools = field(repr=False)
    sides: SideTable | None = None
    kept: Slopes | None = field(default=None, repr=False)

    @property
    def grid(self) -> NodeGrid:
        """The cells."""
        return self.layer.grid

    def block(self, receivers: Cells, sources: Cells) -> Floats:
        """Return the block (3 R, 3 S), x of all, y of all, z of all."""
        block = self.layer.block(receivers, sources)
        return block if self.sides is None else self.sides.add(block, self.grid, receivers, sources)

    def normal_block(self, cells: Cells) -> Floats:
        """Return the block (C, C) of depth by pressure."""
        block = self.layer.normal_block(cells)
        return block if self.sides is None else self.sides.add_normal(block, self.grid, cells=cells)

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
        slope = self._poisson_slope
        layer = slope.normal_block(cells) if parts == 1 else slope.block(cells, cells)
        here = self._of_sides(self.sides, cells, layer)
        if not here.any():
            return layer
        return np.asarray(layer + (here - self._of_sides(self._sides_lower, cells, layer)) / SIDE_POISSON_STEP)

    def prepare_slope(self) -> None:
        """Compute what `by_poisson` needs."""
        self.slopes  # noqa: B018

    @property
    def slopes(self) -> Slopes:
        """What `by_poisson` needs."""
        felt = self.sides is not None and self.sides.table.any()
        return Slopes(self._poisson_slope, self._sides_lower if felt else None)

    def _of_sides(self, sides: SideTable | None, cells: Cells, like: Floats) -> Floats:
        none = np.zeros_like(like)
        if sides is None:
            return none
        normal_alone = len(like) == len(cells)
        return (
            sides.add_normal(none, self.grid, cells=cells)
            if normal_alone
            else sides.add(none, self.grid, cells, cells)
        )

    @cached_property
    def _sides_lower(self) -> SideTable | None:
        """The sides for a smaller nu; computed only for a contact near them."""
        if self.kept is not None:
            return self.kept.sides
        return side_table(self.gel, self.grid, poisson_ratio=self.poisson_ratio - SIDE_POISSON_STEP)

    @cached_property
    def _poisson_slope(self) -> CellCompliance:
        if self.kept is not None:
            return self.kept.layer
        lower = layer_cells(
            self.grid, thickness_mm=self.gel.thickness_mm, poisson_ratio=self.poisson_ratio - POISSON_STEP
        )
        return CellCompliance(self.grid, (self.layer.table - lower.table) / POISSON_STEP)


class CalibratedGel(Protocol):
    """A sensor calibrated for force; None: unknown, or not computed yet."""

    @property
    def gel(self) -> Gel | None: ...

    @property
    def material(self) -> Material | None: ...

    @property
    def mm_per_px(self) -> Pair: ...

    @property
    def compliance(self) -> GelCompliance | None: ...


def gel_compliance(gel: Gel, grid: NodeGrid, *, poisson_ratio: float, sides: bool = True) -> GelCompliance:
    """Build, or read from the cache, the compliance of `gel` for the cells of `grid`.

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
    layer = layer_cells(grid, thickness_mm=gel.thickness_mm, poisson_ratio=poisson_ratio)
    table = side_table(gel, grid, poisson_ratio=poisson_ratio) if sides else None
    return GelCompliance(gel, poisson_ratio, layer, inside, table)


def on_gel(gel: Gel, grid: NodeGrid) -> Bools:
    """Return the mask (rows, columns) of the cells that lie wholly on the gel."""
    half = grid.spacing_mm / 2
    x, y = np.abs(grid.x_mm)[None, :] + half, np.abs(grid.y_mm)[:, None] + half
    if gel.shape == "disc" and gel.radius_mm is not None:
        return np.asarray(np.hypot(x, y) <= gel.radius_mm)
    if gel.shape == "rectangle" and gel.size_mm is not None:
        return np.asarray((x <= gel.size_mm[0] / 2 + ROUNDING) & (y <= gel.size_mm[1] / 2 + ROUNDING))
    return np.ones(grid.shape, dtype=bool)


# A gel's compliance as arrays, since it takes a second, or half a minute with free sides. The key names all that
# the numbers depend on; arrays of another key are not used.

Arrays = Mapping[str, npt.NDArray[Any]]
KEY, LAYER, LAYER_SLOPE = "key", "layer", "layer_slope"
SIDES, SIDES_LOWER, STATIONS = "sides", "sides_lower", "stations"


def as_arrays(made: GelCompliance) -> dict[str, npt.NDArray[Any]]:
    """Return all that is computed of a compliance, mm/MPa at modulus 1 MPa, under its key; of any shape."""
    slopes = made.slopes
    arrays: dict[str, npt.NDArray[Any]] = {
        KEY: np.array(_key(made.gel, made.grid, made.poisson_ratio)),
        LAYER: made.layer.table,
        LAYER_SLOPE: slopes.layer.table,
    }
    if made.sides is not None:
        arrays |= {SIDES: made.sides.table, STATIONS: np.array([made.sides.rows, made.sides.columns])}
    if slopes.sides is not None:
        arrays[SIDES_LOWER] = slopes.sides.table
    return arrays


def of_arrays(arrays: Arrays, gel: Gel, *, grid: NodeGrid, poisson_ratio: float, where: object) -> GelCompliance:
    """Restore the compliance from `as_arrays`, mm/MPa, of any shape.

    Another gel's, or version's, is computed anew. Raises InputError if the arrays have the key and do not fit it.
    """
    if KEY not in arrays or str(arrays[KEY]) != _key(gel, grid, poisson_ratio):
        return gel_compliance(gel, grid, poisson_ratio=poisson_ratio)
    offsets = (2 * grid.shape[0] - 1) * (2 * grid.shape[1] - 1)
    for name in (LAYER, LAYER_SLOPE):
        _check(arrays, name, (offsets, 9), where)
    layer, slope = (CellCompliance(grid, arrays[name]) for name in (LAYER, LAYER_SLOPE))
    sides, lower = (_sides(arrays, name, where) for name in (SIDES, SIDES_LOWER))
    return GelCompliance(gel, poisson_ratio, layer, on_gel(gel, grid), sides, Slopes(slope, lower))


def _sides(arrays: Arrays, name: str, where: object) -> SideTable | None:
    if name not in arrays:
        return None
    _check(arrays, STATIONS, (2,), where)
    rows, columns = (int(count) for count in arrays[STATIONS])
    _check(arrays, name, (3 * rows * columns, 3 * rows * columns), where)
    return SideTable(arrays[name], rows, columns, STATION_MM)


def _check(arrays: Arrays, name: str, shape: tuple[int, ...], where: object) -> None:
    found = arrays.get(name)
    fits = found is not None and found.shape == shape and found.dtype.kind in "fi"
    if found is None or not fits or not np.isfinite(found).all():
        raise InputError(f"the compliance's {name} is missing or has another shape", where=where, value=shape)
    check_numbers(found, what=f"a number of the compliance's {name}", where=where)


def _key(gel: Gel, grid: NodeGrid, poisson_ratio: float) -> str:
    """Return all that the numbers depend on."""
    outline = gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, round(poisson_ratio, 9)
    steps = VERSION, WAVES, REACH, POISSON_STEP, SIDE_POISSON_STEP, STATION_MM, LOAD_MM
    return repr((*outline, grid.shape, grid.spacing_mm, *steps))
