"""Tabulate the contribution of the gel's free sides to its compliance, and cache the tables."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse.linalg import splu

from tactilevision.errors import InputError, OutputError
from tactilevision.files.arrays import read_arrays
from tactilevision.files.writing import replacing
from tactilevision.force.hexahedra import GelMesh, WallPoints, face_values, gel_mesh, stiffness, wall_points
from tactilevision.force.inverse import Cells
from tactilevision.force.kernel import LayerStress, layer_stress
from tactilevision.force.nodes import NodeGrid
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel

# Cache of tables that take seconds to compute, under a hash of what they depend on. The folder is
# $TACTILEVISION_CACHE, else $XDG_CACHE_HOME/tactilevision, else ~/.cache/tactilevision. A file that cannot be read
# is computed anew; a folder that cannot be written to is ignored.

VERSION = 1  # part of every hash: raise it when the numbers change


def cache_folder() -> Path:
    """Return the folder that keeps tables; it is made when something is written."""
    own = os.environ.get("TACTILEVISION_CACHE")
    if own:
        return Path(own)
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root and Path(root).is_absolute() else Path.home() / ".cache") / "tactilevision"


def kept(name: str, key: object, *, make: Callable[[], npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Return the array of `key`, of any shape and of its unit: read from the cache, else computed and kept."""
    digest = hashlib.sha256(repr((VERSION, name, key)).encode()).hexdigest()[:20]
    path = cache_folder() / f"{name}-{digest}.npz"
    found = _read(path, repr(key))
    if found is not None:
        return found
    made = make()
    try:
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, table=made, key=np.array(repr(key)))
    except OutputError:
        pass
    return made


def _read(path: Path, key: str) -> npt.NDArray[Any] | None:
    try:
        file = read_arrays(path)
        return file["table"] if str(file["key"]) == key else None
    except (OSError, KeyError, InputError):
        return None


# The sides' part of the compliance, as a table between stations on the gel's face.
#
# For a load at station p the unbounded layer has the traction s(p) at the gel's side. The side is free, so -s(p)
# acts there with no load on the face: K v = -f(s(p)). The table is v at the stations. The loads of all stations
# span few shapes at a side, so K is solved for their leading singular vectors only. Between stations the table is
# interpolated linearly, in source and receiver. Stations outside the gel, or nearer to its side than half their
# load, are moved to the nearest place that is not.
#
# The table is at most a few percent of the whole beyond one thickness from a side. Reciprocity is not imposed: it
# is a test of the mesh.

Singles = npt.NDArray[np.float32]
STATION_MM = 1.25  # mm between stations
LOAD_MM = 0.5  # mm: size of the loads of the table
FORGETS = 3.5  # thicknesses beyond which a side has no effect
RANK_TOLERANCE = 1e-4  # of the largest singular value: smaller ones are dropped
AT_ONCE = 32  # shapes solved together
MAX_ELEMENTS = 280  # squares of an element's width in the gel's face


@dataclass(frozen=True, slots=True)
class SideTable:
    """`table` (3 S, 3 S), x y z of each station in turn, mm/N at modulus 1 MPa; `rows`, `columns` of stations;
    `spacing_mm`. Stations are centred on the pad."""

    table: Singles
    rows: int
    columns: int
    spacing_mm: float

    def add(self, block: Floats, grid: NodeGrid, receivers: Cells, sources: Cells) -> Floats:
        """Add the sides' part to `block` (3 R, 3 S) of the layer; the load is a cell's, 1 MPa over its area."""
        to, to_weights = self._stations(grid, receivers)
        of, of_weights = self._stations(grid, sources)
        part = self._cut(to, of)
        if not part.any():
            return block
        inner = np.einsum("rp,piqj,sq->irjs", to_weights, part, of_weights, optimize=True)
        return np.asarray(block + grid.cell_mm2 * inner.reshape(block.shape))

    def add_normal(self, block: Floats, grid: NodeGrid, *, cells: Cells) -> Floats:
        """Add the sides' part for depth by pressure alone."""
        used, weights = self._stations(grid, cells)
        part = self._cut(used, used)[:, 2, :, 2]
        return block + grid.cell_mm2 * (weights @ part @ weights.T) if part.any() else block

    def _cut(self, to: Cells, of: Cells) -> Floats:
        count = self.rows * self.columns
        return np.asarray(self.table.reshape(count, 3, count, 3)[to][:, :, of], dtype=np.float64)

    def _stations(self, grid: NodeGrid, cells: Cells) -> tuple[Cells, Floats]:
        """Return the stations that `cells` lie between and the weights (cells, stations) of linear
        interpolation.
        """
        row, column = np.divmod(cells, grid.shape[1])
        y = np.clip(grid.y_mm[row] / self.spacing_mm + (self.rows - 1) / 2, 0, self.rows - 1.001)
        x = np.clip(grid.x_mm[column] / self.spacing_mm + (self.columns - 1) / 2, 0, self.columns - 1.001)
        low_y, low_x = y.astype(np.intp), x.astype(np.intp)
        part_y, part_x = y - low_y, x - low_x
        corner = low_y * self.columns + low_x
        steps = (0, 1, self.columns, self.columns + 1)
        shares = ((1 - part_y) * (1 - part_x), (1 - part_y) * part_x, part_y * (1 - part_x), part_y * part_x)
        used, place = np.unique(np.concatenate([corner + step for step in steps]), return_inverse=True)
        weights = np.zeros((len(cells), len(used)))
        np.add.at(weights, (np.tile(np.arange(len(cells)), 4), place), np.concatenate(shares))
        return used, weights


