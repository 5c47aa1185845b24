"""The error model and the screen on made-up presses with known errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from each import each
from made_presses import indenter, observations

from calibration.diagnosis import score_test as score_test_page
from calibration.diagnosis.covariates import covariate_steps, form_errors
from calibration.diagnosis.refit import adopt, refit_with
from calibration.diagnosis.score_statistics import Cast, Tail
from calibration.diagnosis.score_test import score_test
from calibration.effects import EFFECTS
from calibration.effects.depth_zero import DepthZero
from calibration.fit.least_squares import Fit, fit
from calibration.fit.repeats import beyond_stated, refit_with_pure_noise, renewed_noise, repeat_noise
from calibration.inputs.deadline import in_turn
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.noise.model import Linear, Noise, Whitener
from calibration.noise.reml import Weighing
from tactilevision.records.measured import Floats

TRUTH = np.array([0.2, 0.48, 0.85])
MODEL = Model(FlatPunch())


def presses(count: int = 24) -> Observations:
    depth = np.linspace(0.03, 0.6, 17)
    rates = [(0.1, 1.0)[k % 2] for k in range(count)]
    times = [300.0 * k + depth / rate for k, rate in enumerate(rates)]
    return observations([depth] * count, [indenter()] * count, time_s=times)


def measured(data: Observations, force_N: Floats, rng: np.random.Generator) -> Observations:
    """4 mN a sample, .5 % gain and 4 um zero a press."""
    gain, zero = 0.005 * rng.standard_normal(data.count), 0.004 * rng.standard_normal(data.count)
    slope = MODEL.slope(TRUTH, data)
    noise = 0.004 * rng.standard_normal(data.size)
    return data.with_force(force_N * (1 + gain[data.press]) + slope * zero[data.press] + noise)


def pure(data: Observations) -> Fit:
    return refit_with_pure_noise(fit(MODEL, data))


def test_the_error_model_is_read_from_repeats() -> None:
    data = presses(60)
    found = pure(measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(0))).noise
    assert found.scale == pytest.approx(0.004, rel=0.1)
    assert found.gain == pytest.approx(0.005, rel=0.35)
    assert found.zero_mm == pytest.approx(0.004, rel=0.35)
    assert found.correlation == 0.0


def test_correlated_noise_is_recognised() -> None:
    data, rng = presses(30), np.random.default_rng(1)
    noise = np.zeros((30, 17))
    for k in range(17):
        noise[:, k] = 0.6 * (noise[:, k - 1] if k else 0) + 0.004 * rng.standard_normal(30)
    force = MODEL.predict(TRUTH, data) + noise.ravel()
    assert repeat_noise(fit(MODEL, data.with_force(force))).correlation == pytest.approx(0.6, abs=0.21)


def test_white_noise_beside_correlated_noise_is_told_apart() -> None:
    """Depths read with white noise beside forces that drift: a mere neighbours' correlation forgets too soon."""
    data, rng = presses(120), np.random.default_rng(12)
    slow = np.zeros((120, 17))
    slow[:, 0] = rng.standard_normal(120)
    for k in range(1, 17):
        slow[:, k] = 0.7 * slow[:, k - 1] + np.sqrt(1 - 0.7**2) * rng.standard_normal(120)
    force = MODEL.predict(TRUTH, data) + 0.004 * (slow.ravel() + rng.standard_normal(data.size))
    found = repeat_noise(fit(MODEL, data.with_force(force)))
    assert found.correlation >= 0.6
    assert found.white >= 0.4


def test_what_the_law_lacks_does_not_count_as_noise() -> None:
    data = presses()
    force = (MODEL + EFFECTS["stiffening"]).predict(np.array([0.2, 0.48, 0.85, 8.0]), data)
    wrong = fit(MODEL, measured(data, force, np.random.default_rng(2)))
    assert wrong.noise.scale > 0.005
    assert repeat_noise(wrong).scale == pytest.approx(0.004, rel=0.15)


