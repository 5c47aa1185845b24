"""A load near the side of a round gel: finite elements of another kind (NGSolve, tetrahedra) against ours.

Truth: displacement of third order on tetrahedra, 15 mm by 3 mm disc bonded to its base, side and face free, a
smooth round load on the face. It shares nothing with the library but the elastic constants.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.force_cases import View, seen
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

RADIUS_MM, THICKNESS_MM, PATCH_MM = 15.0, 3.0, 1.5
GEL, MATERIAL = Gel(THICKNESS_MM, shape="disc", radius_mm=RADIUS_MM), Material(0.2, 0.48)
FORCE_N = (0.1, -0.05, 0.3)
VIEW = View((96, 166), 0.171, 1)


def loaded_disc(x_mm: Floats, y_mm: Floats, centre_mm: float) -> Floats:
    """Displacement (3, ...) at places of the face, FORCE_N on a patch round (centre_mm, 0); NaN off the gel."""
    mesh = _disc(centre_mm)
    answer = _pushed(mesh, centre_mm)
    inside = np.hypot(x_mm, y_mm) < RADIUS_MM - 0.02
    moved = np.full((3, *x_mm.shape), np.nan)
    points = mesh(x_mm[inside], y_mm[inside], np.full(int(inside.sum()), 1e-7))
    moved[:, inside] = np.asarray(answer(points)).T
    return moved


def _disc(centre_mm: float) -> Any:
    """NGSolve's mesh of the gel, fine under the patch, its faces named; z runs into it."""
    from netgen.occ import Box, Cylinder, Glue, OCCGeometry, Z
    from ngsolve import Mesh

    whole = Cylinder((0, 0, 0), Z, r=RADIUS_MM, h=THICKNESS_MM)
    near = whole * Box((centre_mm - 3, -3, 0), (centre_mm + 3, 3, 1.2))
    near.faces.maxh = 0.6
    gel = Glue([near, whole - near])
    for face in gel.faces:
        level = round(face.center.z, 6)
        face.name = {0.0: "top", THICKNESS_MM: "base"}.get(level, "side")
    mesh = Mesh(OCCGeometry(gel).GenerateMesh(maxh=2.2))
    mesh.Curve(3)
    return mesh


def elastic(mesh: Any, material: Material) -> tuple[Any, Any]:
    """The space of third order in NGSolve, fixed at the set "base", and the assembled form of an elastic solid."""
    import ngsolve as ng

    space = ng.VectorH1(mesh, order=3, dirichlet="base")
    u, v = space.TnT()
    e, nu = material.youngs_modulus_MPa, material.poisson_ratio
    mu, lame = e / (2 * (1 + nu)), e * nu / ((1 + nu) * (1 - 2 * nu))
    strain, virtual = ng.Sym(ng.Grad(u)), ng.Sym(ng.Grad(v))
    form = ng.BilinearForm(space, symmetric=True)
    form += ng.InnerProduct(2 * mu * strain, virtual) * ng.dx + lame * ng.div(u) * ng.div(v) * ng.dx
    form.Assemble()
    return space, form


def _pushed(mesh: Any, centre_mm: float) -> Any:
    """The displacement that FORCE_N on the patch makes, a function on the mesh."""
    import ngsolve as ng

    space, form = elastic(mesh, MATERIAL)
    v = space.TestFunction()
    square = ((ng.x - centre_mm) ** 2 + ng.y**2) / PATCH_MM**2
    pressure = ng.IfPos(1 - square, 1 - square, 0) * 2 / (np.pi * PATCH_MM**2)
    load = ng.LinearForm(space)
    for axis, force in enumerate(FORCE_N):
        load += force * pressure * v[axis] * ng.ds("top", bonus_intorder=6)
    load.Assemble()
    answer = ng.GridFunction(space)
    answer.vec.data = form.mat.Inverse(space.FreeDofs(), "sparsecholesky") * load.vec
    return answer


def near_the_side(away_mm: float, *, std_mm: float = 0.005) -> tuple[Floats, Floats]:
    """Error (3,) of the resultant over its size for a load `away_mm` from the side, with the sides and without."""
    x, y = VIEW.mesh()
    u = loaded_disc(x, y, RADIUS_MM - away_mm)
    height, shear = seen(np.nan_to_num(u), VIEW, std_mm=std_mm, rng=np.random.default_rng(7))
    scale = (VIEW.mm_per_px, VIEW.mm_per_px)
    off = []
    for sides in (True, False):
        settings = ForceSettings(large_depth=False, sides=sides)
        found = ForceField(GEL, MATERIAL, scale, settings=settings)(height, shear)
        off.append((np.asarray(found.resultant_N) - FORCE_N) / np.linalg.norm(FORCE_N))
    return off[0], off[1]


def main(away_mm: Sequence[float] = (2.5, 3.5, 5.0)) -> None:
    """Print the table, or why there is none."""
    if find_spec("ngsolve") is None:
        print("NGSolve is not installed: nothing to compare with")
        return
    for away in away_mm:
        held, free = (np.round(100 * part, 2) for part in near_the_side(away))
        print(f"patch of {PATCH_MM} mm, {away} mm from the side: off by {held} %; taken for unbounded: {free} %")


def quick() -> None:
    main((5.0,))


if __name__ == "__main__":
    main()
