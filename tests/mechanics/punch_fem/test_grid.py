"""Splines with holes, blocks that are carried, the table on disk: on made-up cases, without finite elements."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from made_tables import made_up

from tactilevision.errors import InputError
from tactilevision.mechanics.tables.blocks import Block, build_blocks, deepened, hayes_stiffness, on_one_grid
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, Case, Grid, SolvedCase
from tactilevision.mechanics.tables.grid import Axes, continued, fit_grid
from tactilevision.mechanics.tables.solve import JAMS, Press, agreed, before_a_jam, solve_case
from tactilevision.mechanics.tables.table import Table, mixed, read_table, straight, write_blocks
from tactilevision.records.measured import Floats

AXES = Axes(np.array([0.3, 0.4, 0.45, 0.48, 0.4999]), np.array([0.2, 0.4, 0.7, 1.1, 1.5]), np.array(DEPTHS))
FINE, COARSE = Grid().poisson_ratios, (0.3, 0.43, 0.487, 0.4999)
FINE_A, COARSE_A = Grid().a_over_h, (0.2, 0.45, 1.0, 1.5)


def smooth(nu: Floats, log_a: Floats, root: Floats) -> Floats:
    """A cubic in each coordinate, which a cubic spline through five nodes has exactly."""
    return np.asarray((1 + nu**3) * (2 - log_a + log_a**2) * (1 + root**2 - root**3))


def on_grid() -> Floats:
    return smooth(*np.meshgrid(*AXES.stretched, indexing="ij"))


def solved_blocks(edges: tuple[float, ...] = (1 / 60, 1 / 30), reach: int = len(DEPTHS)) -> dict[Case, SolvedCase]:
    """mu = .3 at all nodes, no slip at few."""
    cases = [
        Case("neo-hooke", friction, edge, 5.0, nu, alpha)
        for edge in edges
        for friction, nus, alphas in ((0.3, FINE, FINE_A), (math.inf, COARSE, COARSE_A))
        for nu, alpha in product(nus, alphas)
    ]
    return {case: made_up(case, reach if case.poisson_ratio > 0.49 else len(DEPTHS)) for case in cases}


def test_weights_are_straight_between_neighbours_and_beyond_the_last() -> None:
    places = (0.0, 0.5, 2.0)
    assert straight(places, at=0.5) == [(0.5, 1.0)]
    assert straight(places, at=0.125) == [(0.0, 0.75), (0.5, 0.25)]
    assert straight(places, at=-0.5) == [(0.0, 2.0), (0.5, -1.0)]
    assert straight(places[:1], at=7.0) == [(0.0, 1.0)]


def pressed(force: list[float], sound: int, ended: str = "") -> Press:
    return Press(np.array(force), np.zeros((len(force), 2, len(BESIDE))), sound, ended)


def test_beyond_a_fold_stands_what_a_second_mesh_confirms() -> None:
    folded = pressed([4.0, 4.4, 4.8, 5.2], sound=2)
    assert agreed(folded, pressed([2.0, 2.2, 2.4, 2.6], 4)) == 4  # the same growth on another scale
    assert agreed(folded, pressed([4.0, 4.4, 4.8, 5.3], 4)) == 3
    assert agreed(folded, pressed([4.0, 4.4, 4.8], 3)) == 3
    assert agreed(folded, pressed([4.0], 1)) == 2


@pytest.mark.parametrize(("lost", "kept"), [(False, 4), (True, 2)])
def test_a_finer_mesh_confirms_what_a_coarser_one_does_not_reach(
    monkeypatch: pytest.MonkeyPatch, lost: bool, kept: int
) -> None:
    """Not where the law has lost its ellipticity: there no mesh says anything of the law."""
    meshes = {
        1.0: pressed([4.0, 4.4, 4.8, 5.2], sound=2),
        2.0: pressed([4.0, 4.4], 2),
        0.6: pressed([4.01, 4.41, 4.81, 5.21], 3),
    }
    meshes[1.0] = replace(meshes[1.0], lost=lost)
    monkeypatch.setattr("tactilevision.mechanics.tables.solve._press", lambda _case, _depths, size: meshes[size])
    solved = solve_case(Case("neo-hooke", math.inf, 1 / 60, 5.0, 0.48, 1.0), DEPTHS[:4])
    assert len(solved.depth) == kept
    assert solved.sound == DEPTHS[1]


def test_a_case_ends_where_sliding_gel_jams_and_not_where_the_gel_stiffens(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    depths = np.array(DEPTHS)
    gel = 5 + 2 * depths + 8 * depths**2
    case = Case("neo-hooke", 0.1, 1 / 30, 5.0, 0.487, 1.0)
    assert before_a_jam(case, DEPTHS, force=gel) == len(DEPTHS)
    jammed = gel * np.where(depths > 0.2, 1.005, 1.0)
    assert DEPTHS[before_a_jam(case, DEPTHS, force=jammed) - 1] == 0.2
    assert before_a_jam(replace(case, a_over_h=0.45), DEPTHS, force=jammed) == len(
        DEPTHS
    )  # so deep it is not tested
    whole = pressed(jammed.tolist(), len(DEPTHS))
    monkeypatch.setattr("tactilevision.mechanics.tables.solve._press", lambda *_: whole)
    solved = solve_case(case)
    assert (solved.depth[-1], solved.sound, solved.ended) == (0.2, 0.2, JAMS)


def test_a_blunter_edge_leads_a_sharper_one_on() -> None:
    """The edge's share falls as a power of depth, which is what is assumed; made here, it comes back exactly."""
    nodes = Axes(np.array([0.3, 0.4999]), np.array([0.45, 1.0]), np.array(DEPTHS))
    shape = (2, 2, len(DEPTHS))
    more, power = 0.02 * (AXES.depths / 0.1) ** -0.4, (AXES.depths / 0.1) ** -0.4
    surface = np.ones((*shape, 2, len(BESIDE)))
    blunt = Block("hencky", 0.3, 1 / 30, nodes, np.full(shape, 1.1), surface, 4)
    flat = np.array(
        [
            [
                hayes_stiffness(nu, a, edge_over_h=1 / 30) / hayes_stiffness(nu, a, edge_over_h=1 / 60)
                for a in (0.45, 1.0)
            ]
            for nu in (0.3, 0.4999)
        ]
    )
    truth = 1.1 * flat[..., None] * (1 + more)
    beside = surface + 0.01 * power[:, None, None]
    known = np.arange(len(DEPTHS)) < np.array([[8, 14], [9, 3]])[..., None]
    sharp = Block(
        "hencky",
        0.3,
        1 / 60,
        nodes,
        np.where(known, truth, np.nan),
        np.where(known[..., None, None], beside, np.nan),
        4,
    )
    found = deepened(sharp, blunt)
    assert found.deepened == 2  # one is whole, one ends before the edge's share can be told
    for node, reach in (((0, 0), 12), ((0, 1), 14), ((1, 0), 14), ((1, 1), 3)):  # .1 leads to .2, .125 to .25
        np.testing.assert_allclose(found.stiffness[node][:reach], truth[node][:reach])
        np.testing.assert_allclose(found.surface[node][:reach], beside[node][:reach])
        assert np.isnan(found.stiffness[node][reach:]).all()


