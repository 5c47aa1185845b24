"""Compliance between the cells of a gel of any shape, by finite elements, along the local axes of its surface.

Traction is a force per area of the picture (gel/surface.py), so the matrix is symmetric and the algebra that of a
flat layer. Modulus 1 MPa.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.cache import kept
from tactilevision.force.kernel import layer_cells
from tactilevision.force.large_depth import WIDEST
from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.gel.mesh import GelMesh
from tactilevision.gel.mesh_file import file_key, read_mesh
from tactilevision.gel.shapes import shape_mesh
from tactilevision.gel.surface import SurfaceCells, surface_cells
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Gel

Singles = npt.NDArray[np.float32]
NAME = "mesh-compliance"
POISSON_STEP = 2e-3  # step in Poisson's ratio of the compliance's derivative, single precision
MOST_CELLS = 4000  # cells of a view: the matrix of more takes over half a gigabyte
MOST_DEEP = 0.8  # of the local thickness: a displacement beyond is not possible
OFF_GEL = 0.1  # of the tracked cells: more beside the gel are a wrong mesh, or a wrong origin of it


@dataclass(frozen=True)
class MeshCompliance:
    """`table` (3 n, 3 n), mm/MPa, displacement by traction over the cells of `grid`: t1 of all, t2 of all, normal.

    `slopes` is its derivative by nu, None if not computed; `surface` has the cells' places and axes.
    """

    gel: Gel
    poisson_ratio: float
    grid: NodeGrid
    surface: SurfaceCells
    table: Singles = field(repr=False)
    slopes: Singles | None = field(repr=False)
    stiffness: float = 1.0

    sides = None  # they are part of the mesh

    @property
    def inside(self) -> Bools:
        """Return the cells (rows, columns) wholly on the gel."""
        return self.surface.inside

    @property
    def cell_unit(self) -> float:
        """Return the size of a cell over its reduced modulus, mm/MPa at modulus 1 MPa."""
        return self.grid.spacing_mm * (1 - self.poisson_ratio**2) / self.stiffness

    def block(self, cells: Cells, parts: int = 3) -> Floats:
        """Return displacement by traction between cells, (parts C, parts C), mm/MPa."""
        return self._block(self.table, cells, parts)

    def by_poisson(self, cells: Cells, traction: Floats) -> Floats:
        """Return the derivative by nu, (parts C,), of the displacement by `traction` (parts, C) on these cells."""
        assert self.slopes is not None
        return np.asarray(self._block(self.slopes, cells, len(traction)) @ traction.ravel())

    def at(self, poisson_ratio: float) -> MeshCompliance:
        """Return the compliance at another nu, to first order."""
        assert self.slopes is not None
        moved = self.table + np.float32(poisson_ratio - self.poisson_ratio) * self.slopes
        return replace(self, poisson_ratio=poisson_ratio, table=moved)

    def depth(self, cells: Cells, traction: Floats) -> Floats:
        """Return the normal displacement (rows, columns), mm, everywhere that `traction` (3 or 1, C) makes."""
        count = self.inside.size
        places = self._places(cells, len(traction))
        moved = (
            traction.ravel().astype(np.float32) @ self.table[places, 2 * count :]
        )  # symmetric: rows are quicker
        return np.asarray(moved.reshape(self.grid.shape), dtype=np.float64)

    def _block(self, table: Singles, cells: Cells, parts: int) -> Floats:
        places = self._places(cells, parts)
        return np.asarray(table.ravel().take(places[:, None] * len(table) + places), dtype=np.float64)

    def _places(self, cells: Cells, parts: int) -> Cells:
        return np.concatenate([cells + k * self.inside.size for k in range(3 - parts, 3)])

    def check_shear(self, known: Bools) -> None:
        """Raise InputError where `known` shear (rows, columns), a mask, lies beside the gel."""
        off = int(np.count_nonzero(known & ~self.inside)) / max(int(np.count_nonzero(known)), 1)
        if off > OFF_GEL:
            raise InputError(
                f"{100 * off:.0f} % of the tracked markers lie outside the gel's mesh",
                where="ForceField",
                value=f"{np.count_nonzero(self.inside)} of {self.inside.size} cells are on the gel",
                remedy="Check the mesh's origin, the picture's centre, and mm_per_px.",
            )

    def check_depth(self, moved_mm: Floats, known: Bools) -> None:
        """Raise InputError where the normal displacement (rows, columns) exceeds the gel at `known` cells."""
        share = np.where(known, moved_mm, 0.0).ravel() / self.surface.thickness_mm
        worst = int(np.argmax(share))
        if share[worst] > MOST_DEEP:
            raise InputError(
                "the displacement is larger than the gel allows",
                where="ForceField",
                value=f"{moved_mm.flat[worst]:.3g} mm where it is {self.surface.thickness_mm[worst]:.3g} mm thick",
                remedy="Check the mesh's unit, thickness_mm, and the light's calibration.",
            )


def mesh_compliance(gel: Gel, grid: NodeGrid, *, poisson_ratio: float, slopes: bool = False) -> MeshCompliance:
    """Compute, or read from the cache, the compliance of a gel's shape or mesh file.

    The cache is by shape or file, sets, cells and nu. Raises InputError for a shape or mesh that is not possible,
    or a view of too many cells.
    """

    def mesh() -> GelMesh:
        if gel.shape != "mesh" or gel.mesh is None:
            return shape_mesh(gel, grid.x_mm, grid.y_mm, spacing_mm=grid.spacing_mm)
        sets = {"seen": gel.seen, "bonded": gel.bonded}
        return read_mesh(gel.mesh, unit=gel.mesh_unit, **sets, thickness_mm=gel.thickness_mm)

    return _made(mesh, _geometry_key(gel), gel, grid, poisson_ratio, slopes)


def _geometry_key(gel: Gel) -> str:
    """Return all that a gel's mesh depends on besides the cells: its geometry, or its file's content."""
    outline = gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, gel.thickness_ends_mm
    inside = gel.curvature_mm, gel.base, gel.axis, gel.layers
    file = None if gel.mesh is None else (file_key(gel.mesh), gel.mesh_unit, gel.seen, gel.bonded)
    return repr((outline, inside, file))


def compliance_of(
    mesh: GelMesh, gel: Gel, grid: NodeGrid, *, poisson_ratio: float, slopes: bool = False
) -> MeshCompliance:
    """Compute, or read from the cache, the compliance of a mesh; `gel` has its thickness.

    Raises InputError for a view of too many cells.
    """
    return _made(lambda: mesh, mesh.key, gel, grid, poisson_ratio, slopes)


def _made(
    mesh: Callable[[], GelMesh], key: str, gel: Gel, grid: NodeGrid, nu: float, slopes: bool
) -> MeshCompliance:
    count = grid.shape[0] * grid.shape[1]
    if count > MOST_CELLS:
        raise InputError(
            f"the view has {count} cells, more than {MOST_CELLS}",
            where=f"gel {gel.shape}",
            value=f"{grid.spacing_mm:g} mm",
            remedy="Give ForceSettings a wider spacing_mm, or read a part of the view.",
        )

    def arrays(nu: float) -> dict[str, npt.NDArray[Any]]:
        whole = key, grid.shape, grid.spacing_mm, round(nu, 9)
        files = kept(NAME, whole, make=lambda: {n: one.tobytes() for n, one in _solved(mesh(), grid, nu).items()})
        return {n: np.frombuffer(files[n], kind).reshape(shape) for n, (kind, shape) in forms.items()}

    forms = _surface_forms(grid) | {"table": (np.float32, (3 * count,) * 2), "stiffness": (np.float64, ())}
    found, change = arrays(nu), None
    if slopes:
        change = (found["table"] - arrays(nu - POISSON_STEP)["table"]) / np.float32(POISSON_STEP)
    places = {name: found[name] for name in _surface_forms(grid)}
    surface = SurfaceCells(grid.shape, grid.spacing_mm, **places, camera_mm=gel.camera_mm)
    return MeshCompliance(gel, nu, grid, surface, found["table"], change, float(found["stiffness"]))


def _surface_forms(grid: NodeGrid) -> dict[str, tuple[type, tuple[int, ...]]]:
    """Return the type and shape of the arrays of SurfaceCells, kept as bytes: copied once as they are read."""
    count = grid.shape[0] * grid.shape[1]
    places: dict[str, tuple[type, tuple[int, ...]]] = {
        "places_mm": (np.float64, (count, 3)),
        "frames": (np.float64, (count, 3, 3)),
    }
    return places | {"thickness_mm": (np.float64, (count,)), "inside": (np.bool_, grid.shape)}


def _solved(mesh: GelMesh, grid: NodeGrid, nu: float) -> dict[str, npt.NDArray[Any]]:
    """Return the table (3 n, 3 n), mm/MPa, of displacement by traction along local axes, and the surface."""
    surface, shares = surface_cells(mesh, grid.x_mm, grid.y_mm, spacing_mm=grid.spacing_mm)
    table, turn = mesh.compliance(shares, poisson_ratio=nu), surface.frames.astype(np.float32)
    for n, frame in enumerate(turn):
        table[:, n] = np.tensordot(frame, table[:, n], axes=1)
    for n, frame in enumerate(turn):
        table[:, :, :, n] = table[:, :, :, n] @ frame.T
    table *= np.float32(grid.cell_mm2)
    size = 3 * len(turn)
    arrays = {name: getattr(surface, name) for name in _surface_forms(grid)}
    return arrays | {"table": table.reshape(size, size), "stiffness": np.array(mesh.seen_stiffness)}


# What a flat layer would have to be to feel alike: the paper's equivalent thickness, and why it is not used.

MOST_COARSE = 0.02  # of the displacement under a pressure: change from a mesh to a finer one
STATIONS = 4  # along either side of the view, where the stiffness under a punch is compared with a layer's
THICKNESSES = (0.3, 3.0)  # of the gel's: range of equivalent thicknesses that is searched


def punch_ratios(made: MeshCompliance) -> Floats:
    """Return the stiffness (n,) under punches as wide as the gel is thick, over that of the flat layer, a ratio.

    The first stands at the picture's centre, the others on a grid of the view; those partly beside the gel count
    with their part on it.
    """
    flat = layer_cells(made.grid, thickness_mm=made.gel.thickness_mm, poisson_ratio=made.poisson_ratio)
    found = []
    for cells in _stations(made):
        unit = np.ones(len(cells))
        here, there = (np.linalg.solve(one.block(cells, 1), unit).sum() for one in (made, flat))
        found.append(here / there)
    return np.array(found)


def _stations(made: MeshCompliance) -> list[Cells]:
    grid, reach = made.grid, max(made.gel.thickness_mm, made.grid.spacing_mm)
    x, y, _ = made.surface.places_mm.T
    step = (np.arange(STATIONS) + 0.5) / STATIONS - 0.5
    middles = [(0.0, 0.0), *((a * np.ptp(grid.x_mm), b * np.ptp(grid.y_mm)) for a in step for b in step)]
    every = (np.flatnonzero((np.hypot(x - a, y - b) <= reach) & made.inside.ravel()) for a, b in middles)
    return [cells for cells in every if len(cells)]


def equivalent_thickness_mm(made: MeshCompliance) -> tuple[float, float, float]:
    """Return the thickness, mm, of the flat layer as stiff under a punch as this gel is at the picture's centre.

    Then the least and the greatest over the view.

        a kappa(nu, a/h') / [a kappa(nu, a/h)] = ratio,      a = h

    One thickness does not describe a curved gel: the range is what it is worth.
    """
    tried = made.gel.thickness_mm * np.geomspace(*THICKNESSES, 60)
    kappa = np.asarray(fast_kappa(made.poisson_ratio, np.minimum(made.gel.thickness_mm / tried, WIDEST)))
    stiff = kappa / fast_kappa(made.poisson_ratio, 1.0)
    found = np.interp(-punch_ratios(made), -stiff, tried)
    return float(found[0]), float(found.min()), float(found.max())


def check_coarse(made: MeshCompliance, finer: MeshCompliance) -> float:
    """Return by which share the mean displacement under a pressure changes from a mesh to a finer one of the gel.

    The pressure is that on the punches of `punch_ratios`. Raises InputError where the change exceeds MOST_COARSE.
    """
    moved = [np.array([one.block(cells, 1).sum() for cells in _stations(made)]) for one in (made, finer)]
    off = float(np.abs(moved[0] / moved[1] - 1).max())
    if off > MOST_COARSE:
        raise InputError(
            "the mesh is too coarse: a finer one has another stiffness",
            where="check_coarse",
            value=f"{100 * off:.1f} %",
            remedy="Halve the elements of the seen surface; one a cell is enough for hexahedra.",
        )
    return off
