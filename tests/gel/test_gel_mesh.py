"""Elements pass the patch test, the sweep is a solver's answer, shapes have volume, a flat mesh is a layer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from tactilevision.errors import InputError
from tactilevision.force.compliance import gel_compliance
from tactilevision.force.mesh_compliance import (
    MeshCompliance,
    check_coarse,
    compliance_of,
    equivalent_thickness_mm,
)
from tactilevision.force.nodes import lay_grid
from tactilevision.gel.elements import HEX, TET, stiffness, table_of
from tactilevision.gel.mesh import GelMesh
from tactilevision.gel.shapes import shape_mesh
from tactilevision.gel.surface import surface_cells
from tactilevision.records.rig import Gel, GelLayer

GRID = lay_grid((30, 36), (0.1, 0.1), spacing_mm=0.5)
DOME = Gel(2.0, shape="dome", curvature_mm=(8.0, 8.0), radius_mm=5.0)
SLAB = Gel(1.5, shape="rectangle", size_mm=(7.0, 6.0))


def mesh_of(gel: Gel) -> GelMesh:
    return shape_mesh(gel, GRID.x_mm, GRID.y_mm, spacing_mm=GRID.spacing_mm)


def bent(nodes: int) -> Any:
    """One element with curved edges, (1, nodes, 3)."""
    rng = np.random.default_rng(0)
    if nodes == HEX:
        k = np.arange(27)
        places = np.stack([k % 3, k // 3 % 3, k // 9], axis=1) - 1.0
    else:
        corners = np.vstack([np.zeros(3), np.eye(3)])
        middles = [(corners[a] + corners[b]) / 2 for a in range(4) for b in range(a + 1, 4)]
        places = np.vstack([corners, middles])
    return (places + 0.04 * rng.standard_normal(places.shape))[None]


@pytest.mark.parametrize("nodes", [HEX, TET])
def test_an_element_resists_no_rigid_motion_and_stores_the_energy_of_a_uniform_strain(nodes: int) -> None:
    places, shear, lame = bent(nodes), np.array([0.34]), np.array([8.1])
    matrix = stiffness(places, shear, lame)[0]
    (x, y, _), one = places[0].T, table_of(nodes)
    turn = np.stack([-y, x, np.zeros_like(x)], axis=1)
    assert np.abs(matrix @ turn.ravel()).max() < 1e-12
    strain = np.array([[0.3, 0.1, 0.0], [0.1, -0.2, 0.05], [0.0, 0.05, 0.25]])
    u = (places[0] @ strain).ravel()
    volume = np.linalg.det(np.einsum("ni,qnj->qij", places[0], one.slopes)) @ one.weight
    density = 0.34 * np.sum(strain**2) + 8.1 / 2 * np.trace(strain) ** 2
    assert u @ matrix @ u / 2 == pytest.approx(density * volume, rel=1e-9)


def test_the_sweep_is_the_answer_of_a_sparse_solver() -> None:
    layers, grid = (GelLayer(0.3, 3.0), GelLayer(0.7)), lay_grid((20, 20), (0.1, 0.1), spacing_mm=0.5)
    gel = Gel(1.0, shape="dome", curvature_mm=(4.0, 4.0), size_mm=(2.8, 2.6), layers=layers)
    mesh = shape_mesh(gel, grid.x_mm, grid.y_mm, spacing_mm=0.5)
    _, shares = surface_cells(mesh, grid.x_mm, grid.y_mm, spacing_mm=0.5)
    chosen = shares[:, [5, 10]]
    found = mesh.compliance(chosen, poisson_ratio=0.48)
    modulus = mesh.stiffer
    assert modulus is not None
    each = stiffness(mesh.nodes_mm[mesh.elements], modulus / 2.96, modulus * 0.48 / (1.48 * 0.04))
    unknowns = (3 * mesh.elements[:, :, None] + np.arange(3)).reshape(len(mesh.elements), -1)
    rows, columns = np.broadcast_arrays(unknowns[:, :, None], unknowns[:, None, :])
    whole = sparse.csc_array((each.ravel(), (rows.ravel(), columns.ravel())))
    free = np.flatnonzero(np.repeat(~mesh.bonded, 3))
    loads = sparse.kron(chosen, np.eye(3)).toarray()[free]
    other = loads.T @ spsolve(sparse.csc_matrix(whole[free][:, free]), loads)
    np.testing.assert_allclose(found.transpose(1, 0, 3, 2).reshape(other.shape), other, atol=2e-6 * other.max())


def test_shapes_have_their_volume_and_are_closed() -> None:
    dome, height = mesh_of(DOME), 8 - np.sqrt(64 - 25)
    dome.check_closed()
    assert dome.volume_mm3 == pytest.approx(2 * np.pi * height / 8 * (8**3 - 6**3) / 3, rel=1e-5)
    lens = mesh_of(replace(DOME, base="flat"))
    assert lens.volume_mm3 == pytest.approx(np.pi * (25 * (2 - height) + height**2 * (8 - height / 3)), rel=1e-5)
    wedge = Gel(2.5, shape="wedge", thickness_ends_mm=(2.0, 3.0), size_mm=(7.0, 6.0))
    assert mesh_of(wedge).volume_mm3 == pytest.approx(105.0)
    pipe = Gel(1.0, shape="cylinder", curvature_mm=(6.0, 6.0), axis="y", size_mm=(6.0, 6.0))
    assert mesh_of(pipe).volume_mm3 == pytest.approx(6 * np.arcsin(0.5) * (6**2 - 5**2), rel=1e-5)


def test_a_flat_mesh_is_as_stiff_as_the_layer_and_needs_no_other_thickness() -> None:
    flat = gel_compliance(SLAB, GRID, poisson_ratio=0.48)
    mesh = compliance_of(mesh_of(SLAB), SLAB, GRID, poisson_ratio=0.48, slopes=True)
    cells = np.flatnonzero(np.hypot(*np.meshgrid(GRID.x_mm, GRID.y_mm)).ravel() < 1.1)
    for parts in (1, 3):
        unit = np.ones(parts * len(cells))
        solid, layer = (np.linalg.solve(one.block(cells, parts), unit).sum() for one in (mesh, flat))
        assert solid == pytest.approx(layer, rel=0.01)
    here, least, most = equivalent_thickness_mm(mesh)
    assert here == pytest.approx(1.5, rel=0.06)  # the sides are near
    assert least > 1.3
    assert most < 2.2  # free sides are soft
    higher = compliance_of(mesh_of(SLAB), SLAB, GRID, poisson_ratio=0.482)
    block = higher.block(cells)
    np.testing.assert_allclose(mesh.at(0.482).block(cells), block, atol=1e-4 * block.max())


def test_two_sizes_of_a_mesh_tell_whether_it_is_too_coarse() -> None:
    grid = lay_grid((20, 20), (0.1, 0.1), spacing_mm=0.5)

    def sized(thickness_mm: float, step_mm: float) -> MeshCompliance:
        gel, middles = (
            Gel(thickness_mm, shape="rectangle", size_mm=(4, 4)),
            np.arange(-2 + step_mm / 2, 2, step_mm),
        )
        return compliance_of(shape_mesh(gel, middles, middles, spacing_mm=step_mm), gel, grid, poisson_ratio=0.48)

    assert check_coarse(sized(3.0, 0.5), sized(3.0, 0.25)) < 0.02
    with pytest.raises(InputError, match="too coarse"):
        check_coarse(sized(1.0, 1.0), sized(1.0, 0.5))


@pytest.mark.parametrize(
    ("gel", "said"),
    [
        (replace(DOME, radius_mm=7.9), "steeper than 60 degrees"),
        (replace(DOME, thickness_mm=9.0), "no thickness at its rim"),
        (replace(DOME, base="flat", thickness_mm=1.0), "no thickness at its rim"),
        (replace(SLAB, layers=(GelLayer(2.0), GelLayer(0.5))), "layers are thicker"),
    ],
)
def test_an_impossible_geometry_is_refused_with_its_numbers(gel: Gel, said: str) -> None:
    with pytest.raises(InputError, match=said):
        mesh_of(gel)


def test_a_gel_that_nothing_holds_or_that_is_inside_out_is_refused() -> None:
    mesh = mesh_of(SLAB)
    with pytest.raises(InputError, match="no bonded surface"):
        replace(mesh, bonded=np.zeros_like(mesh.bonded))
    with pytest.raises(InputError, match="inverted"):
        replace(mesh, nodes_mm=mesh.nodes_mm * np.array([1, 1, -1]))
    with pytest.raises(InputError, match="no part of the view"):
        surface_cells(
            replace(mesh, nodes_mm=mesh.nodes_mm + np.array([40.0, 0.0, 0.0])),
            GRID.x_mm,
            GRID.y_mm,
            spacing_mm=0.5,
        )