def side_table(gel: Gel, grid: NodeGrid, *, poisson_ratio: float) -> SideTable | None:
    """Return the table for the stations over `grid`, computed or from the cache.

    None if no side is near the view.
    """
    rows, columns = (int(np.ceil((n - 1) * grid.spacing_mm / STATION_MM)) + 1 for n in grid.shape)
    places = _admissible(gel, _station_places(rows, columns))
    if gel.shape == "unbounded" or not (_distance(gel, places) < FORGETS * gel.thickness_mm).any():
        return None
    key = (gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, round(poisson_ratio, 9), rows, columns,
           STATION_MM, LOAD_MM)  # fmt: skip
    table = kept("sides", key, make=lambda: solve_sides(gel, places, poisson_ratio=poisson_ratio))
    return SideTable(table, rows, columns, STATION_MM)


def solve_sides(gel: Gel, places_mm: Floats, *, poisson_ratio: float, element_mm: float | None = None) -> Singles:
    """Return (3 S, 3 S) displacement at `places_mm` (S, 2) that the free sides add to a force of 1 N at each,
    float32.
    """
    mesh = gel_mesh(gel, element_mm or _element_mm(gel))
    wall = wall_points(mesh)
    near = _distance(gel, places_mm) < FORGETS * gel.thickness_mm
    field = layer_stress(
        wall.depths_mm,
        LOAD_MM,
        thickness_mm=gel.thickness_mm,
        poisson_ratio=poisson_ratio,
        reach_mm=FORGETS * gel.thickness_mm,
    )
    loads = -_wall_forces(mesh, wall, field, places_mm[near])
    shapes, sizes, mix = np.linalg.svd(loads, full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    matrix = stiffness(mesh.nodes_mm, mesh.elements, poisson_ratio=poisson_ratio)[mesh.free][:, mesh.free]
    factor = splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    answers = []
    for first in range(0, rank, AT_ONCE):  # whole fields are large; only the stations are kept
        shape = shapes[:, first : min(first + AT_ONCE, rank)]
        right = np.zeros((len(mesh.free), shape.shape[1]))
        right[wall.unknowns] = shape
        answers.append(_at_places(mesh, factor.solve(right), places_mm[near]))
    seen = np.hstack(answers) @ (sizes[:rank, None] * mix[:rank])
    three = np.arange(3)
    table = np.zeros((len(places_mm), 3, len(places_mm), 3), dtype=np.float32)
    index = np.flatnonzero(near)
    table[np.ix_(index, three, index, three)] = seen.reshape(len(index), 3, len(index), 3)
    return table.reshape(3 * len(places_mm), 3 * len(places_mm))


def _element_mm(gel: Gel) -> float:
    """Return an element size of three fifths of the thickness, or the least that keeps the mesh factorised in
    seconds.
    """
    if gel.shape == "disc" and gel.radius_mm is not None:
        area = np.pi * gel.radius_mm**2
    else:
        area = float(np.prod(gel.size_mm)) if gel.size_mm is not None else 0.0
    return float(max(0.6 * gel.thickness_mm, np.sqrt(area / MAX_ELEMENTS)))


def _wall_forces(mesh: GelMesh, wall: WallPoints, field: LayerStress, places_mm: Floats) -> Floats:
    """Return (unknowns on the wall, 3 S): nodal forces of the layer's traction on the wall, by loads at
    `places_mm`.
    """
    count = len(places_mm)
    total = np.zeros((len(wall.unknowns), count, 3))
    for level in range(len(wall.depths_mm)):
        offset = wall.places_mm[:, None, :] - places_mm[None, :, :]
        stress = field.at(level, offset.reshape(-1, 2)).reshape(len(wall.places_mm), count, 3, 3, 3)
        traction = np.einsum("qplij,qj->qipl", stress[..., :2], wall.normals)
        total += np.einsum("uqi,qipl->upl", wall.weights[level], traction, optimize=True)
    return total.reshape(len(wall.unknowns), 3 * count)


def _station_places(rows: int, columns: int) -> Floats:
    x = (np.arange(columns) - (columns - 1) / 2) * STATION_MM
    y = (np.arange(rows) - (rows - 1) / 2) * STATION_MM
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _distance(gel: Gel, places_mm: Floats) -> Floats:
    """Return the distance of each place from the nearest side; below 0 outside."""
    if gel.shape == "disc" and gel.radius_mm is not None:
        return np.asarray(gel.radius_mm - np.hypot(*places_mm.T))
    if gel.shape == "rectangle" and gel.size_mm is not None:
        return np.asarray((np.array(gel.size_mm) / 2 - np.abs(places_mm)).min(axis=1))
    return np.full(len(places_mm), np.inf)


def _admissible(gel: Gel, places_mm: Floats) -> Floats:
    """Return each place, or the nearest one that keeps half a load's distance from the side."""
    keep = LOAD_MM / 2
    if gel.shape == "disc" and gel.radius_mm is not None:
        distance = np.hypot(*places_mm.T)
        return np.asarray(
            places_mm * np.minimum(1.0, (gel.radius_mm - keep) / np.maximum(distance, 1e-9))[:, None]
        )
    if gel.shape == "rectangle" and gel.size_mm is not None:
        most = np.array(gel.size_mm) / 2 - keep
        return np.clip(places_mm, -most, most)
    return places_mm


def _at_places(mesh: GelMesh, answer: Floats, places_mm: Floats) -> Floats:
    """Return (3 P, R): the solutions at places on the free face, interpolated by the elements' own functions."""
    nodes, values = face_values(mesh, places_mm)
    unknowns = answer[: 3 * mesh.per_layer].reshape(mesh.per_layer, 3, -1)
    return np.asarray(np.einsum("pn,pnir->pir", values, unknowns[nodes]).reshape(3 * len(places_mm), -1))
