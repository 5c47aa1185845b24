"""Compliance between the cells of a gel of any shape, by finite elements, along the local axes of its surface.

Traction is a force per area of the picture (gel/surface.py), so the matrix is symmetric and the algebra that of a
flat layer. Modulus 1 MPa.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.cache import kept_array
from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.gel.mesh import GelMesh
from tactilevision.gel.solid import gel_mesh
from tactilevision.gel.surface import SurfaceCells, surface_cells
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Gel

Singles = npt.NDArray[np.float32]
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

    def by_poisson(self, cells: Cells, parts: int) -> Floats:
        """Return the derivative of the cells' own block by nu, (parts C, parts C), mm/MPa."""
        assert self.slopes is not None
        return self._block(self.slopes, cells, parts)

    def depth(self, cells: Cells, traction: Floats) -> Floats:
        """Return the normal displacement (rows, columns), mm, everywhere that `traction` (3 or 1, C) makes."""
        count = self.inside.size
        places = self._places(cells, len(traction))
        moved = self.table[2 * count :, places] @ traction.ravel().astype(np.float32)
        return np.asarray(moved.reshape(self.grid.shape), dtype=np.float64)

    def _block(self, table: Singles, cells: Cells, parts: int) -> Floats:
        places = self._places(cells, parts)
        return table[np.ix_(places, places)].astype(np.float64)

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

    Raises InputError for a shape or mesh that is not possible, or a view of too many cells.
    """
    return compliance_of(
        gel_mesh(gel, grid.x_mm, grid.y_mm, spacing_mm=grid.spacing_mm),
        gel,
        grid,
        poisson_ratio=poisson_ratio,
        slopes=slopes,
    )


def compliance_of(
    mesh: GelMesh, gel: Gel, grid: NodeGrid, *, poisson_ratio: float, slopes: bool = False
) -> MeshCompliance:
    """Compute, or read from the cache, the compliance of a mesh; `gel` has its thickness.

    The cache is by the mesh with its sets, the cells and nu. Raises InputError for a view of too many cells.
    """
    count = grid.shape[0] * grid.shape[1]
    if count > MOST_CELLS:
        raise InputError(
            f"the view has {count} cells, more than {MOST_CELLS}",
            where=mesh.name,
            value=f"{grid.spacing_mm:g} mm",
            remedy="Give ForceSettings a wider spacing_mm, or read a part of the view.",
        )
    surface = surface_cells(mesh, grid.x_mm, grid.y_mm, spacing_mm=grid.spacing_mm)

    def table(nu: float) -> Singles:
        key = mesh.key, grid.shape, grid.spacing_mm, round(nu, 9)
        return kept_array("mesh-compliance", key, make=lambda: _table(mesh, surface, nu))

    whole = table(poisson_ratio)
    change = None
    if slopes:
        change = (whole - table(poisson_ratio - POISSON_STEP)) / np.float32(POISSON_STEP)
    return MeshCompliance(gel, poisson_ratio, grid, surface, whole, change, mesh.seen_stiffness)


def _table(mesh: GelMesh, surface: SurfaceCells, nu: float) -> Singles:
    """Return displacement by traction along local axes, (3 n, 3 n)."""
    found = mesh.compliance(surface.shares, poisson_ratio=nu)
    turn = surface.frames.astype(np.float32)
    found = np.einsum("nai,inxm->anxm", turn, found, optimize=True)
    found = np.einsum("mbj,anjm->anbm", turn, found, optimize=True)
    size = 3 * turn.shape[0]
    return np.asarray(found.reshape(size, size) * np.float32(surface.spacing_mm**2), dtype=np.float32)