def test_a_spline_has_cubics_exactly_and_knows_where_it_ends() -> None:
    spline = fit_grid(AXES, on_grid())
    rng = np.random.default_rng(5)
    nu, alpha, depth = rng.uniform(0.3, 0.4999, 50), rng.uniform(0.2, 1.5, 50), rng.uniform(0.002, 0.25, 50)
    places = AXES.places(nu, alpha, depth)
    assert spline.inside(places).all()
    np.testing.assert_allclose(spline(places), smooth(nu, np.log(alpha), np.sqrt(depth)), rtol=1e-10)
    beyond = AXES.places(np.array([0.29, 0.4, 0.4]), np.array([0.5, 1.6, 0.5]), np.array([0.1, 0.1, 0.26]))
    assert not spline.inside(beyond).any()


def test_what_was_not_solved_is_not_known_and_disturbs_nothing_far_away() -> None:
    values = on_grid()
    values[4, 4, 9:] = np.nan
    spline, whole = fit_grid(AXES, values), fit_grid(AXES, on_grid())
    assert spline.reach(0.49, 1.3) == pytest.approx(DEPTHS[8])
    assert spline.reach(0.47, 1.3) == pytest.approx(DEPTHS[-1])
    assert spline.reach(0.6, 1.3) == 0
    far = AXES.places(np.array(0.35), np.array(0.3), np.array(DEPTHS))
    np.testing.assert_allclose(spline(far), whole(far), rtol=5e-4)
    straight = continued(AXES.depths, values)[4, 4]
    np.testing.assert_allclose(
        np.diff(straight[7:]) / np.diff(DEPTHS[7:]), np.diff(straight)[7] / np.diff(DEPTHS)[7]
    )


def test_a_place_on_a_node_is_known_from_either_side() -> None:
    values = on_grid()
    values[4, :, 9:] = np.nan
    spline = fit_grid(AXES, values)
    assert spline.reach(0.48, 0.9) == pytest.approx(DEPTHS[-1])
    assert spline.reach(0.4801, 0.9) == pytest.approx(DEPTHS[8])
    whole = on_grid()
    whole[0, :, 9:] = np.nan
    assert fit_grid(AXES, whole).reach(0.4, 0.9) == pytest.approx(DEPTHS[-1])
    assert fit_grid(AXES, whole).reach(0.3, 0.9) == pytest.approx(DEPTHS[8])


