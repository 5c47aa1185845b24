"""What is no effect: the bend that theory allows, the readings' own noise, presses that do not repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_presses import indenter, observations
from test_diagnose import noisy
from test_effects import BASE, RICH
from test_screen import MODEL, TRUTH, measured, presses

from calibration.diagnosis.score_test import score_test
from calibration.effects.lateral_boundary import LateralBoundary
from calibration.fit.least_squares import fit
from calibration.fit.outlying_presses import WANDERS, outlying_presses, own_zero_mm
from calibration.fit.repeats import repeat_noise
from calibration.inputs.checks import HIDDEN, clear_of_touch
from calibration.inputs.denoised_depth import denoised_depth
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import CHORD, FlatPunch
from calibration.laws.theory import bend_range
from calibration.model.composition import Model
from calibration.report.diagnosis_report import few_sentence
from calibration.report.drawing import own_offsets
from calibration.result.material import determine_material
from calibration.tasks.compare import base_model, fit_alone
from calibration.tasks.diagnose import concluded, diagnose
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.tables.punch import punch_force
from tactilevision.records.measured import Material


def test_a_bent_law_without_bend_is_the_straight_one_and_keeps_its_chord() -> None:
    data, bent = presses(2), Model(FlatPunch(bent=True))
    np.testing.assert_array_equal(bent.predict(np.append(TRUTH, 0.0), data), MODEL.predict(TRUTH, data))
    at_chord = data.shifted(CHORD * data.gel.thickness_mm - data.depth_mm)
    np.testing.assert_allclose(bent.predict(np.append(TRUTH, 0.9), at_chord), MODEL.predict(TRUTH, at_chord))


@pytest.mark.parametrize("friction", [0.0, 0.3, np.inf])
def test_finite_elements_bend_within_what_theory_allows(friction: float) -> None:
    """A curve of the table, fitted by the bent law on its own, ends inside the bounds and within its error."""
    data = observations([np.linspace(0.01, 0.59, 30)], [indenter()])
    contact = FlatContact(2.5, 0.0, 3.0, friction)
    force = punch_force(data.depth_mm, contact, material=Material(0.2, 0.48))
    found = fit(Model(FlatPunch(bent=True)), data.with_force(force))
    low, high = found.parameters[-1].bounds
    assert low < found.values[-1] < high
    assert found.rms_error_N < 0.003 * np.max(force)
    assert bend_range(0.48, 2.5 / 3, 0.2)[1] < 2.2, "a gel that stiffens beyond it still shows"


def test_a_gel_that_bends_as_theory_has_it_is_adequate() -> None:
    data, law = presses(24), Model(FlatPunch(bent=True))
    force = law.predict(np.append(TRUTH, 0.8), data)
    found = diagnose(measured(data, force, np.random.default_rng(2)), np.random.default_rng(0))
    assert found.verdict == "ADEQUATE"
    assert found.flags == ("bend_within_theory",)
    assert few_sentence(found) == ""
    few = found.fits.base.data.take(np.arange(24) < 8)
    assert "8 presses" in few_sentence(
        replace(found, fits=replace(found.fits, base=replace(found.fits.base, data=few)))
    )
    assert found.material.after.youngs_modulus.value == pytest.approx(0.2, rel=0.02)


def plateaus(count: int, rng: np.random.Generator) -> Observations:
    """Ramps and long holds, the depth read with 1.5 um of noise; the force is that of the true depth."""
    true = np.concatenate([np.linspace(0.03, 0.55, 12), np.full(14, 0.55)])
    time = [300.0 * k + np.arange(true.size) / (2 if k % 2 else 1) for k in range(count)]
    data = observations([true] * count, [indenter()] * count, time_s=time)
    data = replace(data, phase=np.tile(["load"] * 12 + ["hold"] * 14, count))
    taken = measured(data, MODEL.predict(TRUTH, data), rng)
    return replace(taken.shifted(0.0015 * rng.standard_normal(data.size)), depth_std_mm=np.full(data.size, 0.0015))


@pytest.mark.slow
def test_noise_of_the_depth_sorts_no_residuals() -> None:
    data = plateaus(16, np.random.default_rng(3))
    hold = data.phase == "hold"
    assert np.unique(denoised_depth(data)[hold]).size == 16, "one depth a hold"
    assert np.std(denoised_depth(data)[~hold] - np.tile(np.linspace(0.03, 0.55, 12), 16)) < 0.0015
    assert diagnose(data, np.random.default_rng(0)).verdict == "ADEQUATE"


def test_samples_at_the_touch_are_left_out() -> None:
    data = presses(3)
    near = np.where(np.arange(data.size) % 17 == 0, 0.005, data.depth_mm)
    assert clear_of_touch(data.shifted(near - data.depth_mm)).size == data.size - 3
    assert clear_of_touch(data) is data


def test_a_shallow_press_keeps_its_deeper_half_and_the_others_lose_their_touch() -> None:
    shallow, deep = np.linspace(0.02, 0.1, 9), np.linspace(0.02, 0.4, 20)
    true = [shallow, deep, deep]
    times = [300.0 * k + np.arange(float(one.size)) for k, one in enumerate(true)]
    data = observations(true, [indenter()] * 3, time_s=times)
    clear = clear_of_touch(data, zero_mm=0.043)  # three of them: 0.13 mm
    kept = [clear.depth_mm[clear.press == k] for k in range(3)]
    assert np.array_equal(kept[0], shallow[shallow > 0.05])
    assert all(np.array_equal(one, deep[deep > 0.13]) for one in kept[1:])


def test_air_near_the_touch_stays_where_the_noise_of_forces_hides_what_zeros_move() -> None:
    """Zeros of 10 um move a force 20 um off the gel by .76 um times the slope (rms, drawn), 15 um off by 1.7."""
    depth = np.array([-0.02, -0.015, 0.02, 0.1, 0.2, 0.3])
    data = observations([depth] * 3, [indenter()] * 3, time_s=[300.0 * k + np.arange(6.0) for k in range(3)])
    zeros = 0.01 * np.random.default_rng(1).standard_normal(400_000)
    moved = [float(np.sqrt(np.mean(np.maximum(zeros - off, 0) ** 2))) for off in (0.02, 0.015)]
    for hidden, kept in ((0.9 * moved[0], 0), (1.1 * moved[0], 1), (0.9 * moved[1], 1), (1.1 * moved[1], 2)):
        noise = np.full(data.size, hidden / HIDDEN)
        clear = clear_of_touch(data, zero_mm=0.01, force_noise_mm=noise)
        assert np.count_nonzero(clear.depth_mm < 0) == 3 * kept
        assert np.count_nonzero(clear.depth_mm == 0.02) == 0, "in the gel near the touch none stay"


def test_the_touch_stays_on_the_way_out_where_the_gel_pulls() -> None:
    ramp = np.concatenate([np.linspace(-0.03, -0.02, 5), np.linspace(0.03, 0.4, 12)])
    out = np.array([0.2, 0.05, 0.01, 0.004, -0.004, -0.01, -0.02])
    true = np.concatenate([ramp, out])
    data = observations(
        [true] * 6, [indenter()] * 6, time_s=[300.0 * k + np.arange(float(true.size)) for k in range(6)]
    )
    air = data.with_force(np.maximum(MODEL.predict(TRUTH, data), 0.0))
    clinging = np.where(data.depth_mm < 0, 8.0 * data.depth_mm, air.normal_N)
    clinging = np.where(np.tile(np.arange(true.size) < ramp.size, 6), air.normal_N, clinging)
    assert clear_of_touch(air).size == data.size - 6 * 4
    assert clear_of_touch(data.with_force(clinging)).size == data.size


def test_much_gel_beside_does_not_hide_that_a_face_pulls() -> None:
    """A first fit takes the pull for zeros of 30 um, so that .1 mm on either side is near the touch."""
    depth = np.concatenate([np.linspace(-0.2, -0.15, 5), np.linspace(0.2, 0.4, 8), np.linspace(0.2, 0.004, 40)])
    true = np.concatenate([depth, [-0.005, -0.01, -0.02]])
    times = [300.0 * k + np.arange(float(true.size)) for k in range(6)]
    data = observations([true] * 6, [indenter()] * 6, time_s=times)
    pulls = np.where(data.depth_mm < 0, 2.0 * np.maximum(data.depth_mm, -0.02), MODEL.predict(TRUTH, data))
    pulls[data.depth_mm < -0.1] = 0.0
    kept = clear_of_touch(data.with_force(pulls), zero_mm=0.033)
    assert np.count_nonzero((kept.depth_mm < 0) & (kept.depth_mm > -0.1)) == 18


def points(force_std_N: float = 0.004) -> Observations:
    """24 points at four depths, six of each."""
    depth = [np.array([0.15 * (1 + k % 4)]) for k in range(24)]
    data = observations(depth, [indenter()] * 24)
    return replace(data, force_std_N=np.full(24, force_std_N), depth_std_mm=np.full(24, 0.001))


def test_points_of_a_camera_say_that_their_curves_take_no_part() -> None:
    data = points()
    taken = measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(5))
    for seen, flagged in ((None, False), (data.depth_mm, True)):
        fitted = fit(MODEL, replace(taken, reconstructed_mm=seen))
        result = concluded(fitted, determine_material(fitted))
        assert ("curves_not_used" in result.flags) == flagged
        assert any("only certified points" in warning for warning in result.warnings) == flagged


def test_points_are_presses_too() -> None:
    data = points()
    taken = measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(5))
    noise = repeat_noise(fit(MODEL, taken))
    assert 0.002 < noise.gain < 0.012
    assert 0.0015 < noise.zero_mm < 0.009


def unstated_points(rng: np.random.Generator, jump_mm: float) -> Observations:
    """54 points of three radii that scatter by 4.5 um; nobody says so. One of the smallest punch's is off."""
    kinds = [indenter(f"R{a}", a) for a in (1.5, 2.5, 3.5)]
    depth = [np.array([(0.15, 0.28, 0.42)[k // 3 % 3]]) for k in range(54)]
    data = observations(depth, [kinds[k % 3] for k in range(54)])
    off = 0.0045 * rng.standard_normal(54) + np.where(np.arange(54) == 3, jump_mm, 0.0)
    return data.with_force(MODEL.predict(np.array([0.2, 0.48, 0.85, 0.95, 1.1]), data.shifted(off)))


@each("jump_mm, odd", [(0.0, ()), (0.06, ("p3",))])
@each("seed", range(4))
def test_scatter_in_mm_accuses_no_press_of_the_stiffest_punch(
    seed: int, jump_mm: float, odd: tuple[str, ...]
) -> None:
    data = unstated_points(np.random.default_rng(seed), jump_mm)
    fitted = fit_alone(base_model(data), data)
    assert outlying_presses(fitted).presses == odd
    if not odd:
        in_mm = fitted.noise.scale / np.median(fitted.about.slope_N_per_mm)
        assert in_mm < fitted.noise.zero_mm, "constant in mm, not in N"


@pytest.mark.parametrize(("jump_mm", "odd"), [(0.0, ()), (0.04, ("p5",))])
def test_a_press_that_does_not_belong_is_found(jump_mm: float, odd: tuple[str, ...]) -> None:
    data = presses(20)
    force = MODEL.predict(TRUTH, data.shifted(np.where(data.press == 5, jump_mm, 0.0)))
    fitted = fit_alone(base_model(data), measured(data, force, np.random.default_rng(1)))
    found = outlying_presses(fitted)
    assert found.presses == odd
    assert own_zero_mm(fitted)[5] > 0.8 * jump_mm - 0.012


@pytest.mark.slow
def test_a_zero_that_jumps_is_unknown_since_its_press() -> None:
    data = presses(24)
    force = MODEL.predict(TRUTH, data.shifted(np.where(data.press >= 14, 0.025, 0.0)))
    found = diagnose(measured(data, force, np.random.default_rng(1)), np.random.default_rng(0))
    assert found.verdict == "UNKNOWN"
    assert "presses_wander" in found.flags
    assert found.remainder.change_point == "p14"
    shown = own_offsets(found)
    assert shown is not None
    assert shown.labels[shown.since or 0] == "p14"
    assert np.mean(shown.offset_um[14:]) - np.mean(shown.offset_um[:14]) == pytest.approx(25, abs=5)
    assert found.measure_next[0].action.startswith("repeat the first press")


def test_a_force_sensor_whose_zero_follows_the_temperature_is_told_by_the_air() -> None:
    warmth = RICH.temperature_C - 22
    for per_K, follows in ((0.0, False), (0.003, True)):
        data = noisy(RICH, Model(FlatPunch()).predict(BASE, RICH) + per_K * warmth, 5)
        found = score_test(
            fit_alone(base_model(data), data), (), rng=np.random.default_rng(0), draws=99, of_rig=True
        )
        p = {one.key: one.p_adjusted for one in found.others}[f"{WANDERS}T of the force"]
        assert (p < 0.05) is follows


def test_one_distance_from_the_edge_holds_the_length_of_its_effect() -> None:
    data = presses(4)
    placed = replace(data, presses=replace(data.presses, x_mm=np.array([0.0, 5, -5, 5]), y_mm=np.zeros(4)))
    assert LateralBoundary().parameters_on(placed)[1].fixed
    spread = replace(data, presses=replace(data.presses, x_mm=np.array([0.0, 2, 4, 5]), y_mm=np.zeros(4)))
    assert not LateralBoundary().parameters_on(spread)[1].fixed
    names = [indenter("narrow", 1.0), indenter("wide", 2.0)] * 3
    two = observations([np.linspace(0.1, 0.4, 5)] * 6, names, place_mm=[(0, 0)] * 2 + [(5, 0)] * 4)
    assert not LateralBoundary().parameters_on(two)[1].fixed, "their rims lie at four distances from the edge"
