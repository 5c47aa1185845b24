"""Few presses hardly tell how they scatter: what they show all the same, and from which size on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.diagnosis import score_test as page
from calibration.diagnosis.forward_selection import forward_selection
from calibration.diagnosis.score_test import ScoreTest, score_test
from calibration.diagnosis.sensitivity import Absorbed
from calibration.effects import EFFECTS
from calibration.fit.depth_noise import depth_over_force
from calibration.fit.least_squares import Fit, fit
from calibration.fit.repeats import refit_with_pure_noise
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model

TRUTH = np.array([0.2, 0.48, 0.85])
MODEL = Model(FlatPunch())
CATALOGUE = list(EFFECTS.values())
WARM = EFFECTS["temperature"]
PER_K = 0.015  # of E: 3.6 % from press to press (std), where their own gain is .5 %


def presses(count: int = 7) -> Observations:
    """Each at its own temperature."""
    depth = np.linspace(0.03, 0.6, 17)
    times = [300.0 * k + depth / (0.1, 1.0)[k % 2] for k in range(count)]
    data = observations([depth] * count, [indenter()] * count, time_s=times)
    warm = 22 + 2.5 * np.random.default_rng(1).standard_normal(count)
    return replace(data, temperature_C=warm[data.press])


def warmed(per_K: float, seed: int, count: int = 7) -> Fit:
    """The plain law's fit to gels that feel the temperature; 4 mN a sample, .5 % gain and 4 um zero a press."""
    data, rng = presses(count), np.random.default_rng(seed)
    force = (MODEL + WARM).predict(np.array([*TRUTH, per_K]), data)
    gain, zero = 0.005 * rng.standard_normal(data.count), 0.004 * rng.standard_normal(data.count)
    force = force * (1 + gain[data.press]) + MODEL.slope(TRUTH, data) * zero[data.press]
    noisy = data.with_force(force + 0.004 * rng.standard_normal(data.size))
    return refit_with_pure_noise(fit(MODEL, noisy))


def seen(fitted: Fit) -> ScoreTest:
    return score_test(fitted, CATALOGUE, rng=np.random.default_rng(0), draws=199)


def p_of(fitted: Fit) -> float:
    return {s.key: s.p_adjusted for s in seen(fitted).effects}["temperature"]


@pytest.mark.parametrize(("count", "by_score", "by_ratio"), [(7, 0.1, 0.03), (36, 1e-6, 1e-10)])
def test_what_passes_for_the_scatter_of_presses_is_weighed_against_it(
    monkeypatch: pytest.MonkeyPatch, count: int, by_score: float, by_ratio: float
) -> None:
    """Its score, under a gain that it has itself made several times too large, shows less than there is."""
    fitted = warmed(PER_K, 3, count)
    assert fitted.noise.gain > 0.02, "else it passes for nothing"
    assert p_of(fitted) < by_ratio
    monkeypatch.setattr(page, "LESS", (1.0,))
    monkeypatch.setattr(page, "MORE", ())
    assert p_of(fitted) > by_score


@pytest.mark.slow
def test_effects_are_told_apart_under_the_scatter_that_is_left_beside_the_best() -> None:
    """Under the scatter that the temperature passes for nothing takes six off chi^2."""
    found = forward_selection(warmed(PER_K, 3), CATALOGUE, rng=np.random.default_rng(0), level=0.05)
    assert [[c.effect.key for c in step.equals] for step in found.steps] == [["temperature"]]
    assert found.current.noise.gain < 0.01 < found.base.noise.gain


@pytest.mark.slow
def test_the_smallest_size_that_few_presses_show_is_seen_and_a_third_of_it_is_not() -> None:
    p: dict[float, list[float]] = {1 / 3: [], 1.0: []}
    for seed in range(10):
        size = seen(warmed(0.0, seed)).visible["temperature"]
        for share, found in p.items():
            found.append(p_of(warmed(share * size, seed)))
    assert np.sum(np.array(p[1.0]) < 0.05) >= 7
    assert np.sum(np.array(p[1 / 3]) < 0.05) <= 3


def test_few_presses_show_no_size_that_their_scatter_may_be_as_large_as(monkeypatch: pytest.MonkeyPatch) -> None:
    """3.6 std of what is known of the scatter would be too little: it is hardly known."""
    fitted = warmed(0.0, 1)
    of_few = seen(fitted).visible
    monkeypatch.setattr(page, "FEW_PRESSES", 0)
    of_many = seen(fitted).visible
    assert of_few["temperature"] > 1.5 * of_many["temperature"]
    assert of_few["depth_zero"] < 1.5 * of_many["depth_zero"], "it shows within each press"


def test_a_wedge_shows_from_the_size_of_one_slope_on() -> None:
    """Of two slopes at once each may be smaller."""
    depth = np.linspace(0.03, 0.6, 17)
    places = [(6.0, 1.0), (-6.0, 2.0), (5.0, -6.0), (-4.0, -1.0), (0.0, 5.0), (3.0, -3.0), (-2.0, 6.0), (6.0, 6.0)]
    data = observations([depth] * 16, [indenter()] * 16, place_mm=places * 2)
    noisy = data.with_force(
        MODEL.predict(TRUTH, data) + 0.004 * np.random.default_rng(0).standard_normal(data.size)
    )
    fitted, wedge = refit_with_pure_noise(fit(MODEL, noisy)), EFFECTS["thickness_wedge"]
    visible = score_test(fitted, [wedge], rng=np.random.default_rng(0), draws=49).visible["thickness_wedge"]
    change = (MODEL + wedge).predict(np.array([*fitted.values, visible, 0.0]), data) - fitted.force_N
    absorbed = Absorbed(fitted, fitted.free)
    rest = absorbed.white(change)
    rest -= absorbed.rows[: data.size] @ np.linalg.lstsq(absorbed.rows[: data.size], rest)[0]
    assert np.linalg.norm(rest) == pytest.approx(3.6, rel=0.1)


def test_a_force_noise_is_told_from_the_air_that_presses_begin_in() -> None:
    """A depth's share, 1 mm/N here, came out at 8.2 from the slopes of two punches alone (seed 7)."""
    depth = np.concatenate([[-0.02], np.linspace(0.05, 0.6, 24)])
    punches = [indenter(name, radius) for name, radius in (("small", 1.5), ("large", 3.0)) for _ in range(3)]
    data, found = observations([depth] * 6, punches), []
    force = MODEL.predict(np.array([0.2, 0.48, 0.85, 0.85]), data)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        noisy = data.with_force(force + 0.004 * rng.standard_normal(data.size))
        noisy = replace(noisy, depth_mm=data.depth_mm + 0.004 * rng.standard_normal(data.size))
        found.append(depth_over_force(refit_with_pure_noise(fit(MODEL, noisy))))
    assert 0.5 < min(found) < max(found) < 2.5
