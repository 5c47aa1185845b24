"""The shipped table: against fresh solves at points that it does not hold, at its edges, and how it is made."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.mechanics.tables import tabulate as tabulate_module
from tactilevision.mechanics.tables.cases import (
    BESIDE,
    DEPTHS,
    Case,
    Grid,
    SolvedCase,
    case_path,
    load_case,
    solve_case,
)
from tactilevision.mechanics.tables.local import cubic_weights
from tactilevision.mechanics.tables.merge import merge
from tactilevision.mechanics.tables.punch import EDGE_OVER_H, punch_force, punch_profile
from tactilevision.mechanics.tables.table import SHIPPED, hayes_stiffness, read_table
from tactilevision.mechanics.tables.tabulate import tabulate
from tactilevision.records import Floats, Material

GEL = Material(0.2, 0.48)


def force(depth_mm: float | Floats, **changes: float | str) -> Floats:
    """The paper's punch and gel from the table."""
    about = {"radius_mm": 2.5, "thickness_mm": 3.0, "friction": 0.3} | changes
    return punch_force(depth_mm, material=GEL, **about)  # type: ignore[arg-type]


def profile(depth_mm: float, r_mm: Floats) -> tuple[Floats, Floats]:
    """The same punch's surface."""
    return punch_profile(depth_mm, r_mm, material=GEL, radius_mm=2.5, thickness_mm=3.0, friction=0.3)


def made_up(case: Case, reach: int = len(DEPTHS)) -> SolvedCase:
    """A smooth stand-in for a solved case, so that merging needs no finite elements."""
    depth = np.array(DEPTHS)[:reach]
    scale = hayes_stiffness(case.poisson_ratio, case.a_over_h, case.edge_over_h)
    rise = np.outer(1 + depth, np.exp(-np.array(BESIDE))) * case.poisson_ratio
    return SolvedCase(depth, scale * (1 + depth * case.a_over_h), -rise / 3, rise)


def test_weights_reproduce_cubics_and_use_neighbours_only() -> None:
    nodes = np.array([0.0, 0.3, 0.7, 1.5, 2.0, 3.0])
    at = np.array([0.0, 0.1, 1.0, 2.9, 3.0])
    weights = cubic_weights(nodes, at)
    np.testing.assert_allclose(weights @ (2 - nodes + nodes**3), 2 - at + at**3, atol=1e-12)
    assert np.all((weights != 0).sum(axis=1) <= 4)
    np.testing.assert_allclose(cubic_weights(nodes[:2], np.array([0.15])), [[0.5, 0.5]])


@pytest.mark.parametrize(
    ("law", "friction", "nu", "alpha"),
    [("neo-hooke", 0.3, 0.497, 0.75), ("neo-hooke", math.inf, 0.36, 0.5), ("hencky", math.inf, 0.46, 0.7)],
)
def test_interpolated_within_a_third_of_a_percent_of_a_fresh_solve(
    law: str, friction: float, nu: float, alpha: float
) -> None:
    fresh = solve_case(Case(law, friction, EDGE_OVER_H, 5.0, nu, alpha), (0.03, 0.065))
    gel = Material(1.0, nu)
    read = punch_force(fresh.depth, material=gel, radius_mm=alpha, thickness_mm=1.0, friction=friction, law=law)
    np.testing.assert_allclose(read / fresh.depth, fresh.force, rtol=0.003)
    r = alpha + np.array(BESIDE)
    u_z, u_r = punch_profile(0.065, r, material=gel, radius_mm=alpha, thickness_mm=1.0, friction=friction, law=law)
    np.testing.assert_allclose(u_z / 0.065, fresh.u_z[1], atol=8e-4)
    np.testing.assert_allclose(u_r / 0.065, fresh.u_r[1], atol=2e-3)


