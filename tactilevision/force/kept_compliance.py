"""A gel's compliance as arrays, so that what takes a second, or half a minute with free sides, is made once.

The key names all that the numbers depend on. Arrays of another key are not used: the compliance is made anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.door.numbers import check_numbers
from tactilevision.errors import InputError
from tactilevision.force.compliance import (
    POISSON_STEP,
    SIDE_POISSON_STEP,
    GelCompliance,
    Slopes,
    gel_compliance,
    on_gel,
)
from tactilevision.force.kernel import REACH, WAVES, CellCompliance
from tactilevision.force.lateral_boundaries.store import VERSION
from tactilevision.force.lateral_boundaries.table import LOAD_MM, STATION_MM, SideTable
from tactilevision.force.nodes import NodeGrid
from tactilevision.records import Gel

Arrays = Mapping[str, npt.NDArray[Any]]
KEY, LAYER, LAYER_SLOPE, SIDES, SIDES_LOWER, STATIONS = (
    "key",
    "layer",
    "layer_slope",
    "sides",
    "sides_lower",
    "stations",
)


def as_arrays(made: GelCompliance) -> dict[str, npt.NDArray[Any]]:
    """All that is worked out of a compliance, mm/MPa at modulus 1 MPa, under its key; of any shape."""
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
    """The compliance that `as_arrays` gave, mm/MPa, of any shape; another gel's, or version's, is made anew.

    Raises InputError where the arrays have the key and do not fit it.
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
    """All that the numbers depend on."""
    outline = gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, round(poisson_ratio, 9)
    steps = VERSION, WAVES, REACH, POISSON_STEP, SIDE_POISSON_STEP, STATION_MM, LOAD_MM
    return repr((*outline, grid.shape, grid.spacing_mm, *steps))
