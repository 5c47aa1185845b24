"""From a misfit to its cause: named where it can be, and said so where it cannot."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_presses import indenter, observations
from test_calibrate import paper_points
from test_effects import BASE, RICH, data_for, planted
from test_screen import MODEL, TRUTH, measured, presses

import calibration.diagnosis.forward_selection as searching
import calibration.diagnosis.refit as confirmation
import calibration.tasks.diagnose as module
from calibration.diagnosis.covariates import change_point
from calibration.diagnosis.decision import theory_beta
from calibration.diagnosis.diagnosis import Diagnosis
from calibration.diagnosis.refit import Candidate
from calibration.effects import EFFECTS
from calibration.effects.depth_zero import DepthZero
from calibration.fit.least_squares import Fit, fit
from calibration.inputs.gather import observe_curves, observe_points
from calibration.inputs.observations import Measured, Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import Effect, State
from calibration.noise.model import Noise
from calibration.tasks.compare import compare
from calibration.tasks.diagnose import diagnose
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.files.writing import write_json
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.press.certification import certify
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Floats

DIAGNOSIS_KEYS = {
    "verdict",
    "effects",
    "candidates",
    "not_testable",
    "rms_error_N",
    "material",
    "covariates",
    "measure_next",
    "change_point",
    "flags",
}


def noisy(data: Observations, force_N: Floats, seed: int) -> Observations:
    rng = np.random.default_rng(seed)
    gain, zero = 0.005 * rng.standard_normal(data.count), 0.004 * rng.standard_normal(data.count)
    slope = Model(FlatPunch()).slope(BASE, data)
    noise = 0.004 * rng.standard_normal(data.size)
    return data.with_force(force_N * (1 + gain[data.press]) + slope * zero[data.press] + noise)


SLOW = [pytest.param(k, marks=pytest.mark.slow) for k in ("viscoelasticity", "thickness_wedge", "tilt", "ageing")]


@pytest.mark.parametrize("key", ["depth_zero", *SLOW])
@pytest.mark.slow
def test_a_hidden_effect_is_named_and_E_comes_back(key: str, tmp_path: Path) -> None:
    effect = EFFECTS[key]
    data = data_for(effect).take(np.arange(RICH.count if key in ("ageing", "thickness_wedge") else 18))
    values = np.array([0.015, 0.0]) if key == "tilt" else effect.starts(data)[0]  # 10 mrad would not be seen
    force = planted(effect, values, data)
    found = diagnose(noisy(data, force, 10), np.random.default_rng(0))
    assert found.verdict in ("IDENTIFIED", "AMBIGUOUS")
    assert key in found.candidates
    assert found.effects[0].key == key
    assert found.effects[0].p_adjusted < 0.05
    assert found.effects[0].transfer_skill > 0  # in N a tilt drowns in the deep presses
    assert found.errors.held_out_after < found.errors.held_out_before * (1.01 if key == "tilt" else 1)
    assert found.material.after.youngs_modulus.value == pytest.approx(0.2, rel=0.02)
    content = found.as_json()
    assert set(content) >= DIAGNOSIS_KEYS
    write_json(tmp_path / "diagnosis.json", content)
    json.loads((tmp_path / "diagnosis.json").read_text())


def test_what_one_radius_cannot_tell_apart_stays_a_set_with_the_way_out() -> None:
    data = presses(16)
    shifted = measured(data, MODEL.predict(TRUTH, data.shifted(0.015)), np.random.default_rng(3))
    found = diagnose(shifted, np.random.default_rng(0))
    assert found.verdict == "AMBIGUOUS"
    assert set(found.candidates) == {"depth_zero", "force_bias"}
    sigma = {a.what: a.separation_sigma for a in found.measure_next if np.isfinite(a.separation_sigma)}
    assert found.measure_next[0].what in sigma, "what tells the candidates apart comes first"
    assert found.measure_next[0].action.startswith(
        ("depth zero from force bias: ", "force bias from depth zero: ")
    )
    assert sigma["record air before the first touch"] > 3
    assert sigma["press with two more radii (x .6 and x 1.4)"] > 3
    assert "repeat the presses in a month" not in sigma
    low, high = found.material.after.youngs_modulus.interval95 or (0, 0)
    assert low <= 0.2 <= high


@pytest.mark.parametrize(
    ("fails", "fault"),
    [
        pytest.param("refit_with", ConvergenceError("no minimum"), marks=pytest.mark.slow),
        pytest.param("refit_with", RuntimeError("broken"), marks=pytest.mark.slow),
        pytest.param("adopt", ConvergenceError("no minimum"), marks=pytest.mark.slow),
        pytest.param("skill", ZeroDivisionError(), marks=pytest.mark.slow),
        pytest.param("separation", ConvergenceError("no minimum"), marks=pytest.mark.slow),
    ],
)
def test_a_candidate_that_does_not_fit_is_passed_over(
    fails: str, fault: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = confirmation if fails == "separation" else searching
    whole = getattr(where, fails)
    asked = []

    def failing(fitted: Fit, what: Candidate | Effect, *rest: Effect, **how: bool) -> object:
        effect = (rest or (what.effect if isinstance(what, Candidate) else what,))[0]
        asked.append(effect.key)
        if effect.key == (asked[0] if fails in ("adopt", "skill") else "depth_zero"):
            raise fault
        return whole(fitted, what, *rest, **how)

    monkeypatch.setattr(where, fails, failing)
    data = presses(8)
    shifted = measured(data, MODEL.predict(TRUTH, data.shifted(0.015)), np.random.default_rng(3))
    found = diagnose(shifted, np.random.default_rng(0))
    assert asked
    assert found.verdict in ("IDENTIFIED", "AMBIGUOUS")
    if fails != "separation":
        failed = asked[0] if fails in ("adopt", "skill") else "depth_zero"
        assert next(effect.key for effect in found.effects) in {"depth_zero", "force_bias"} - {failed}


def test_an_effect_that_finds_no_minimum_leaves_the_comparison_and_the_next_one_stays() -> None:
    class Stubborn(DepthZero):
        key = "stubborn"

        def apply(self, state: State, values: Floats, data: Observations) -> State:
            raise ConvergenceError("this one never settles")

    data = presses(8)
    shifted = measured(data, MODEL.predict(TRUTH, data.shifted(0.02)), np.random.default_rng(3))
    found = compare(shifted, [Stubborn(), "depth_zero"], rng=np.random.default_rng(0))
    assert [model.name for model in found.models] == ["flat_punch", "flat_punch + depth_zero"]
    ((key, why),) = found.left_out
    assert (key, why) == ("stubborn", "it failed: ConvergenceError: this one never settles")
    with pytest.raises(InputError, match="never settles"):
        diagnose(shifted, np.random.default_rng(0), known=[Stubborn()])


@pytest.mark.parametrize(("relative", "flagged"), [(0.1, False), (0.38, True)])
def test_a_thickness_far_from_the_stated_one_is_flagged(relative: float, flagged: bool) -> None:
    model = Model(FlatPunch()) + EFFECTS["thickness"]
    force = model.predict(np.append(BASE, relative), RICH)
    found = fit(model, RICH.with_force(force), noise=Noise(1e-3, 1e-4, 1e-4, stated=False))
    assert found.estimate("thickness.relative").value == pytest.approx(relative, rel=0.05)
    assert module._beyond_prior(found, "thickness") is flagged


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "verdict", "keys"),
    [
        ("hidden_unknown", "UNKNOWN", []),
        ("hidden_material", "IDENTIFIED", ["viscoelasticity"]),
        ("hidden_two", "IDENTIFIED", ["viscoelasticity", "thickness_wedge"]),
    ],
)
def test_the_samples_end_in_their_verdicts(name: str, verdict: str, keys: list[str]) -> None:
    recording = read_recording(Path(__file__).parents[2] / "sample_frames" / name)
    data = observe_curves([Measured(recording, curves=recording.curves)])
    found = diagnose(data, np.random.default_rng(0))
    assert found.verdict == verdict
    assert [effect.key for effect in found.effects] == keys


@pytest.mark.slow
def test_the_rig_with_wrong_balls_is_found_out_by_its_pictures_and_a_sound_one_is_not() -> None:
    """The balls of hidden_rig are stated a quarter too large, so that depths read a fifth too small."""
    for name, verdict, keys in (("hidden_rig", "IDENTIFIED", ["photometric_gain"]), ("gelslim3", "ADEQUATE", [])):
        recording = read_recording(Path(__file__).parents[2] / "sample_frames" / name)
        points = certify(recording, build_reconstructor(recording, "polynomial")).points
        found = diagnose(observe_points(Measured(recording, points)), np.random.default_rng(0))
        assert found.verdict == verdict, name
        assert [effect.key for effect in found.effects] == keys
        if keys:
            low, high = dict(found.effects[0].parameters)["gain"].interval95 or (0.0, 0.0)
            assert low < 1 / 1.25 - 1 < high < -0.05


def test_clean_presses_are_adequate_and_say_what_they_would_have_shown() -> None:
    data = presses()
    found = diagnose(
        measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(1)), np.random.default_rng(0)
    )
    assert found.verdict == "ADEQUATE"
    assert found.effects == ()
    assert 0 < found.limits.visible["depth_zero"] < 0.05
    assert "thickness" in found.limits.not_testable
    assert found.limits.possible_bias["force_gain"] == pytest.approx(0.02, rel=0.02), "2 % of gain is 2 % of E"
    assert -0.12 < found.limits.possible_bias["thickness"] < -0.05, "a gel thicker than stated reads too soft"
    assert found.limits.possible_bias["bevel_rise"] == 0, "no bevel certified these depths"
    assert not set(found.limits.below_visibility) & set(found.limits.not_testable)
    assert found.limits.below_visibility["edge_fillet"] < 0, "a blunt punch is softer, and E reads low"


@pytest.mark.slow
def test_what_no_effect_explains_is_unknown() -> None:
    """An amplifier with two ranges: its zero is .1 N larger above 1 N, at any depth."""
    data = presses(14)
    force = MODEL.predict(TRUTH, data)
    force = force + 0.1 * (force > 1)
    found = diagnose(measured(data, force, np.random.default_rng(4)), np.random.default_rng(0))
    assert found.verdict == "UNKNOWN"
    assert found.search.covariates[0].p_adjusted < 0.025


def test_the_published_points_are_not_adequate() -> None:
    found = diagnose(observe_points(paper_points()), np.random.default_rng(0))
    assert found.verdict == "AMBIGUOUS"
    assert found.flags == ("beta_outside_theory",)
    assert set(found.candidates) >= {"thickness", "edge_fillet", "depth_zero", "stiffening"}
    needed = {w.key: w for w in found.remainder.would_have_to_be}
    assert needed["thickness"].value == pytest.approx(2.25 / 3 - 1, abs=0.01)
    assert needed["depth_zero"].value == pytest.approx(-0.0175, abs=0.002)
    assert needed["depth_zero"].r_squared == pytest.approx(0.977, abs=0.008)
    assert needed["edge_fillet"].r_squared > 0.999
    assert any("radii" in action.action for action in found.measure_next)


def test_theory_beta_at_the_thinner_gel_is_as_finite_elements_have_it() -> None:
    assert theory_beta(2.5, 3.0) == pytest.approx(0.85)
    assert theory_beta(2.5, 2.25) * 3.0 / 2.25 == pytest.approx(1.5, abs=0.02)


def test_compare_shows_the_error_fall_to_the_floor() -> None:
    data = presses()
    shifted = measured(data, MODEL.predict(TRUTH, data.shifted(0.02)), np.random.default_rng(3))
    found = compare(shifted, ["depth_zero"], rng=np.random.default_rng(0))
    base, better = found.models
    assert better.name == "flat_punch + depth_zero"
    assert better.held_out_N < 0.8 * base.held_out_N
    assert better.held_out_N == pytest.approx(better.repeatability_N, rel=0.25)
    assert base.covariates[0].p_adjusted < 0.01 < better.covariates[0].p_adjusted
    rows = found.as_json()
    for row, model in zip(rows, (base, better), strict=True):
        assert row["rms_error_N"] == {
            "before": base.rms_N,
            "after": model.rms_N,
            "held_out_before": base.held_out_N,
            "held_out_after": model.held_out_N,
            "floor": model.repeatability_N,
            "in_sample": model.rms_N,
            "held_out": model.held_out_N,
            "repeats": rows[0]["rms_error_N"]["repeats"],
            "share_removed": pytest.approx(row["rms_error_N"]["share_removed"], abs=1e-9),
        }
    assert rows[1]["rms_error_N"]["share_removed"] > 0.8
    assert better.as_json()["parameters"]["depth_zero.offset_mm"]["value"] == pytest.approx(0.02, abs=0.004)


def test_a_jump_is_dated_to_its_press() -> None:
    data = presses()
    force = MODEL.predict(TRUTH, data) * np.where(data.press < 14, 1.0, 1.06)
    assert (
        change_point(fit(MODEL, measured(data, force, np.random.default_rng(0))), np.random.default_rng(1))
        == "p14"
    )


def analysed(data: Observations) -> tuple[Diagnosis, str]:
    """The diagnosis of the plain law on these presses, and all that is said about them."""
    radii = np.unique(data.presses.radius_mm).size
    force = MODEL.predict(np.append(TRUTH, [TRUTH[-1]] * (radii - 1)), data)
    noise = np.random.default_rng(1).standard_normal((2, data.size))
    taken = data.with_force(force * (1 + 0.005 * noise[0, : data.count][data.press]) + 0.004 * noise[1])
    found = diagnose(taken, np.random.default_rng(0))
    assert found.verdict in ("ADEQUATE", "IDENTIFIED", "AMBIGUOUS", "UNKNOWN")
    return found, " ".join(found.material.after.warnings)


def test_one_press_is_analysed_and_its_want_is_said() -> None:
    found, said = analysed(presses(1))
    assert "there is one press" in said
    assert found.limits.not_testable["ageing"]


@pytest.mark.slow
def test_presses_without_repeats_are_analysed_and_their_want_is_said() -> None:
    assert "no press repeats another" in analysed(presses(2))[1]


def test_a_radius_pressed_to_one_depth_is_left_out_by_name() -> None:
    depths = [np.linspace(0.03, 0.6, 9)] * 6 + [np.array([0.4])] * 2
    kinds = [indenter("A", 2.5)] * 6 + [indenter("B", 1.5)] * 2
    found, said = analysed(observations(depths, kinds))
    assert "radius 1.5 mm are excluded" in said
    assert found.fits.base.data.count == 6
    with pytest.raises(InputError, match="one depth"):
        diagnose(
            observations([np.array([0.4])] * 3, [indenter()] * 3).with_force(np.ones(3)), np.random.default_rng(0)
        )


@pytest.mark.slow
def test_curves_of_one_sample_and_presses_that_overlap_in_time_are_taken_and_said() -> None:
    data = presses(12)
    single = data.samples(np.isin(np.arange(data.size) % 17, (3,)) | (data.press > 2))
    said = analysed(replace(single, time_s=single.time_s % 50))[1]
    assert "3 presses have one sample each (p0, p1, p2)" in said
    assert "begin before another ends" in said


def test_constant_force_is_refused() -> None:
    data = presses(4)
    with pytest.raises(InputError, match="force never changes"):
        diagnose(data.with_force(np.full(data.size, 0.5)), np.random.default_rng(0))


def test_an_effect_that_lacks_its_covariate_says_what_it_needs_and_the_rest_goes_on() -> None:
    found, _ = analysed(presses(8))
    assert "needs a temperature" in found.limits.not_testable["temperature"]
    assert "needs presses at several places" in found.limits.not_testable["thickness_wedge"]
    assert "depth_zero" in found.limits.visible