def test_force_keeps_shape_scales_with_modulus_and_starts_in_proportion() -> None:
    depths = np.array([[0.0, 0.001], [0.002, 0.3]])
    forces = force(depths)
    assert forces.shape == (2, 2)
    assert forces[0, 0] == 0
    assert forces[1, 0] == pytest.approx(2 * forces[0, 1])
    twice = punch_force(depths, material=Material(0.4, 0.48), radius_mm=2.5, thickness_mm=3.0, friction=0.3)
    np.testing.assert_allclose(twice, 2 * forces)


def test_profile_agrees_with_other_elements() -> None:
    """u_z/w at r = 4 5 6 8 10 mm, nu = .48, mu = .3 (NGSolve, w = .4; here w = .3)."""
    u_z, u_r = profile(0.3, np.array([4.0, 5.0, 6.0, 8.0, 10.0]))
    np.testing.assert_allclose(u_z / 0.3, [0.094, 0.101, 0.070, 0.027, 0.012], atol=0.004)
    assert np.all(u_r > 0)


@pytest.mark.parametrize(
    "change",
    [
        {"friction": 0.2},
        {"law": "ogden"},
        {"edge_radius_mm": 0.2},
        {"radius_mm": 0.5},
        {"radius_mm": 5.0},
        {"thickness_mm": -1.0},
    ],
)
def test_nothing_beyond_the_table(change: dict[str, float | str]) -> None:
    with pytest.raises(InputError):
        force(0.1, **change)


def test_no_depth_nor_place_nor_material_beyond_the_table() -> None:
    for depth in (-0.1, 1.5, math.nan):
        with pytest.raises(InputError):
            force(depth)
        with pytest.raises(InputError):
            profile(depth, np.array([4.0]))
    for r in (2.4, 30.0):
        with pytest.raises(InputError, match=r"\(r - a\)/h"):
            profile(0.1, np.array([r]))
    with pytest.raises(InputError, match="Poisson"):
        punch_force(0.1, material=Material(0.2, 0.2), radius_mm=2.5, thickness_mm=3.0, friction=0.3)


def test_a_table_that_is_not_its_cards_is_refused(tmp_path: Path) -> None:
    for suffix in (".npz", ".json"):
        shutil.copy(SHIPPED.with_suffix(suffix), tmp_path / f"punch{suffix}")
    read_table(tmp_path / "punch.npz")
    card = json.loads((tmp_path / "punch.json").read_text())
    (tmp_path / "punch.json").write_text(json.dumps(card | {"sha256": "0"}))
    with pytest.raises(InputError, match="card"):
        read_table(tmp_path / "punch.npz")


def test_tabulating_resumes_and_merges_whole_blocks_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = Grid(laws=("hencky",), frictions=(0.0, math.inf), poisson_ratios=(0.3, 0.4, 0.45, 0.49))
    cases = list(grid.cases())
    solved: list[Case] = []

    def pretend(case: Case) -> SolvedCase:
        solved.append(case)
        return made_up(case, reach=12 if case.a_over_h == 1.2 else len(DEPTHS))

    monkeypatch.setattr(tabulate_module, "solve_case", pretend)
    told: list[tuple[float, bool]] = []
    assert tabulate(cases[:20], tmp_path, report=lambda _, depth, whole: told.append((depth, whole))) == 20
    assert told[0][0] == pytest.approx(0.2)
    assert [whole for _, whole in told[:4]] == [True, True, True, False]
    missing = merge(cases, tmp_path, tmp_path / "t.npz", notes={"mesh_error": 0.001})
    assert len(missing) == 12
    table = read_table(tmp_path / "t.npz")
    assert [block.friction for block in table.blocks] == [0.0]
    assert table.card["mesh_error"] == 0.001
    assert np.isnan(table.blocks[0].stiffness[0, 3, 12:]).all()
    assert tabulate(cases, tmp_path) == 12
    assert len(solved) == 32
    assert merge(cases, tmp_path, tmp_path / "t.npz", notes={}) == []
    again = load_case(case_path(tmp_path, cases[0]))
    np.testing.assert_array_equal(again.u_z, made_up(cases[0]).u_z)


def test_merging_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no block"):
        merge(Grid().cases(), tmp_path, tmp_path / "t.npz", notes={})
