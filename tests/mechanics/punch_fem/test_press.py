"""Whole presses: Hayes' theory, other people's finite elements, energy, unloading, and honest failure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from each import each

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.mechanics.kappa import kappa
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.discretisation import MeshSettings
from tactilevision.mechanics.punch_fem.laws import Gent, Hencky, Law, NeoHooke
from tactilevision.mechanics.punch_fem.press import press_to_depths
from tactilevision.mechanics.punch_fem.problem import GluedFace, PunchProblem
from tactilevision.records.measured import Material

# P/(E w) in mm for a = 2.5, h = 3, R = 15 mm, by NGSolve 6.2.2608 (P2/P1 triangles): law, nu, mu, edge, depths,
# values.
# A glued face (edge 0) is compared while its surface does not fold.
OTHERS = [
    (NeoHooke(), 0.4797, 0.3, 0.05, (0.15, 0.3), (18.92997, 19.67442)),
    pytest.param(NeoHooke(), 0.3, 0.3, 0.05, (0.15, 0.3), (12.22849, 12.66387), marks=pytest.mark.slow),
    pytest.param(NeoHooke(), 0.495, 0.3, 0.05, (0.15,), (20.39307,), marks=pytest.mark.slow),
    (NeoHooke(), 0.4797, math.inf, 0.0, (0.15, 0.3), (19.43218, 20.18817)),
    (Hencky(), 0.4797, math.inf, 0.0, (0.15, 0.3), (19.86415, 20.94256)),
    (NeoHooke(), 0.3, math.inf, 0.0, (0.15,), (12.4986,)),
    (Hencky(), 0.3, math.inf, 0.0, (0.15,), (12.94353,)),
]


def glued_mesh() -> MeshSettings:
    """The reference's own element size at the sharp edge."""
    return MeshSettings(0.05, 0.4)


def paper_problem(law: Law, nu: float, friction: float, edge_mm: float) -> PunchProblem:
    """The paper's pad and punch at E = 1."""
    punch = GluedFace(2.5) if edge_mm == 0 else RoundedPunch(2.5, edge_mm, friction)
    return PunchProblem(Material(1.0, nu), punch, 3.0, 15.0, law=law, mesh=glued_mesh() if edge_mm == 0 else None)


def rough_problem(friction: float) -> PunchProblem:
    """A small, quick one: a large edge radius, a coarse mesh."""
    mesh = MeshSettings(0.1, 0.6, inside_mm=0.5, outside_mm=0.2)
    return PunchProblem(Material(0.2, 0.48), RoundedPunch(2.0, 0.4, friction), 3.0, 9.0, mesh=mesh)


@each("nu, a_over_h", [(0.3, 0.4), (0.45, 1.5), (0.48, 2.5 / 3), (0.4999, 0.8)])
def test_hayes_is_recovered_within_half_a_percent(nu: float, a_over_h: float) -> None:
    problem = PunchProblem(Material(1.0, nu), GluedFace(a_over_h, slides=True), 1.0, 6.0)
    solution = press_to_depths(problem, [1e-6])
    slope = solution.force_N[0] / solution.depth_mm[0]
    assert slope * (1 - nu**2) / (2 * a_over_h) == pytest.approx(kappa(nu, a_over_h), rel=0.005)


def test_sharp_glued_punch_starts_between_hayes_and_full_stick() -> None:
    """At nu = .4797, a/h = 2.5/3: 18.25 frictionless, 18.83 glued; mu = .3 lies between as its edge sharpens."""

    def slope(edge_mm: float) -> float:
        solution = press_to_depths(paper_problem(NeoHooke(), 0.4797, 0.3, edge_mm), [1e-3 * edge_mm])
        return float(solution.force_N[0] / solution.depth_mm[0])

    glued = press_to_depths(paper_problem(NeoHooke(), 0.4797, 0.0, 0.0), [1e-4])
    stick = float(glued.force_N[0] / glued.depth_mm[0])
    assert stick == pytest.approx(18.83, rel=0.005)
    sharp = 2 * slope(0.04) - slope(0.08)
    assert 18.25 < sharp < stick