def test_with_few_presses_the_press_errors_stay_near_what_is_usual() -> None:
    data = presses(2)
    found = pure(measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(3))).noise
    assert 0.0015 < found.gain < 0.015
    assert 0.001 < found.zero_mm < 0.012


@pytest.mark.parametrize("white", [0.0, 0.4])
def test_whitening_and_colouring_are_inverse_and_match_the_covariance(white: float) -> None:
    data = presses(3)
    about = Linear(MODEL.predict(TRUTH, data), MODEL.slope(TRUTH, data), np.full(data.size, 1.0))
    noise = Noise(0.004, 0.005, 0.004, 0.5, white, stated=False)
    whitener = Whitener(data, noise, about)
    numbers = np.random.default_rng(0).standard_normal((data.size, 3))
    np.testing.assert_allclose(whitener.apply(whitener.colour(numbers)), numbers, atol=1e-9)
    root = whitener.colour(np.eye(data.size))
    one = slice(0, 17)
    lag = np.abs(np.subtract.outer(np.arange(17), np.arange(17)))
    f, d = about.force_N[one], about.slope_N_per_mm[one]
    manual_checks = (
        0.004**2 * ((1 - white) * 0.5**lag + white * (lag == 0))
        + 0.005**2 * np.outer(f, f)
        + 0.004**2 * np.outer(d, d)
    )
    np.testing.assert_allclose((root @ root.T)[one, one], manual_checks, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose((root @ root.T)[17:34, one], 0, atol=1e-12)
    weighing = Weighing(data, about, noise)
    assert weighing.log_volume(noise) == pytest.approx(np.linalg.slogdet(root @ root.T)[1], rel=1e-9)


def test_one_newton_step_follows_the_noise_of_a_draw() -> None:
    data = presses(60)
    fitted = pure(measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(4)))
    whitener = Whitener(data, fitted.noise, fitted.about)
    errors = whitener.colour(np.random.default_rng(5).standard_normal((data.size, 40)))
    scales = np.array([n.scale for n in renewed_noise(fitted, errors)])
    assert np.median(scales) == pytest.approx(fitted.noise.scale, rel=0.02)
    assert 0.01 < np.std(scales) / fitted.noise.scale < 0.06


def test_a_planted_zero_is_named_and_clean_data_are_not_accused() -> None:
    data = presses()
    clean = MODEL.predict(TRUTH, data)
    effects = [EFFECTS[key] for key in ("depth_zero", "viscoelasticity", "recovery", "ageing", "clock_offset")]
    quiet = 0
    for seed in range(6):
        found = score_test(
            pure(measured(data, clean, np.random.default_rng(seed))),
            effects,
            rng=np.random.default_rng(0),
            draws=99,
        )
        quiet += min(s.p_adjusted for s in found.effects) > 0.05
    assert quiet >= 4
    shifted = MODEL.predict(TRUTH, data.shifted(0.012))
    found = score_test(
        pure(measured(data, shifted, np.random.default_rng(9))), effects, rng=np.random.default_rng(0), draws=99
    )
    assert found.effects[0].key == "depth_zero"
    assert found.effects[0].p_adjusted < 1e-3


@each("zero_mm, drawn", [(0.0, 99), (0.004, 799), (0.005, 799), (0.03, 399)])
def test_draws_go_on_where_p_lies_near_a_level(
    monkeypatch: pytest.MonkeyPatch, zero_mm: float, drawn: int
) -> None:
    """Nothing there; a zero near what is seen; one whose p is 3e-5; a large one: 99, 799, 799, 399 draws."""
    monkeypatch.setattr("calibration.diagnosis.score_test.MANY_DRAWS", 799)
    sizes, family = [], score_test_page._family

    def counted(keys: Sequence[str], table: Floats, *rest: Any) -> Any:
        sizes.append(len(table) - 1)
        return family(keys, table, *rest)

    monkeypatch.setattr(score_test_page, "_family", counted)
    data = presses()
    force = MODEL.predict(TRUTH, data.shifted(zero_mm))
    fitted = pure(measured(data, force, np.random.default_rng(1)))
    score_test(fitted, [DepthZero()], rng=np.random.default_rng(0))
    assert sizes[-1] == drawn


