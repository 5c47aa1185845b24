"""The mixed elements: patch test, Lame's cylinder at the right rates, tangents against differences."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from each import each

from tactilevision.mechanics.punch_fem.discretisation import (
    Discretisation,
    assemble,
    discretise,
    factorise,
    find_pattern,
    scatter,
)
from tactilevision.mechanics.punch_fem.laws import Hencky, Law, NeoHooke
from tactilevision.mechanics.punch_fem.solid import corner_volumes, deform, linearise, stored_energy
from tactilevision.records.measured import Floats, Material


def ring(elements: int, inner_mm: float = 1.0) -> Discretisation:
    """A cylinder's wall from r = inner_mm to inner_mm + 1, z from 0 to 1."""
    lines = np.linspace(0, 1, elements + 1)
    return discretise(skfem.MeshQuad.init_tensor(inner_mm + lines, lines))


def crooked(elements: int) -> Discretisation:
    """A full disc whose inner mesh lines are bent at random."""
    lines = np.linspace(0, 1, elements + 1)
    mesh = skfem.MeshQuad.init_tensor(lines, lines)
    p = mesh.p.copy()
    inside = np.all((p > 1e-9) & (p < 1 - 1e-9), axis=0)
    p[:, inside] += 0.2 / elements * np.random.default_rng(3).uniform(-1, 1, (2, int(inside.sum())))
    return discretise(skfem.MeshQuad(p, mesh.t))


def boundary(mesh: Discretisation) -> np.ndarray:
    """Which unknowns lie on the outline (the punch's own counts as one)."""
    r, z = mesh.nodes_mm.T
    nodes = np.isclose(r, r.min()) | np.isclose(r, r.max()) | np.isclose(z, z.min()) | np.isclose(z, z.max())
    return np.append(np.repeat(nodes, 2), True)


def solve(mesh: Discretisation, material: Material, law: Law, prescribed: Floats) -> tuple[Floats, Floats]:
    """Newton's method with `prescribed` (N,) on the outline, a disturbed guess inside; gives both unknowns."""
    inside = ~boundary(mesh)
    pattern = find_pattern((mesh.dofs,), inside)
    free = pattern.free
    u = prescribed + np.where(inside, 0.02 * np.abs(prescribed).max() * np.sin(np.arange(mesh.size)), 0.0)
    pressure = np.zeros((len(mesh.dofs), 3))
    for _ in range(12):
        system = linearise(mesh, law, material=material, state=deform(mesh, u), pressure=pressure)
        right = -scatter(mesh.size, (mesh.dofs,), forces=(system.force,))
        du = np.zeros(mesh.size)
        du[free] = factorise(assemble(pattern, (system.stiffness,))).solve(right[free])
        u = u + du
        pressure = pressure + system.recover_constant - (system.recover_slope @ du[mesh.dofs][:, :, None])[:, :, 0]
    assert np.abs(du).max() < 1e-13
    return u, pressure


@each("law", [NeoHooke(), Hencky()])
@each("nu", [0.3, 0.4999])
def test_patch_of_crooked_elements_deforms_evenly(law: Law, nu: float) -> None:
    mesh, material = crooked(3), Material(1.0, nu)
    prescribed = np.zeros(mesh.size)
    prescribed[:-1:2] = 0.06 * mesh.nodes_mm[:, 0]
    prescribed[1:-1:2] = -0.11 * mesh.nodes_mm[:, 1]
    u, pressure = solve(mesh, material, law, prescribed)
    np.testing.assert_allclose(u[:-1], prescribed[:-1], atol=1e-12)
    volume = law.volume(np.array([1.06**2 * 0.89]))[0]
    np.testing.assert_allclose(pressure[:, 0], material.bulk_modulus_MPa * volume[0], rtol=1e-9)
    assert np.abs(pressure[:, 1:]).max() < 1e-8 * abs(pressure[0, 0])


@pytest.mark.parametrize("nu", [0.3, 0.4999])
def test_lame_cylinder_converges_at_third_order(nu: float) -> None:
    """u_r = A r + B / r at u_z = 0 solves the linear equations of a thick tube for any nu (Lame 1852)."""
    errors = []
    for elements in (2, 4, 8):
        mesh = ring(elements, inner_mm=0.3)
        r = mesh.nodes_mm[:, 0]
        exact = np.zeros(mesh.size)
        exact[:-1:2] = 1e-7 * ((1 - 2 * nu) * r + 0.3 / r)
        u, _ = solve(mesh, Material(1.0, nu), NeoHooke(), exact)
        true = np.einsum("eqn,en->eq", mesh.values, u[mesh.dofs[:, :9]])
        place = mesh.points_mm[..., 0]
        wrong = true - 1e-7 * ((1 - 2 * nu) * place + 0.3 / place)
        errors.append(np.sqrt((mesh.weight_mm3 * wrong**2).sum()))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] > 2.6
    assert errors[-1] < 2e-3 * 1e-7


@pytest.mark.parametrize("law", [NeoHooke(), Hencky()], ids=["neo-hooke", "hencky"])
def test_forces_are_the_slope_of_the_energy_and_stiffness_the_slope_of_the_forces(law: Law) -> None:
    rng = np.random.default_rng(8)
    mesh, material = crooked(3), Material(1.0, 0.47)
    u = 0.02 * rng.normal(size=mesh.size)
    pressure = 0.1 * rng.normal(size=(len(mesh.dofs), 3))
    way, step = rng.normal(size=mesh.size), 1e-6
    here = linearise(mesh, law, material=material, state=deform(mesh, u), pressure=pressure)
    energies = [
        stored_energy(mesh, law, material=material, u=u + s * step * way, pressure=pressure) for s in (1, -1)
    ]
    along = scatter(mesh.size, (mesh.dofs,), forces=(here.internal,)) @ way
    assert along == pytest.approx((energies[0] - energies[1]) / (2 * step), rel=1e-6)

    # With the pressure following its own equation, the condensed stiffness is what the force really does.
    forces = []
    for sign in (1, -1):
        du = sign * step * way
        follow = pressure - (here.recover_slope @ du[mesh.dofs][:, :, None])[:, :, 0]
        forces.append(
            linearise(mesh, law, material=material, state=deform(mesh, u + du), pressure=follow).internal
        )
    difference = (forces[0] - forces[1]) / (2 * step)
    predicted = (here.stiffness @ way[mesh.dofs][:, :, None])[:, :, 0]
    np.testing.assert_allclose(predicted, difference, atol=1e-6 * np.abs(difference).max())


def test_corners_show_a_fold_that_quadrature_points_miss() -> None:
    mesh = ring(1)
    u = np.zeros(mesh.size)
    corner = np.flatnonzero(np.isclose(mesh.nodes_mm, [2.0, 1.0]).all(axis=1))[0]
    u[2 * corner] = -0.4
    assert deform(mesh, u).plane.min() > 0
    assert corner_volumes(mesh, u).min() < 0
    np.testing.assert_allclose(corner_volumes(mesh, np.zeros(mesh.size)), 1.0)
