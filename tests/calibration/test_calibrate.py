"""From points to E and nu: the published numbers, honest intervals, and a sentence for every bad input."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from made_recordings import HEIGHTS_MM, Made, Truth, draw, points_of

from calibration.inputs.observations import Measured
from calibration.laws.theory.sticking import sticking_surplus
from calibration.report import wording
from calibration.tasks.calibrate import calibrate
from calibration.tasks.history import history
from tactilevision.errors import InputError, NothingCertified
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.tables.punch import punch_force
from tactilevision.records import Curve, Estimate, Gel, Indenter, Material, Press, Sensor

PAPER = Path(__file__).parents[3] / "shared" / "reference" / "paper_points.csv"
LUBRICATED = {"lubricated": 1.0}
CALIBRATION_KEYS = {
    "youngs_modulus_MPa",
    "poisson_ratio",
    "clock_offset_s",
    "poisson_ratio_source",
    "c_N_per_mm",
    "beta",
    "reduced_modulus_MPa",
    "youngs_modulus_of_nu",
    "law",
    "assumptions",
    "covariance",
    "r_squared",
    "rms_error_N",
    "noise_floor_N",
    "presses_accepted",
    "presses_rejected",
    "warnings",
    "versions",
}
WELL = Truth(extra=LUBRICATED, thickness_std_mm=0.0, radius_std_mm=0.0)


def paper_points() -> Measured:
    if not PAPER.exists():
        pytest.skip("the published points are not at hand")
    rows = list(csv.DictReader(PAPER.read_text().splitlines()))
    return points_of(np.array([float(r["depth_mm"]) for r in rows]), np.array([float(r["fz_N"]) for r in rows]))


def test_the_published_numbers_are_reproduced() -> None:
    result = calibrate(paper_points(), law="paper")
    assert result.c.value == pytest.approx(3.4943, abs=2e-4)
    assert result.beta.value == pytest.approx(1.5071, abs=3e-4)
    assert result.poisson_ratio.value == pytest.approx(0.4797, abs=1e-4)
    assert result.youngs_modulus.value == pytest.approx(0.1988, abs=1e-4)
    assert result.r_squared > 0.9999
    assert result.poisson_ratio_source == "beta"
    assert any("reproduction" in line for line in result.assumptions)


def test_at_the_true_thickness_ratio_the_modulus_is_lower() -> None:
    measured = paper_points()
    gel = Gel(3.0, shape="disc", radius_mm=15.0, poisson_ratio=0.4797, poisson_ratio_std=0.002)
    recording = replace(measured.recording, sensor=Sensor("custom", 10, 10, (0.1, 0.1), gel))  # type: ignore[type-var]
    result = calibrate(replace(measured, recording=recording))
    assert result.youngs_modulus.value == pytest.approx(0.1915, abs=1e-4)
    assert result.flags == ("beta_outside_theory",)
    assert any("candidates" in line for line in result.warnings)


def test_one_punch_fixes_c_and_not_nu() -> None:
    result = calibrate(paper_points())
    assert result.c.value == pytest.approx(3.4943, abs=2e-4)
    for unknown in (result.poisson_ratio, result.youngs_modulus, result.reduced_modulus):
        assert unknown.value is None
        assert unknown.why
        assert unknown.interval95 is not None
    assert result.poisson_ratio.interval95 == (0.45, 0.4999)
    curve = dict(result.youngs_modulus_of_nu)
    assert curve[0.48] == pytest.approx(0.19124, abs=1e-4)
    low, high = result.youngs_modulus.interval95 or (0, 0)
    assert curve[0.45] * 1.02 < high < curve[0.45] * 1.03, "a rounded edge, of which nothing is stated, raises E"
    assert low < curve[0.4999] < high, "sticking may lower E further"


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
        result = calibrate(draw(truth, rng))
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
    for _ in range(8):
        result = calibrate(draw(truth, rng))
        assert result.c.value == pytest.approx(truth.stiffness(2.5), rel=0.015)
        assert result.youngs_modulus.value == pytest.approx(0.2, rel=0.02)


@pytest.mark.slow
def test_a_sticking_gel_lies_inside_E_unless_friction_is_known() -> None:
    rng = np.random.default_rng(3)
    truth = replace(WELL, sticking=sticking_surplus(0.48, 2.5 / 3), extra={}, poisson_std=0.0005)
    inside = 0
    for _ in range(12):
        low, high = calibrate(draw(truth, rng)).youngs_modulus.interval95 or (0, 0)
        inside += low <= 0.2 <= high
    assert inside >= 10


def test_several_radii_fix_nu() -> None:
    truth = replace(WELL, radii_mm=(1.5, 2.5, 3.5), states_poisson=False, height_std_mm=0.0005, poisson_ratio=0.47)
    result = calibrate(draw(truth, np.random.default_rng(5)))
    assert result.poisson_ratio_source == "radii"
    low, high = result.poisson_ratio.interval95 or (0, 0)
    assert low <= 0.47 <= high
    assert high - low < 0.03


@dataclass(frozen=True)
class Sticking(Truth):
    """A gel that sticks: how much that adds depends on the radius, which looks like another nu."""

    def stiffness(self, radius_mm: float, thickness_mm: float = 3.0) -> float:
        surplus = sticking_surplus(self.poisson_ratio, radius_mm / thickness_mm)
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
    result = calibrate(draw(truth, np.random.default_rng(seed)))
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
    return replace(measured, recording=replace(measured.recording, indenters=punch))  # type: ignore[type-var]


def test_a_stated_edge_is_taken_out_of_E_but_not_of_the_line() -> None:
    stated, sharp = calibrate(edged(0.1)), calibrate(edged(0.0))
    truly_sharp = calibrate(edged(0.0, true_mm=0.0)).youngs_modulus.value
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
    open_, sharp = calibrate(measured).youngs_modulus, {"A": Indenter("A", radius_mm=2.5, edge_radius_mm=0.0)}
    stated = replace(measured, recording=replace(measured.recording, indenters=sharp))  # type: ignore[type-var]
    known = calibrate(stated).youngs_modulus
    assert open_.interval95 is not None
    assert known.interval95 is not None
    assert open_.value == pytest.approx(0.2, rel=0.004 if friction else 0.03), (
        "of a usual edge where none is stated"
    )
    assert 0.02 < (open_.value or 1) / (known.value or 1) - 1 < 0.05
    assert open_.interval95[0] < 0.2 < open_.interval95[1]
    assert open_.interval95[0] <= known.interval95[0]
    assert 0.02 < open_.interval95[1] / (open_.value or 1) - 1 < 0.05
    assert known.interval95[1] / (known.value or 1) - 1 < 0.04, "it holds a gel that slides as well"


def test_too_few_points_answer_wide_and_say_so() -> None:
    result = calibrate(points_of(np.array([0.2, 0.5]), np.array([0.8, 2.1])))
    low, high = result.c.interval95 or (0, 0)
    assert high - low > 0.3 * (result.c.value or 0)
    assert any("no more measurements than parameters" in w for w in result.warnings)


def test_no_interval_of_a_stiffness_reaches_below_nothing() -> None:
    result = calibrate(points_of(np.array([0.15, 0.4]), np.array([0.55, 1.5])))
    for found in (result.c, result.youngs_modulus):
        low, high = found.interval95 or (-1, -1)
        assert 0 <= low < 0.1 * high


def test_indenters_that_differ_more_than_repeats_widen_the_interval() -> None:
    truth = replace(WELL, depth_std_mm=0.0003, force_std_N=0.0003, height_std_mm=0.006)
    measured = draw(truth, np.random.default_rng(11))
    silent = {k: replace(i, height_std_mm=0.0) for k, i in measured.recording.indenters.items()}
    points = tuple(replace(p, depth_std_mm=float("nan")) for p in measured.points)
    recording = replace(measured.recording, indenters=silent)  # type: ignore[type-var]
    result = calibrate(replace(measured, recording=recording, points=points))
    assert any("scatter" in w for w in result.warnings)
    low, high = result.c.interval95 or (0, 0)
    assert low <= truth.stiffness(2.5) <= high


def test_curves_alone_are_enough() -> None:
    depth = np.linspace(0.01, 0.5, 30)
    force = 3.5 * depth * (1 + 0.9 * depth / 3)
    rng = np.random.default_rng(0)
    curves = tuple(
        Curve(
            str(k),
            100.0 * k + depth,
            depth,
            np.column_stack([0 * depth, 0 * depth, force + 0.003 * e]),
            np.full(30, "load"),
        )
        for k, e in enumerate(rng.standard_normal((6, 30)))
    )
    sensor = Sensor("custom", 10, 10, (0.1, 0.1), Gel(3.0, poisson_ratio=0.48, poisson_ratio_std=0.002))
    presses = tuple(Press(str(k), "A", 100.0 * k, 100.0 * k + 1) for k in range(6))
    recording = Made(sensor, {"A": Indenter("A", radius_mm=2.5)}, presses, depth_source="vision")
    result = calibrate(Measured(recording, curves=curves))
    assert result.c.value == pytest.approx(3.5, rel=0.01)
    assert "the zeros of depth and force are taken as they were recorded" in result.assumptions
    assert result.fitted.noise.scale == pytest.approx(0.003, rel=0.15)


def test_calibration_json_has_every_key_and_is_json() -> None:
    content = calibrate(draw(WELL, np.random.default_rng(0))).as_json()
    json.dumps(content, allow_nan=False)
    assert set(content) >= CALIBRATION_KEYS


def test_history_says_when_the_modulus_has_moved() -> None:
    import datetime

    rng = np.random.default_rng(1)
    sets = []
    for day, modulus in ((1, 0.2), (8, 0.2), (60, 0.23)):
        measured = draw(replace(WELL, modulus_MPa=modulus), rng)
        dated = replace(measured.recording, date=datetime.date(2026, 1, 1) + datetime.timedelta(day))  # type: ignore[type-var]
        sets.append(replace(measured, recording=dated))
    rows = history(sets[::-1])
    assert [row.moved for row in rows] == [False, False, True]
    assert rows[2].change == pytest.approx(0.15, abs=0.04)
    assert rows[0].date < rows[1].date < rows[2].date


DEPTHS = np.array(HEIGHTS_MM)
FORCES = 3.5 * DEPTHS * (1 + DEPTHS / 3)


@pytest.mark.parametrize(
    ("measured", "message"),
    [
        (points_of(-DEPTHS, FORCES), "above 0 mm"),
        (points_of(DEPTHS, -FORCES), "above 0 N"),
        (points_of(DEPTHS, FORCES[::-1]), "falls as the depth grows"),
        (points_of(10 * DEPTHS, FORCES), "larger than the gel is thick"),
        (points_of(1e-3 * DEPTHS, FORCES), "in metres"),
        (points_of(DEPTHS, FORCES, radius_mm=15.0), "as wide as the gel"),
        (points_of(DEPTHS, FORCES, gel=Gel(-3.0)), "above 0 mm"),
        (points_of(DEPTHS, FORCES, gel=Gel(3.0, poisson_ratio=0.6)), "Poisson's ratio"),
    ],
)
def test_bad_measurements_are_named(measured: Measured, message: str) -> None:
    with pytest.raises(InputError, match=message):
        calibrate(measured)


def test_depths_beyond_the_elements_are_flagged() -> None:
    for deepest, said in ((0.72, False), (1.2, True)):
        depth = deepest * np.array([0.2, 0.4, 0.6, 0.8, 1.0])
        result = calibrate(points_of(depth, 3.5 * depth * (1 + 0.87 * depth / 3)))
        assert any("elements are tabulated to 0.25" in line for line in result.warnings) == said


def test_presses_of_another_shape_are_left_out_and_named() -> None:
    measured = points_of(DEPTHS, FORCES)
    ball = Indenter("ball", shape="sphere", radius_mm=3.0)
    recording = replace(measured.recording, indenters=dict(measured.recording.indenters) | {"ball": ball})  # type: ignore[type-var]
    points = (*measured.points, replace(measured.points[0], press="9", indenter="ball", fz_N=0.1))
    result = calibrate(replace(measured, recording=recording, points=points))
    assert "9" not in result.presses_accepted
    assert any("ball" in warning for warning in result.warnings)
    with pytest.raises(InputError, match="flat_cylinder"):
        calibrate(replace(measured, recording=recording, points=points[-1:] * 2), law="paper")


def test_all_rejected_is_nothing_certified() -> None:
    measured = points_of(DEPTHS, FORCES)
    points = tuple(replace(p, accepted=False, reason="tilt") for p in measured.points)
    with pytest.raises(NothingCertified, match="1: tilt"):
        calibrate(replace(measured, points=points))


def test_rejected_presses_are_listed() -> None:
    measured = points_of(DEPTHS, FORCES)
    points = (replace(measured.points[0], accepted=False, reason="tilt"), *measured.points[1:])
    result = calibrate(replace(measured, points=points))
    assert result.as_json()["presses_rejected"] == [{"press": "1", "reason": "tilt"}]
    assert result.presses_accepted == ("2", "3", "4", "5")


def test_a_clock_that_is_stated_is_said_in_full() -> None:
    stated = Estimate(1234.5678, 0.0, (1234.5678, 1234.5678), "s")
    assert wording.estimate(stated) == "1234.5678 s (95 %: 1234.5678 to 1234.5678 s)"
