"""From points to E and nu: the published numbers, honest intervals, and a sentence for every bad input."""

from __future__ import annotations

import csv
import json
from contextlib import nullcontext as does_not_raise
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from each import each
from made_presses import indenter, observations
from made_recordings import HEIGHTS_MM, Truth, draw, points_of, recording_of

from calibration.inputs.checks import check
from calibration.inputs.observations import Measured
from calibration.report import wording
from calibration.tasks.calibrate import calibrate, history
from tactilevision.errors import InputError, NothingCertified
from tactilevision.records.measured import Curve, Estimate
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

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
    recording = replace(measured.recording, sensor=Sensor("custom", 10, 10, (0.1, 0.1), gel))
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
    recording = replace(measured.recording, indenters=silent)
    result = calibrate(replace(measured, recording=recording, points=points))
    assert any("scatter" in w for w in result.warnings)
    low, high = result.c.interval95 or (0, 0)
    assert low <= truth.stiffness(2.5) <= high


def pressed_curves() -> Measured:
    """Six presses of one punch, c = 3.5 N/mm, force's noise 3 mN, no points."""
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
    recording = recording_of(sensor, {"A": Indenter("A", radius_mm=2.5)}, presses, depth_source="vision")
    return Measured(recording, curves=curves)


def test_curves_alone_are_enough() -> None:
    result = calibrate(pressed_curves())
    assert result.c.value == pytest.approx(3.5, rel=0.01)
    assert "the zeros of depth and force are taken as they were recorded" in result.assumptions
    assert result.fitted.noise.scale == pytest.approx(0.003, rel=0.15)


def test_a_copied_press_is_left_out_of_a_calibration() -> None:
    measured = pressed_curves()
    copy = replace(measured.curves[5], depth_mm=measured.curves[2].depth_mm, force_N=measured.curves[2].force_N)
    result = calibrate(replace(measured, curves=(*measured.curves[:5], copy)), test=False)
    assert result.presses_accepted == ("0", "1", "2", "3", "4")
    assert "press 5 has the samples of press 2: excluded" in result.warnings


def test_a_calibration_refuses_times_in_milliseconds() -> None:
    measured = pressed_curves()
    slow = tuple(replace(curve, time_s=1e4 * curve.time_s) for curve in measured.curves)
    with pytest.raises(InputError, match="are these in ms"):
        calibrate(replace(measured, curves=slow))


def test_presses_out_of_phase_are_left_out() -> None:
    """Ramps of .1 s beside slow ones, the depth read 60 ms late: c is the slow ones', and a warning says so."""
    curves, presses = [], []
    rng = np.random.default_rng(0)  # of a micronewton: presses that agree in every digit are copies
    for k, speed in enumerate((4.0, 0.4, 0.4, 4.0, 0.4)):
        time = 3 * 0.4 / speed * np.linspace(0, 1, 40)
        depth, late = (np.interp((time - by) * speed / 0.4, [0, 1, 2, 3], [0, 0.4, 0.4, 0]) for by in (0.0, 0.06))
        force = np.column_stack([0 * depth, 0 * depth, 3.5 * depth * (1 + 0.9 * depth / 3)])
        force = force + 1e-6 * rng.standard_normal(force.shape)
        curves.append(Curve(str(k), 100.0 * k + time, late, force, np.full(40, "")))
        presses.append(Press(str(k), "A", 100.0 * k, 100.0 * k + time[-1], speed_mm_s=speed))
    sensor = Sensor("custom", 10, 10, (0.1, 0.1), Gel(3.0, poisson_ratio=0.48, poisson_ratio_std=0.002))
    recording = recording_of(sensor, {"A": Indenter("A", radius_mm=2.5)}, tuple(presses), depth_source="stage")
    result = calibrate(Measured(recording, curves=tuple(curves)), test=False)
    assert result.presses_accepted == ("1", "2", "4")
    assert result.presses_rejected == (("0", "out_of_phase"), ("3", "out_of_phase"))
    (said,) = [warning for warning in result.warnings if "60 ms apart" in warning]
    assert "loading and unloading differ by" in said
    assert "presses that load within twice that time are excluded (0, 3)" in said
    assert "ynchronise" not in said
    assert result.c.value == pytest.approx(3.5, rel=0.05)


def test_calibration_json_has_every_key_and_is_json() -> None:
    content = calibrate(draw(WELL, np.random.default_rng(0))).as_json()
    json.dumps(content, allow_nan=False)
    assert set(content) >= CALIBRATION_KEYS


