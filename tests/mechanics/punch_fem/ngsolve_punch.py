"""The flat punch in NGSolve: P2/P1 triangles, neo-Hooke with a pressure unknown, axisymmetric.

Glued, or sliding without friction: contact is then conservative, so that a penalty energy on the surface is all.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.records.measured import Floats, Material


def ngsolve_glued_forces(
    material: Material, radius_mm: float, thickness_mm: float, pad_mm: float, depths_mm: Floats
) -> Floats:
    """Force (N) at each depth, nodes of the face glued to the punch."""
    import ngsolve as ng

    mesh = _mesh(radius_mm, thickness_mm, pad_mm)
    displacement = ng.VectorH1(mesh, order=2, dirichletx="axis|base|face", dirichlety="base|face")
    space = displacement * ng.H1(mesh, order=1)
    solution, form = ng.GridFunction(space), _elastic(space, material, ng)
    forces = []
    for depth in _steps(depths_mm):
        _move_face(solution, mesh, -depth, ng)
        ng.solvers.Newton(form, solution, printing=False, maxerr=1e-9, inverse="umfpack")
        if np.isclose(depth, depths_mm).any():
            forces.append(_reaction(form, solution, space, mesh, ng))
    return np.array(forces)


def ngsolve_sliding_forces(
    material: Material, punch: RoundedPunch, thickness_mm: float, pad_mm: float, depths_mm: Floats
) -> Floats:
    """Force (N) at each depth of a frictionless punch with a rounded edge in true contact."""
    import ngsolve as ng

    mesh = _rounded_mesh(punch, thickness_mm, pad_mm)
    space = ng.VectorH1(mesh, order=2, dirichletx="axis|base", dirichlety="base") * ng.H1(mesh, order=1)
    solution, form, depth = ng.GridFunction(space), _elastic(space, material, ng), ng.Parameter(0.0)
    stiffness = 240 * material.youngs_modulus_MPa / punch.edge_radius_mm
    (u, _), top = space.TrialFunction(), ng.ds("top", bonus_intorder=8)
    gap, _ = _gap(u, depth, punch, ng)
    form += ng.Variation(np.pi * ng.x * stiffness * ng.IfPos(gap, 0, gap) ** 2 * top)
    gap, upward = _gap(solution.components[0], depth, punch, ng)
    pressure = stiffness * ng.IfPos(gap, 0, -gap)
    forces, at = [], 0.0
    for target in depths_mm:
        _march(form, solution, depth, (at, float(target)), punch.edge_radius_mm / 4)
        at = float(target)
        forces.append(float(ng.Integrate(2 * np.pi * ng.x * pressure * upward * top, mesh)))
    return np.array(forces)


def _march(form: Any, solution: Any, depth: Any, way_mm: tuple[float, float], step_mm: float) -> None:
    """From one depth to another; a step that fails is halved, one that is easy lets the next grow."""
    import ngsolve as ng

    at, end = way_mm
    slope = None
    while at < end - 1e-12:
        assert step_mm > 1e-4, f"NGSolve found no equilibrium beyond {at:g} mm"
        aim, last = min(at + step_mm, end), solution.vec.CreateVector()
        last.data = solution.vec
        if slope is not None:
            solution.vec.data += (aim - at) * slope
        depth.Set(aim)
        try:
            status, count = ng.solvers.Newton(
                form, solution, printing=False, maxerr=1e-8, maxit=25, inverse="umfpack"
            )
        except Exception:  # what NGSolve raises where a matrix is singular has no public name
            status, count = -1, 0
        if status != 0:
            solution.vec.data, step_mm, slope = last, step_mm / 2, None
            continue
        slope = solution.vec.CreateVector()
        slope.data = (1 / (aim - at)) * (solution.vec - last)
        at, step_mm = aim, step_mm * 1.5 if count <= 6 else step_mm


def _elastic(space: Any, material: Material, ng: Any) -> Any:
    (u, p), r = space.TrialFunction(), ng.x
    F = ng.Grad(u) + ng.Id(2)
    hoop = 1 + u[0] / r
    J = ng.Det(F) * hoop
    mu, bulk = material.shear_modulus_MPa, material.bulk_modulus_MPa
    energy = mu / 2 * (J ** (-2 / 3) * (ng.InnerProduct(F, F) + hoop**2) - 3) + p * (J - 1) - p**2 / (2 * bulk)
    form = ng.BilinearForm(space, symmetric=True)
    form += ng.Variation(2 * np.pi * r * energy * ng.dx(bonus_intorder=2))
    return form


def _gap(u: Any, depth: Any, punch: RoundedPunch, ng: Any) -> tuple[Any, Any]:
    """Distance of the surface from the punch (negative inside), and the share of the normal along the axis."""
    rho = punch.edge_radius_mm
    beside, below = ng.x + u[0] - (punch.radius_mm - rho), rho - (u[1] + depth)
    beside, below = ng.IfPos(beside, beside, 0), ng.IfPos(below, below, 0)
    reach = ng.sqrt(beside**2 + below**2 + 1e-20)
    return reach - rho, below / reach


def _rounded_mesh(punch: RoundedPunch, thickness_mm: float, pad_mm: float) -> Any:
    """Fine along the surface from .35 mm within the punch's rim, since gel slides out from there."""
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    fine, coarse = punch.edge_radius_mm / 3, thickness_mm / 7.5
    outline, inner, outer = SplineGeometry(), punch.radius_mm - 0.35, punch.radius_mm + 2 * punch.edge_radius_mm
    corners = [
        (0, 0),
        (pad_mm, 0),
        (pad_mm, thickness_mm),
        (outer, thickness_mm),
        (inner, thickness_mm),
        (0, thickness_mm),
    ]
    sizes = [coarse, coarse, coarse, fine, fine, coarse]
    points = [outline.AppendPoint(*place, size) for place, size in zip(corners, sizes, strict=True)]
    for i, name in enumerate(["base", "side", "top", "top", "top", "axis"]):
        outline.Append(["line", points[i], points[(i + 1) % 6]], bc=name, maxh=fine if i == 3 else coarse)
    return ng.Mesh(outline.GenerateMesh(maxh=coarse, grading=0.2))


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