def looks(data: Observations, seed: int = 1) -> score_test_page._Looks:
    fitted = pure(measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(seed)))
    cast = Cast(fitted, list(covariate_steps(fitted).values()), form_errors(fitted))
    return score_test_page._Looks(cast, fitted, searched=0, of_rig=False)


def test_draws_are_made_in_portions(monkeypatch: pytest.MonkeyPatch) -> None:
    """1,600 draws of 14,400 samples at once took 600 MB: at most 300 are made at once, of many samples fewer."""
    asked, null = [], Cast.null

    def counted(self: Cast, rng: np.random.Generator, draws: int) -> tuple[Floats, Floats]:
        asked.append(draws)
        return null(self, rng, draws)

    monkeypatch.setattr(Cast, "null", counted)
    screen = looks(presses())
    assert sum(len(one[0]) for one in screen.drawn(np.random.default_rng(0), 900, in_turn)) == 900
    monkeypatch.setattr(score_test_page, "PORTION_VALUES", 100.5 * presses().size)
    screen.drawn(np.random.default_rng(0), 250, in_turn)
    assert asked == [300, 300, 300, 100, 100, 50]


def test_more_draws_say_what_scatter_is_usual_for_the_residual_too() -> None:
    """Draws that come later, of a lower scatter, move what is usual for all rows, the residual's with them."""
    depth = np.concatenate([np.linspace(0.03, 0.6, 9), np.linspace(0.57, 0.03, 8)])
    times = [300.0 * k + np.arange(17.0) for k in range(12)]
    phase = [["load"] * 9 + ["unload"] * 8] * 12
    screen = looks(observations([depth] * 12, [indenter()] * 12, time_s=times, phase=phase))
    assert score_test_page.SCATTER in screen.names
    first, second = (screen.drawn(np.random.default_rng(seed), 50, in_turn) for seed in (0, 1))
    at = len(covariate_steps(screen._fitted))
    lower = [(scores, scatter - 5, rest) for scores, scatter, rest in second]
    once, whole = (screen.table([screen.own(), *first, *more])[:, at] for more in ([], lower))
    assert (whole[:51] >= once).all()
    assert whole[0] > once[0]


@pytest.mark.parametrize("dof", [1, 3])
def test_p_values_far_beyond_the_draws_are_not_understated(dof: int) -> None:
    """An exponential through the largest tenth alone gives a quarter of the truth and less at twice that depth."""
    from scipy.stats import chi2

    far = float(chi2.isf(1e-6, dof))
    draws = [np.random.default_rng(seed).chisquare(dof, 399) for seed in range(20)]
    typical = float(np.exp(np.mean([np.log(Tail(one)(far)) for one in draws])))
    assert 0.5e-6 < typical < 5e-6
    tail = Tail(draws[0])
    p = [tail(x) for x in np.linspace(0, far, 200)]
    assert (np.diff(p) <= 0).all()


def test_a_draw_is_judged_by_the_others_as_a_measurement_is() -> None:
    """By all draws, itself among them, the farthest would look less far out: the test would reject too much."""
    draws = np.random.default_rng(2).chisquare(1, 199)
    far = np.argsort(draws)[-5:]
    each = Tail(draws).of_each()[far]
    others = [Tail(np.delete(draws, k))(draws[k]) for k in far]
    np.testing.assert_allclose(each, others, rtol=0.1)
    assert (each < [Tail(draws)(draws[k]) for k in far]).all()


