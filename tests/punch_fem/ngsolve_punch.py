"""The glued flat punch in NGSolve: P2/P1 triangles, neo-Hooke with a pressure unknown, axisymmetric."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactilevision.mechanics.punch_fem.laws import bulk_modulus_MPa, shear_modulus_MPa
from tactilevision.records import Floats, Material


def ngsolve_glued_forces(
    material: Material, radius_mm: float, thickness_mm: float, pad_mm: float, depths_mm: Floats
) -> Floats:
    """Force (N) at each depth, nodes of the face glued to the punch."""
    import ngsolve as ng

    mesh = _mesh(radius_mm, thickness_mm, pad_mm)
    displacement = ng.VectorH1(mesh, order=2, dirichletx="axis|base|face", dirichlety="base|face")
    space = displacement * ng.H1(mesh, order=1)
    (u, p), solution = space.TrialFunction(), ng.GridFunction(space)
    r, grad = ng.x, ng.Grad(u)
    F = grad + ng.Id(2)
    hoop = 1 + u[0] / r
    J = ng.Det(F) * hoop
    mu, bulk = shear_modulus_MPa(material), bulk_modulus_MPa(material)
    energy = mu / 2 * (J ** (-2 / 3) * (ng.InnerProduct(F, F) + hoop**2) - 3) + p * (J - 1) - p**2 / (2 * bulk)
    form = ng.BilinearForm(space, symmetric=True)
    form += ng.Variation(2 * np.pi * r * energy * ng.dx(bonus_intorder=2))
    forces = []
    for depth in _steps(depths_mm):
        _move_face(solution, mesh, -depth, ng)
        ng.solvers.Newton(form, solution, printing=False, maxerr=1e-9, inverse="umfpack")
        if np.isclose(depth, depths_mm).any():
            forces.append(_reaction(form, solution, space, mesh, ng))
    return np.array(forces)


def _mesh(radius_mm: float, thickness_mm: float, pad_mm: float) -> Any:
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    outline = SplineGeometry()
    corners = [(0, 0), (pad_mm, 0), (pad_mm, thickness_mm), (radius_mm, thickness_mm), (0, thickness_mm)]
    sizes = [0.4, 0.4, 0.4, 0.05, 0.4]
    points = [outline.AppendPoint(*place, size) for place, size in zip(corners, sizes, strict=True)]
    for i, name in enumerate(["base", "side", "top", "face", "axis"]):
        outline.Append(["line", points[i], points[(i + 1) % 5]], bc=name)
    return ng.Mesh(outline.GenerateMesh(maxh=0.4, grading=0.2))


def _steps(depths_mm: Floats) -> Floats:
    """Four even steps up to each depth."""
    starts = np.append(0.0, depths_mm[:-1])
    return np.concatenate([np.linspace(a, b, 5)[1:] for a, b in zip(starts, depths_mm, strict=True)])


def _move_face(solution: Any, mesh: Any, to_mm: float, ng: Any) -> None:
    moved = ng.GridFunction(solution.components[0].space)
    moved.Set(ng.CF((0, to_mm)), definedon=mesh.Boundaries("face"))
    on_face = solution.components[0].space.GetDofs(mesh.Boundaries("face"))
    values, target = solution.components[0].vec.FV().NumPy(), moved.vec.FV().NumPy()
    chosen = np.array([on_face[i] for i in range(len(values))])
    values[chosen] = target[chosen]


def _reaction(form: Any, solution: Any, space: Any, mesh: Any, ng: Any) -> float:
    residual = solution.vec.CreateVector()
    form.Apply(solution.vec, residual)
    lift = ng.GridFunction(space)
    lift.components[0].Set(ng.CF((0, 1)), definedon=mesh.Boundaries("face"))
    return -float(ng.InnerProduct(residual, lift.vec))
