"""From a gel as a sensor states it to its mesh."""

from __future__ import annotations

from tactilevision.gel.mesh import GelMesh
from tactilevision.gel.mesh_file import file_key, read_mesh
from tactilevision.gel.shapes import shape_mesh
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel


def geometry_key(gel: Gel) -> str:
    """Return all that a gel's mesh depends on besides the cells of the view: its geometry, or its file's content.

    Raises InputError for a file that is not there.
    """
    outline = gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, gel.thickness_ends_mm
    inside = gel.curvature_mm, gel.base, gel.axis, gel.layers
    file = None if gel.mesh is None else (file_key(gel.mesh), gel.mesh_unit, gel.seen, gel.bonded)
    return repr((outline, inside, file))


def gel_mesh(gel: Gel, x_mm: Floats, y_mm: Floats, *, spacing_mm: float) -> GelMesh:
    """Return the mesh of a gel for a view whose cells have middles x (columns,) and y (rows,), mm.

    Raises InputError for a shape or mesh file that is not possible.
    """
    if gel.shape == "mesh":
        assert gel.mesh is not None
        return read_mesh(
            gel.mesh, unit=gel.mesh_unit, seen=gel.seen, bonded=gel.bonded, thickness_mm=gel.thickness_mm
        )
    return shape_mesh(gel, x_mm, y_mm, spacing_mm=spacing_mm)