@pytest.mark.parametrize(("law", "nu", "friction", "edge", "depths", "expected"), OTHERS)
def test_other_finite_elements_within_one_percent(
    law: Law, nu: float, friction: float, edge: float, depths: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    solution = press_to_depths(paper_problem(law, nu, friction, edge), depths)
    np.testing.assert_allclose(solution.force_N / solution.depth_mm, expected, rtol=0.01)


def test_profile_beside_the_punch_agrees_with_other_elements() -> None:
    """u_z/w at material r = 4 5 6 8 10 mm, neo-Hooke, nu = .48, mu = .3, w = .4 (NGSolve, 3 digits)."""
    solution = press_to_depths(paper_problem(NeoHooke(), 0.48, 0.3, 0.05), [0.2, 0.4])
    rise = np.interp([4, 5, 6, 8, 10], solution.r_mm, solution.u_z_mm[-1]) / 0.4
    np.testing.assert_allclose(rise, [0.094, 0.101, 0.070, 0.027, 0.012], atol=0.0025)
    under = solution.u_z_mm[:, solution.r_mm < 2.3]
    np.testing.assert_allclose(under, np.broadcast_to(-solution.depth_mm[:, None], under.shape), atol=5e-4)


def test_work_of_the_punch_is_the_energy_stored() -> None:
    depths = np.linspace(0, 0.4, 21)[1:]
    solution = press_to_depths(rough_problem(0.0), depths)
    forces = np.append(0.0, solution.force_N)
    work = float(((forces[1:] + forces[:-1]) / 2 * np.diff(np.append(0.0, depths))).sum())
    assert solution.energy_N_mm[-1] == pytest.approx(work, rel=0.003)


def test_tractions_lie_within_the_friction_cone() -> None:
    solution = press_to_depths(rough_problem(0.3), [0.1, 0.2])
    assert solution.pressure_MPa is not None
    assert solution.shear_MPa is not None
    assert np.all(np.abs(solution.shear_MPa) <= 0.3 * solution.pressure_MPa + 1e-12)
    assert solution.pressure_MPa[-1].max() > 0.02


@pytest.mark.slow
def test_unloading_retraces_without_friction_and_loses_work_with_it() -> None:
    path = [0.1, 0.2, 0.3, 0.2, 0.1]
    smooth = press_to_depths(rough_problem(0.0), path)
    np.testing.assert_allclose(smooth.force_N[3:], smooth.force_N[[1, 0]], rtol=1e-5)
    rough = press_to_depths(rough_problem(0.3), path)
    assert np.all(rough.force_N[3:] < rough.force_N[[1, 0]] * (1 - 1e-5))


def test_modulus_only_scales_the_force() -> None:
    problem = rough_problem(0.3)
    stiff = replace(problem, material=Material(2.0, 0.48))
    np.testing.assert_allclose(
        press_to_depths(stiff, [0.2]).force_N, 10 * press_to_depths(problem, [0.2]).force_N, rtol=1e-6
    )


def test_a_held_side_and_a_gel_that_stiffens_press_back_harder() -> None:
    problem = replace(rough_problem(math.inf), pad_radius_mm=4.0)
    free = press_to_depths(problem, [0.3]).force_N[0]
    held = press_to_depths(replace(problem, side_fixed=True), [0.3]).force_N[0]
    stiffening = press_to_depths(replace(problem, law=Gent(3.0)), [0.3]).force_N[0]
    assert held > 1.05 * free
    assert stiffening > 1.005 * free


def test_what_cannot_be_reached_is_said() -> None:
    problem = PunchProblem(Material(1.0, 0.3), GluedFace(2.5), 3.0, 15.0, mesh=MeshSettings(0.02, 0.5))
    with pytest.raises(ConvergenceError, match="converged to depth"):
        press_to_depths(problem, [0.2, 2.5])


@pytest.mark.parametrize(
    ("friction", "nu", "radius"), [(0.1, 0.4797, 2.5), (0.3, 0.4999, 4.5), (0.15, 0.495, 0.9)]
)
def test_first_touch_finds_what_sticks_however_little_does(friction: float, nu: float, radius: float) -> None:
    """Steps shorter than the edge radius do not help there: stick and slip have the same extent in all of them."""
    problem = PunchProblem(Material(1.0, nu), RoundedPunch(radius, 0.05, friction), 3.0, 15.0)
    solution = press_to_depths(problem, [0.01])
    assert not any(isinstance(step, str) for step in solution.steps)
    assert solution.pressure_MPa is not None
    assert solution.shear_MPa is not None
    share = np.abs(solution.shear_MPa[0]) / np.maximum(friction * solution.pressure_MPa[0], 1e-12)
    touching = solution.pressure_MPa[0] > 0
    assert (share[touching] < 0.5).any()
    assert share[touching].max() <= 1 + 1e-9


def test_impossible_presses_are_refused() -> None:
    problem = rough_problem(0.0)
    with pytest.raises(InputError, match="reaches through"):
        press_to_depths(problem, [3.5])
    with pytest.raises(InputError, match="from 0 up"):
        press_to_depths(problem, [0.1, math.nan])
    with pytest.raises(InputError, match="from 0 up"):
        press_to_depths(problem, [-1.0])
    with pytest.raises(InputError, match="between 0 and the pad"):
        press_to_depths(replace(problem, pad_radius_mm=1.5), [0.1])
    with pytest.raises(InputError, match="penalty"):
        press_to_depths(replace(problem, penalty=0.0), [0.1])
    with pytest.raises(InputError, match="edge_size_mm"):
        MeshSettings(0.5, 0.1)