def test_what_a_block_solved_itself_does_not_end_with_its_relative() -> None:
    solved = solved_blocks(edges=(1 / 60,))
    short = {
        case: made_up(case, 6) if case.friction == 0.3 and case.poisson_ratio > 0.48 else one
        for case, one in solved.items()
    }
    carried = {b.friction: b for b in on_one_grid(build_blocks(short))}[math.inf]
    assert np.isfinite(carried.stiffness[4:, FINE_A.index(1.0)]).all()
    assert np.isnan(carried.stiffness[4:, FINE_A.index(0.67), 6:]).all()
    np.testing.assert_allclose(
        carried.stiffness[5, 4] * hayes_stiffness(0.4999, 1.0, edge_over_h=1 / 60),
        made_up(Case("neo-hooke", math.inf, 1 / 60, 5.0, 0.4999, 1.0)).force,
    )


def test_a_block_solved_at_few_nodes_is_carried_to_all() -> None:
    blocks = {(b.friction, b.edge_over_h): b for b in on_one_grid(build_blocks(solved_blocks()))}
    carried, full = blocks[math.inf, 1 / 60], blocks[0.3, 1 / 60]
    assert (carried.nodes, full.nodes) == (16, 36)
    expected = np.array([made_up(Case("neo-hooke", math.inf, 1 / 60, 5.0, nu, 0.67)).force for nu in FINE])
    ours = np.array([made_up(Case("neo-hooke", 0.3, 1 / 60, 5.0, nu, 0.67)).force for nu in FINE])
    np.testing.assert_allclose(carried.stiffness[:, 3] / full.stiffness[:, 3], expected / ours, rtol=1e-9)
    shallow = {(b.friction, b.edge_over_h): b for b in on_one_grid(build_blocks(solved_blocks(reach=6)))}[
        math.inf, 1 / 60
    ]
    assert np.isnan(shallow.stiffness[5, 3, 6:]).all()
    assert np.isfinite(shallow.stiffness[4, 3]).all()


def test_a_block_with_gaps_is_refused() -> None:
    solved = solved_blocks()
    solved.pop(next(iter(solved)))
    with pytest.raises(InputError, match="gaps"):
        build_blocks(solved)


def test_the_table_mixes_frictions_and_edges_and_refuses_what_it_lacks(tmp_path: Path) -> None:
    write_blocks(tmp_path / "punch.npz", build_blocks(solved_blocks()), notes={"what": "made up"})
    table = read_table(tmp_path / "punch.npz")
    place = table.axes.places(np.array(0.47), np.array(0.8), np.array([0.05]))

    def ratio(friction: float, edge: float) -> float:
        return float(mixed(table.mixture("neo-hooke", friction, edge_over_h=edge), "stiffness", place)[0][0])

    assert len(table.mixture("neo-hooke", 0.3, edge_over_h=1 / 60)) == 1
    assert ratio(0.3, 1 / 40) == pytest.approx((ratio(0.3, 1 / 60) + ratio(0.3, 1 / 30)) / 2)
    assert ratio(0.3, 0.0) == pytest.approx(2 * ratio(0.3, 1 / 60) - ratio(0.3, 1 / 30))
    assert ratio(0.3, 1 / 60) < ratio(0.6, 1 / 60) < ratio(math.inf, 1 / 60)
    for law, friction, edge in (("gent", 0.3, 1 / 60), ("neo-hooke", 0.2, 1 / 60), ("neo-hooke", 0.3, 1 / 20)):
        with pytest.raises(InputError, match="holds no such"):
            table.mixture(law, friction, edge_over_h=edge)


def test_a_table_of_one_edge_serves_edges_near_it() -> None:
    table = Table(tuple(on_one_grid(build_blocks(solved_blocks(edges=(1 / 60,))))))
    assert len(table.mixture("neo-hooke", 0.3, edge_over_h=0.04 / 2.4)) == 1
    assert len(table.mixture("neo-hooke", 0.3, edge_over_h=1.05 / 60)) == 1
    with pytest.raises(InputError, match="edge radius"):
        table.mixture("neo-hooke", 0.3, edge_over_h=1.2 / 60)


def test_a_table_that_is_not_its_cards_is_refused(tmp_path: Path) -> None:
    write_blocks(tmp_path / "punch.npz", build_blocks(solved_blocks(edges=(1 / 60,))), notes={})
    assert isinstance(read_table(tmp_path / "punch.npz"), Table)
    card = json.loads((tmp_path / "punch.json").read_text())
    (tmp_path / "punch.json").write_text(json.dumps(card | {"sha256": "0"}))
    with pytest.raises(InputError, match="card"):
        read_table(tmp_path / "punch.npz")
