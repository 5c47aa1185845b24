"""The finite elements pass the patch test and do not lock; the sides' part is reciprocal and fades inward."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import splu

from tactilevision.force import lateral_boundaries
from tactilevision.force.compliance import gel_compliance
from tactilevision.force.kernel import layer_stress
from tactilevision.force.lateral_boundaries import (
    gel_mesh,
    interpolation,
    side_tables,
    solve_sides,
    stiffness,
    unmixed_parts,
)
from tactilevision.force.nodes import lay_grid
from tactilevision.records.rig import Gel

SMALL = Gel(2.0, shape="rectangle", size_mm=(12.0, 10.0))
DISC = Gel(2.0, shape="disc", radius_mm=6.0)


@pytest.mark.parametrize("gel", [SMALL, DISC], ids=["rectangle", "disc"])
def test_a_linear_motion_has_no_force_inside_and_a_rigid_one_none_at_all(gel: Gel) -> None:
    mesh = gel_mesh(gel, 2.5)
    matrix = stiffness(mesh, poisson_ratio=0.49)
    x, y, z = np.broadcast_arrays(*mesh.face.doflocs, mesh.line.doflocs.T)
    turn = np.stack([-y, x, np.zeros_like(x)])
    assert np.abs(matrix @ turn.ravel()).max() < 1e-9
    stretch = np.stack([0.3 * x + 0.1 * z, -0.2 * y, 0.1 * x + 0.2 * z])
    force = (matrix @ stretch.ravel()).reshape(stretch.shape)
    inner = (z > 1e-9) & (z < gel.thickness_mm - 1e-9)
    inner[:, mesh.face.get_dofs().flatten()] = False
    assert inner.any()
    assert np.abs(force[:, inner]).max() < 1e-9


def test_the_disc_is_round() -> None:
    face = gel_mesh(DISC, 2.0).face
    r = np.hypot(*face.doflocs[:, face.get_dofs().flatten()])
    assert np.ptp(r) < 1e-9


@pytest.mark.parametrize("gel", [SMALL, DISC], ids=["rectangle", "disc"])
def test_a_quadratic_field_is_interpolated_exactly_where_elements_are_straight(gel: Gel) -> None:
    face = gel_mesh(gel, 2.5).face
    places = np.random.default_rng(0).uniform(-4, 4, (200, 2))
    (x, y), (there_x, there_y) = face.doflocs, places.T
    found = interpolation(face, places) @ (1 + 2 * x - y + x * y)
    error = 1e-9 if gel is SMALL else 0.05
    np.testing.assert_allclose(found, 1 + 2 * there_x - there_y + there_x * there_y, atol=error)
    with pytest.raises(ValueError, match="outside"):
        interpolation(face, np.array([[7.0, 0.0]]))


def test_a_squeezed_block_does_not_lock() -> None:
    """Sunk by an even pressure on all its face, nu .499 to .49999 hardly differs: the gel bulges at its sides."""
    sunk = []
    for nu in (0.499, 0.49999):
        mesh = gel_mesh(SMALL, 2.5)
        matrix = stiffness(mesh, poisson_ratio=nu)[mesh.free.ravel()][:, mesh.free.ravel()]
        load = np.isin(mesh.free.ravel(), mesh.numbers[2, 0]).astype(float)
        sunk.append(float(load @ splu(matrix.tocsc()).solve(load)))
    assert sunk[1] / sunk[0] == pytest.approx(1.0, abs=0.05)


def test_stress_under_a_load_carries_it() -> None:
    field = layer_stress(np.array([0.4]), 0.5, thickness_mm=2.0, poisson_ratio=0.45, reach_mm=12.0)
    area = field.step_mm**2
    total = field.stress[0].sum(axis=(0, 1)) * area
    assert total[2, 2] == pytest.approx(-1.0, abs=2e-3)  # z on z, the face's normal points out of the gel
    assert total[0, 4] == pytest.approx(-1.0, abs=2e-3)  # x through xz
    assert total[1, 5] == pytest.approx(-1.0, abs=2e-3)
    assert abs(total[2, 4]) < 1e-6


def test_sides_are_reciprocal_soften_and_fade() -> None:
    places = np.array([[4.5, 0.0], [3.0, 1.0], [1.5, -1.0], [0.0, 0.0]])
    gel = Gel(1.0, shape="disc", radius_mm=6.0)
    (table,) = solve_sides(gel, places, poisson_ratios=[0.48], element_mm=1.2).astype(float)
    assert np.abs(table - table.T).max() < 0.04 * np.abs(table).max()
    own = np.diag(table)
    assert (own[:3] > 0).all(), "a free side can only soften the gel"
    assert own[9:].max() < 1e-2 * own[:3].max()


@pytest.mark.parametrize("gel", [SMALL, DISC], ids=["rectangle", "disc"])
def test_unmixed_parts_are_all_displacements_and_do_not_act_on_each_other(gel: Gel) -> None:
    mesh = gel_mesh(gel, 2.5)
    matrix = stiffness(mesh, poisson_ratio=0.49)[mesh.free.ravel()][:, mesh.free.ravel()]
    parts = [
        basis[mesh.free.ravel()] for _, shares in unmixed_parts(mesh) for _, bases in shares for basis in bases
    ]
    assert len(parts) == (4 if gel is SMALL else 6)
    assert sum(part.shape[1] for part in parts) == mesh.free.size
    whole = sparse.hstack(parts)
    assert abs(whole.T @ whole - sparse.eye_array(mesh.free.size)).max() < 1e-12
    for one, other in combinations(parts, 2):
        assert abs(one.T @ matrix @ other).max() < 1e-9 * abs(matrix).max()


@pytest.mark.parametrize(
    "poisson_ratio", [0.1, 0.47, 0.4999, *(pytest.param(nu, marks=pytest.mark.slow) for nu in (0.3, 0.4, 0.49))]
)
def test_the_parabola_through_three_ratios_agrees_with_a_solution(
    poisson_ratio: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    gel, grid = Gel(1.0, shape="rectangle", size_mm=(5.0, 4.0)), lay_grid((40, 40), (0.1, 0.1), spacing_mm=0.5)
    tables = side_tables(gel, grid, poisson_ratio=poisson_ratio)
    assert tables is not None
    monkeypatch.setattr(
        lateral_boundaries, "SOLVED_AT", ((poisson_ratio - 2e-3, poisson_ratio, poisson_ratio + 5e-5),)
    )
    near = side_tables(gel, grid, poisson_ratio=poisson_ratio)
    assert near is not None
    for found, true, error in zip(tables, near, (1e-3, 2e-2), strict=True):
        assert np.linalg.norm(found.table - true.table) < error * np.linalg.norm(true.table)


@pytest.mark.slow
def test_the_derivative_by_poissons_ratio_holds_near_a_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    grid = lay_grid((60, 60), (0.1, 0.1), spacing_mm=0.75)
    gel = Gel(1.0, shape="rectangle", size_mm=(6.5, 6.5))
    cells = np.array([25, 26, 33, 34, 1, 2])
    low, middle, high = (gel_compliance(gel, grid, poisson_ratio=nu, slopes=True) for nu in (0.466, 0.47, 0.474))
    for count in (1, 3):
        before, after = (one.block(cells, count) for one in (low, high))
        units = np.eye(count * len(cells)).reshape(-1, count, len(cells))
        true = (after - before) / 0.008
        found, layer_alone = (
            np.stack([one.by_poisson(cells, unit) for unit in units], axis=1)
            for one in (middle, replace(middle, sides=None))
        )
        assert np.linalg.norm(found - true) < 0.04 * np.linalg.norm(true)
        assert np.linalg.norm(layer_alone - true) > 2 * np.linalg.norm(found - true)


def test_a_gel_wide_against_its_thickness_is_an_unbounded_layer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    grid = lay_grid((40, 40), (0.1, 0.1), spacing_mm=0.5)
    assert gel_compliance(Gel(0.5, shape="disc", radius_mm=15.0), grid, poisson_ratio=0.48).sides is None
    near = gel_compliance(Gel(1.0, shape="rectangle", size_mm=(6.0, 6.0)), grid, poisson_ratio=0.48)
    middle, edge = np.array([27]), np.array([24])
    assert near.sides is not None
    assert near.block(edge)[2, 2] > 1.005 * near.layer.block(edge)[2, 2]
    assert near.block(middle)[2, 2] == pytest.approx(near.layer.block(middle)[2, 2], rel=0.01)
    assert near.block(edge, 1)[0, 0] == pytest.approx(near.block(edge)[2, 2])
    assert len(list(tmp_path.glob("*.zip"))) == 1
