"""Rivals near the best are held against it by the likelihood of their own fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations
from test_screen import MODEL, TRUTH, measured, presses, pure

from calibration.diagnosis import refit as confirmation
from calibration.diagnosis.refit import HeldOut, adopt, hold_out, log_volume, refit_with
from calibration.effects import EFFECTS
from calibration.fit.least_squares import Problem
from calibration.inputs.observations import Observations
from calibration.noise.model import Whitener
from calibration.tasks.diagnose import diagnose


def test_a_rival_that_fits_better_by_its_own_noise_goes_first() -> None:
    """25 um of depth at one radius, with the order turned round as under the noise of a model that lacks it."""
    data = presses(12)
    force = (MODEL + EFFECTS["depth_zero"]).predict(np.array([*TRUTH, 0.025]), data)
    base = pure(measured(data, force, np.random.default_rng(2)))
    truth, other = (refit_with(base, EFFECTS[key]) for key in ("depth_zero", "tilt"))
    wrong = replace(other, chi2=truth.chi2 - 5)
    far = replace(other, effect=EFFECTS["stiffening"], chi2=base.chi2)
    again = confirmation.weighed_again(base, wrong, (wrong, truth, far))
    assert [c.effect.key for c in again] == ["depth_zero", "tilt", "stiffening"]
    assert far.cost - wrong.cost == pytest.approx(again[2].cost - again[0].cost)
    alone = confirmation.weighed_again(base, truth, (truth, far))
    assert [c.chi2 for c in alone] == [truth.chi2, far.chi2], "nothing near it: as it was"


def test_the_likelihood_is_that_of_the_whole_covariance() -> None:
    data = presses(4)
    fitted = pure(measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(1)))
    noise, about = fitted.noise, fitted.about
    same = fitted.data.press[:, None] == fitted.data.press
    covariance = same * (
        noise.gain**2 * np.outer(about.force_N, about.force_N)
        + noise.zero_mm**2 * np.outer(about.slope_N_per_mm, about.slope_N_per_mm)
    )
    covariance += np.diag((noise.scale * about.base_N) ** 2)
    assert log_volume(fitted) == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-9)


def drawn_off(count: int) -> Observations:
    """Curves that end 20 um above the touch on the way out."""
    depth = np.concatenate([np.linspace(0.03, 0.3, 12), np.linspace(0.25, -0.02, 12)])
    phase = [["load"] * 12 + ["unload"] * 12] * count
    times = [300.0 * k + np.linspace(0.0, 4.0, 24) for k in range(count)]
    return observations([depth] * count, [indenter()] * count, time_s=times, phase=phase)


def stray(correlation: float, seed: int) -> Observations:
    """A reading of -60 mN beyond the touch in one press of twelve, beside 4 mN of noise alike in a press."""
    data, rng = drawn_off(12), np.random.default_rng(seed)
    noise = rng.standard_normal((12, 24))
    for k in range(1, 24):
        noise[:, k] = correlation * noise[:, k - 1] + np.sqrt(1 - correlation**2) * noise[:, k]
    force = MODEL.predict(TRUTH, data) + 0.004 * noise.ravel()
    force[-1] = 1.001 * (MODEL + EFFECTS["adhesion"]).predict(np.array([*TRUTH, 0.001]), data)[-1]
    return data.with_force(force)


@pytest.mark.parametrize("correlation", [0.0, 0.7, 0.9])
def test_one_stray_reading_is_no_effect(correlation: float) -> None:
    """Adhesion can follow it, and rests on it, in however many white entries it stands."""
    base = pure(stray(correlation, 2))
    found = refit_with(base, EFFECTS["adhesion"])
    assert found.cost < base.chi2 - 20
    assert found.cost + confirmation.by_one_reading(base, found) > base.chi2 - confirmation.AS_GOOD


def test_a_face_that_clings_rests_on_many_readings() -> None:
    data = drawn_off(12)
    many = (MODEL + EFFECTS["adhesion"]).predict(np.array([*TRUTH, 0.001]), data)
    base = pure(data.with_force(many + 0.004 * np.random.default_rng(5).standard_normal(data.size)))
    found = refit_with(base, EFFECTS["adhesion"])
    assert found.cost + confirmation.by_one_reading(base, found) < base.chi2 - 100
    assert not confirmation.rests_on_one_reading(base, found)


def test_a_diagnosis_names_no_effect_for_one_stray_reading() -> None:
    found = diagnose(stray(0.9, 1), np.random.default_rng(0))
    assert found.verdict != "IDENTIFIED"
    assert not found.effects


def test_presses_left_out_are_not_predicted_from_their_own_readings() -> None:
    """Adhesion asks readings whether a face still holds; of presses left out it may not."""
    data = drawn_off(6)
    model, values = MODEL + EFFECTS["adhesion"], np.array([*TRUTH, 2e-5])
    pulls = model.predict(values, data.with_force(np.full(data.size, -1.0)))
    base = pure(data.with_force(pulls))
    size = values.size - 1  # held at what they are, so that nothing is found anew but E
    error = hold_out(model, base, start=values, folds=np.arange(6), kept=range(1, size + 1))
    by_law = pulls - model.predict(values, data.with_force(np.zeros(data.size)))
    assert np.ptp(by_law) > 0.01, "here the law alone says otherwise than what was read"
    assert error.rms_N == pytest.approx(np.sqrt(np.mean(by_law**2)), rel=0.05)
    assert np.max(np.abs(pulls - model.predict(values, base.data))) < 0.2 * np.ptp(by_law)


def test_a_face_that_never_let_go_is_given_the_least_work_that_does_as_well() -> None:
    """Drawn off to 20 um above the touch, where any work of adhesion from some size on holds."""
    data = drawn_off(12)
    clings = EFFECTS["adhesion"]
    force = (MODEL + clings).predict(np.array([*TRUTH, 0.001]), data)
    base = pure(measured(data, force, np.random.default_rng(3)))
    found = refit_with(base, clings)
    assert confirmation.inside(found)
    assert 0 < found.own_values[0] < 0.002
    assert found.cost < base.chi2 - 100
    work = adopt(base, found).estimate("adhesion.work_N_per_mm")
    assert (work.std or 1.0) <= 0.005, "no wider than what it may be at all"
    assert work.interval95 == (0.0, 0.005)


@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_faces_that_never_let_go_are_predicted_where_others_never_did(seed: int) -> None:
    """Readings leave the work of adhesion open; by the least of it faces let go that no reading tells of."""
    data, clings = drawn_off(6), EFFECTS["adhesion"]
    force = (MODEL + clings).predict(np.array([*TRUTH, 0.001]), data)
    base = pure(measured(data, force, np.random.default_rng(seed)))
    assert confirmation.skill(base, adopt(base, refit_with(base, clings)), clings) > 0.6


@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_what_is_added_to_a_threshold_is_held_against_the_same_weights(seed: int) -> None:
    """About a face that lets go slopes jump: chi^2 by the slopes of the step before is another one."""
    data, clings = drawn_off(12), EFFECTS["adhesion"]
    force = (MODEL + clings).predict(np.array([*TRUTH, 0.001]), data)
    base = pure(measured(data, force, np.random.default_rng(seed)))
    fitted = adopt(base, refit_with(base, clings))
    whitener = Whitener(fitted.data, fitted.noise, fitted.about)
    same = Problem(fitted.model, fitted.data, fitted.parameters, whitener)
    assert float(np.sum(same.residual(fitted.values[fitted.free]) ** 2)) == pytest.approx(fitted.chi2, rel=1e-9)


def test_each_fold_is_predicted_by_what_predicts_the_others_best() -> None:
    one = HeldOut(np.array([1.0, 1.0, 1.0]), np.array([1.0, 9.0, 9.0]), 27)
    other = HeldOut(np.array([4.0, 4.0, 4.0]), np.array([9.0, 8.0, 2.0]), 27)
    found = HeldOut.of_each_best([one, other])
    assert found.white.tolist() == [9.0, 9.0, 9.0], "each by the worse one, which its own presses would not choose"
    assert found.of_force.tolist() == [4.0, 1.0, 1.0]
    assert found.rms_N == pytest.approx(np.sqrt(6 / 27))


@pytest.mark.parametrize("seed", [6, 11])
def test_a_radius_that_is_pressed_once_keeps_its_slope_where_its_press_is_left_out(seed: int) -> None:
    """A force read 30 mN too large, in six presses of three radii: a slope no other press tells hides nothing."""
    kinds = [indenter(f"{a}", a) for a in (1.5, 2.5, 2.5, 2.5, 2.5, 3.5)]
    data = observations([np.linspace(0.03, top, 20) for top in (0.4, 0.3, 0.2, 0.4, 0.3, 0.4)], kinds)
    bias = EFFECTS["force_bias"]
    force = (MODEL + bias).predict(np.array([0.2, 0.48, 0.5, 0.8, 1.1, 0.03]), data)
    rng = np.random.default_rng(seed)
    base = pure(
        data.with_force(
            force * (1 + 0.005 * rng.standard_normal(6)[data.press]) + 0.004 * rng.standard_normal(120)
        )
    )
    found = refit_with(base, bias)
    gain = confirmation.skill(base, adopt(base, found), found.effect)
    assert 0.5 < gain < 1
    before = hold_out(base.model, base, start=base.values, folds=np.arange(6))
    assert before.rms_N < 2 * base.rms_error_N