def test_one_wild_draw_hides_nothing_that_all_others_lie_below() -> None:
    """A draw at 1,500 among 1,999 had made p of 30 more than .05, by a tail that followed it."""
    draws = np.append(np.random.default_rng(2).chisquare(1, 1998), 1500.0)
    assert Tail(draws)(30.0) == pytest.approx(2 / 2000)
    assert Tail(draws)(2000.0) <= 1 / 2000
    others = np.delete(draws, np.argmax(draws[:-1]))
    assert Tail(draws).of_each()[np.argmax(draws[:-1])] == pytest.approx(Tail(others)(np.max(draws[:-1])), rel=0.1)


def test_a_draw_beyond_what_a_number_can_say_leaves_p_a_number() -> None:
    """One draw so far out that its p is 0 had made the family's tail infinite, and every p with it NaN."""
    draws = np.append(np.random.default_rng(2).chisquare(1, 398), 1e4)
    family = Tail(-np.log(Tail(draws).of_each()))
    assert 0 < family(600.0) < family(20.0) < 1


def test_the_smallest_visible_amplitude_is_indeed_seen() -> None:
    data = presses()
    fitted = pure(measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(6)))
    visible = score_test(fitted, [DepthZero()], rng=np.random.default_rng(0), draws=49).visible["depth_zero"]
    again = fit(MODEL + DepthZero(), data.with_force(fitted.force_N), noise=fitted.noise, tolerances=False)
    assert visible == pytest.approx(3.6 * again.std("depth_zero.offset_mm"), rel=0.1)


@pytest.mark.parametrize(("stated_N", "said"), [(0.004, None), (0.0037, None), (0.002, 2.0)])
def test_a_noise_that_was_stated_too_small_is_told_from_one_that_was_not(
    stated_N: float, said: float | None
) -> None:
    data = presses()
    noisy = replace(
        measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(3)),
        force_std_N=np.full(data.size, stated_N),
        depth_std_mm=np.zeros(data.size),
    )
    found = beyond_stated(pure(noisy))
    assert found is None if said is None else found == pytest.approx(said, rel=0.06)


def test_what_another_form_of_an_effect_leaves_is_no_second_effect() -> None:
    """A stiffening 15 % stronger in fast presses is no effect of the rate; a law 5 % stronger there is one."""
    data, effect = presses(), EFFECTS["stiffening"]
    law, both = MODEL.predict(TRUTH, data), (MODEL + effect).predict(np.array([*TRUTH, 8.0]), data)
    speed = data.presses.speed_mm_s[data.press]
    fast = (speed > 2 * speed.min()).astype(float)
    for force, p in (
        (law + (both - law) * (1 + 0.15 * fast), (0.05, 1.0)),
        (both * (1 + 0.05 * fast), (0.0, 0.01)),
    ):
        base = pure(measured(data, force, np.random.default_rng(4)))
        fitted = adopt(base, refit_with(base, effect))
        looked = {c.key: c.p_adjusted for c in score_test(fitted, (), rng=np.random.default_rng(0)).covariates}
        assert p[0] <= looked["log rate"] <= p[1]


def test_a_form_follows_the_date_only_where_the_effect_does() -> None:
    """Ageing has six steps of the date, and of the order, beside all that a stiffening may follow.

    The steps of each sum up to the same, which counts once.
    """
    data, steps = presses(), dict[str, int]()
    data = replace(data, presses=replace(data.presses, day=np.linspace(0, 40, data.count)))
    base = pure(data.with_force(MODEL.predict(TRUTH, data)))
    for key in ("stiffening", "ageing"):
        model, values = MODEL + EFFECTS[key], np.array([*base.values, *EFFECTS[key].starts(data)[0]])
        with_it = replace(base, model=model, values=values, force_N=model.predict(values, data))
        steps[key] = form_errors(with_it).shape[1]
    assert steps["ageing"] == steps["stiffening"] + 2 * 5
