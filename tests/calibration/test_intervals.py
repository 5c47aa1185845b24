"""Do the intervals of c, beta, nu and E hold: noise, several radii, a sticking gel, a rounded edge?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from made_recordings import Truth, draw, points_of

from calibration.inputs.observations import Measured
from calibration.laws.theory import sticking_surplus
from calibration.tasks.calibrate import calibrate
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.tables.punch import punch_force
from tactilevision.records.measured import Material
from tactilevision.records.rig import Gel, Indenter

WELL = Truth(extra={"lubricated": 1.0}, thickness_std_mm=0.0, radius_std_mm=0.0)


def test_intervals_cover_the_truth() -> None:
    assert_covers(WELL, trials=12, least=10)


@pytest.mark.slow
@pytest.mark.parametrize(
    "truth",
    [
        WELL,
        replace(WELL, states_noise=False),
        replace(WELL, repeats=1),
        replace(WELL, radii_mm=(1.5, 2.5, 3.5)),
        replace(WELL, radii_mm=(1.5, 2.5, 3.5), states_poisson=False),
    ],
)
def test_intervals_cover_the_truth_in_nine_of_ten_to_all_but_one_in_a_hundred(truth: Truth) -> None:
    assert_covers(truth, trials=200, least=180)


def assert_covers(truth: Truth, *, trials: int, least: int) -> None:
    rng = np.random.default_rng(2024)
    hits = {"c": 0, "E": 0, "nu": 0, "beta": 0}
    for _ in range(trials):
        result = calibrate(draw(truth, rng), test=False)
        radius, c, beta = result.by_radius[0]
        for name, estimate, value in (
            ("c", c, truth.stiffness(radius)),
            ("beta", beta, truth.beta),
            ("E", result.youngs_modulus, truth.modulus_MPa),
            ("nu", result.poisson_ratio, truth.poisson_ratio),
        ):
            low, high = estimate.interval95 or (np.nan, np.nan)
            hits[name] += low <= value <= high
    assert min(hits.values()) >= least, hits
    assert trials < 200 or min(hits.values()) <= 0.99 * trials, "an interval that never misses says nothing"


def test_c_within_one_and_a_half_and_E_within_two_per_cent() -> None:
    rng = np.random.default_rng(7)
    truth = replace(WELL, height_std_mm=0.001, poisson_std=0.0005)
    for _ in range(5):
        result = calibrate(draw(truth, rng), test=False)
        assert result.c.value == pytest.approx(truth.stiffness(2.5), rel=0.015)
        assert result.youngs_modulus.value == pytest.approx(0.2, rel=0.02)


@pytest.mark.slow
def test_a_sticking_gel_lies_inside_E_unless_friction_is_known() -> None:
    rng = np.random.default_rng(3)
    truth = replace(WELL, sticking=sticking_surplus(0.48, 2.5 / 3), extra={}, poisson_std=0.0005)
    inside = 0
    for _ in range(12):
        low, high = calibrate(draw(truth, rng), test=False).youngs_modulus.interval95 or (0, 0)
        inside += low <= 0.2 <= high
    assert inside >= 10


def test_several_radii_fix_nu() -> None:
    truth = replace(WELL, radii_mm=(1.5, 2.5, 3.5), states_poisson=False, height_std_mm=0.0005, poisson_ratio=0.47)
    result = calibrate(draw(truth, np.random.default_rng(5)), test=False)
    assert result.poisson_ratio_source == "radii"
    low, high = result.poisson_ratio.interval95 or (0, 0)
    assert low <= 0.47 <= high
    assert high - low < 0.03


@dataclass(frozen=True)
class Sticking(Truth):
    """A gel that sticks: how much that adds depends on the radius, which looks like another nu."""

    def stiffness(self, radius_mm: float, thickness_mm: float = 3.0) -> float:
        surplus = float(sticking_surplus(self.poisson_ratio, radius_mm / thickness_mm))
        return super().stiffness(radius_mm, thickness_mm) * (1 + surplus)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))])
def test_several_radii_that_fix_nu_leave_E_room_for_friction(seed: int) -> None:
    truth = Sticking(
        radii_mm=(1.5, 2.5, 3.5),
        states_poisson=False,
        height_std_mm=0.0003,
        depth_std_mm=0.0005,
        radius_std_mm=0.0,
        thickness_std_mm=0.0,
        poisson_ratio=0.474,
    )
    result = calibrate(draw(truth, np.random.default_rng(seed)), test=False)
    assert result.poisson_ratio_source == "radii"
    for found, true in ((result.poisson_ratio, 0.474), (result.youngs_modulus, 0.2)):
        low, high = found.interval95 or (0, 0)
        assert low <= true <= high


def edged(edge_mm: float | None, *, true_mm: float = 0.1) -> Measured:
    """Finite elements of a sliding punch with a rounded edge, of which `edge_mm` is stated."""
    gel = Gel(3.0, shape="disc", radius_mm=30.0, poisson_ratio=0.48, poisson_ratio_std=0.0)
    depth = np.linspace(0.06, 0.45, 14)
    force = punch_force(depth, FlatContact(2.5, true_mm, 3.0, 0.0), material=Material(0.2, 0.48))
    measured = points_of(depth, force, gel=gel)
    punch = {"A": Indenter("A", radius_mm=2.5, edge_radius_mm=edge_mm)}
    return replace(measured, recording=replace(measured.recording, indenters=punch))


def test_a_stated_edge_is_taken_out_of_E_but_not_of_the_line() -> None:
    stated, sharp = (calibrate(edged(mm), test=False) for mm in (0.1, 0.0))
    truly_sharp = calibrate(edged(0.0, true_mm=0.0), test=False).youngs_modulus.value
    assert truly_sharp == pytest.approx(0.2, rel=0.025), "what is bent is carried on straight"
    assert stated.youngs_modulus.value == pytest.approx(truly_sharp, rel=0.01)
    assert (sharp.youngs_modulus.value or 0) < 0.96 * (truly_sharp or 0), "blunt, taken as sharp"
    assert stated.c.value == pytest.approx(sharp.c.value, rel=5e-3)
    assert stated.beta.value == pytest.approx(sharp.beta.value, abs=0.03)
    assert dict(stated.youngs_modulus_of_nu)[0.48] == pytest.approx(stated.youngs_modulus.value, rel=1e-6)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.6])
def test_an_edge_of_which_nothing_is_stated_is_in_the_interval(friction: float) -> None:
    """Finite elements of an edge of .05 mm; stated as sharp, E is lower, and its interval reaches less far up."""
    gel = Gel(3.0, shape="disc", radius_mm=30.0, poisson_ratio=0.48, poisson_ratio_std=0.0)
    depth = np.linspace(0.03, 0.3, 10)
    measured = points_of(
        depth, punch_force(depth, FlatContact(2.5, 0.05, 3.0, friction), material=Material(0.2, 0.48)), gel=gel
    )
    open_ = calibrate(measured, test=False).youngs_modulus
    sharp = {"A": Indenter("A", radius_mm=2.5, edge_radius_mm=0.0)}
    stated = replace(measured, recording=replace(measured.recording, indenters=sharp))
    known = calibrate(stated, test=False).youngs_modulus
    assert open_.interval95 is not None
    assert known.interval95 is not None
    assert open_.value == pytest.approx(0.2, rel=0.004 if friction else 0.03), (
        "of a usual edge where none is stated"
    )
    assert 0.02 < (open_.value or 1) / (known.value or 1) - 1 < 0.05
    assert open_.interval95[0] < 0.2 < open_.interval95[1]
    assert open_.interval95[0] <= known.interval95[0] * (1 + 1e-9)
    assert 0.02 < open_.interval95[1] / (open_.value or 1) - 1 < 0.05
    assert known.interval95[1] / (known.value or 1) - 1 < 0.04, "it holds a gel that slides as well"
