"""From a gel as a sensor states it to its mesh."""

from __future__ import annotations

from tactilevision.errors import InputError
from tactilevision.gel.mesh import GelMesh
from tactilevision.gel.shapes import shape_mesh
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel


def gel_mesh(gel: Gel, x_mm: Floats, y_mm: Floats, *, spacing_mm: float) -> GelMesh:
    """Return the mesh of a gel for a view whose cells have middles x (columns,) and y (rows,), mm.

    Raises InputError for a shape or mesh file that is not possible.
    """
    if gel.shape == "mesh":
        raise InputError("mesh", where="gel")
    return shape_mesh(gel, x_mm, y_mm, spacing_mm=spacing_mm)