def test_history_compares_one_radius() -> None:
    """Of two radii with as many points each, and of the same less one point of the first radius."""
    measured = draw(replace(WELL, radii_mm=(1.5, 2.5)), np.random.default_rng(2))
    fewer = replace(measured, points=measured.points[1:])
    assert history([measured, fewer])[1].change == pytest.approx(0, abs=0.02)


def test_history_says_when_the_modulus_has_moved() -> None:
    import datetime

    rng = np.random.default_rng(1)
    sets = []
    for day, modulus in ((1, 0.2), (8, 0.2), (60, 0.23)):
        measured = draw(replace(WELL, modulus_MPa=modulus), rng)
        dated = replace(measured.recording, date=datetime.date(2026, 1, 1) + datetime.timedelta(day))
        sets.append(replace(measured, recording=dated))
    rows = history(sets[::-1])
    assert [row.moved for row in rows] == [False, False, True]
    assert rows[2].change == pytest.approx(0.15, abs=0.04)
    assert rows[0].date < rows[1].date < rows[2].date


DEPTHS = np.array(HEIGHTS_MM)
FORCES = 3.5 * DEPTHS * (1 + DEPTHS / 3)


@each(
    "measured, message",
    [
        (points_of(-DEPTHS, FORCES), "above 0 mm"),
        (points_of(DEPTHS, -FORCES), "above 0 N"),
        (points_of(DEPTHS, FORCES[::-1]), "falls as the depth grows"),
        (points_of(10 * DEPTHS, FORCES), "larger than the gel is thick"),
        (points_of(1e-3 * DEPTHS, FORCES), "in metres"),
        (points_of(DEPTHS, FORCES, radius_mm=15.0), "as wide as the gel"),
    ],
)
def test_bad_measurements_are_named(measured: Measured, message: str) -> None:
    with pytest.raises(InputError, match=message):
        calibrate(measured)


def test_what_is_not_measured_is_told_how_to_become_so() -> None:
    measured = points_of(DEPTHS, FORCES)
    for given in (measured.recording, [DEPTHS, FORCES]):
        with pytest.raises(InputError, match=r"Measured\(recording, points, curves\)"):
            calibrate(given)  # type: ignore[arg-type]
    one, several = calibrate(measured), calibrate([measured])
    assert one.c == several.c


def test_curves_whose_depth_has_the_wrong_sign_are_refused() -> None:
    """A little air goes into the gel when the sign is turned: that alone must not be fitted."""
    depth = np.concatenate([np.linspace(-0.03, 0.0, 6), np.linspace(0.05, 0.5, 20)])
    turned = observations([-depth] * 2, [indenter("A")] * 2).with_force(np.tile(np.maximum(3.5 * depth, 0.0), 2))
    with pytest.raises(InputError, match="largest forces occur at depths"):
        check(turned)


def test_negative_depths_with_hardly_any_air_are_asked_about_their_sign() -> None:
    """The deepest sample is then a breath of air: no reason to ask for metres."""
    depth = np.concatenate([np.linspace(-0.001, 0.0, 6), np.linspace(0.05, 0.5, 20)])
    turned = observations([-depth] * 2, [indenter("A")] * 2).with_force(np.tile(np.maximum(3.5 * depth, 0.0), 2))
    with pytest.raises(InputError, match="check its sign"):
        check(turned)


@pytest.mark.parametrize("zero_N", [-3.0, 0.0, 3.0])
def test_a_force_that_was_not_tared_is_no_depth_of_the_wrong_sign(zero_N: float) -> None:
    """More samples lie in air than in the gel, and read a zero larger than the largest force."""
    depth = np.concatenate([np.linspace(-0.5, 0.0, 40), np.linspace(0.02, 0.5, 25)])
    force = np.tile(np.maximum(3.5 * depth, 0.0) + zero_N, 2)
    for side, told in ((1, does_not_raise()), (-1, pytest.raises(InputError, match="or tare the force"))):
        with told:
            check(observations([side * depth] * 2, [indenter("A")] * 2).with_force(force))


def test_depths_beyond_the_elements_are_flagged() -> None:
    for deepest, said in ((0.72, False), (1.2, True)):
        depth = deepest * np.array([0.2, 0.4, 0.6, 0.8, 1.0])
        result = calibrate(points_of(depth, 3.5 * depth * (1 + 0.87 * depth / 3)))
        assert any("elements are tabulated to 0.25" in line for line in result.warnings) == said


def test_presses_of_another_shape_are_left_out_and_named() -> None:
    measured = points_of(DEPTHS, FORCES)
    ball = Indenter("ball", shape="sphere", radius_mm=3.0)
    recording = replace(measured.recording, indenters=dict(measured.recording.indenters) | {"ball": ball})
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
