"""What is left over and harmless keeps the verdict; what matters is UNKNOWN. One level for all."""

from __future__ import annotations

import numpy as np
import pytest
from test_effects import BASE, RICH
from test_screen import MODEL, TRUTH, measured, presses, pure

from calibration.diagnosis.score_statistics import draw_errors
from calibration.diagnosis.score_test import Scored, ScoreTest, score_test
from calibration.diagnosis.unexplained import MATTERS, remainder
from calibration.fit.depth_noise import depth_over_force, with_sample_noise
from calibration.fit.least_squares import Fit
from calibration.inputs.observations import Observations

FOUND = ScoreTest((), (Scored("w", 99.0, 0.0, 0.0),), {}, {})


def with_wave(size_mm: float, data: Observations, seed: int = 0) -> Fit:
    depth = data.shifted(size_mm * np.sin(2 * np.pi * data.depth_mm / 0.15))
    return pure(measured(data, MODEL.predict(TRUTH, depth), np.random.default_rng(seed)))


@pytest.mark.parametrize(("size_mm", "matters"), [(0.0005, False), (0.02, True)])
def test_a_remainder_matters_where_a_reading_leaves_its_interval(size_mm: float, matters: bool) -> None:
    found = remainder(with_wave(size_mm, presses(24)), FOUND, level=0.05)
    assert found is not None
    assert found.matters is matters
    assert (found.over_std_of_a_reading > MATTERS) is matters
    if matters:
        assert found.rms_mm == pytest.approx(size_mm / np.sqrt(2), rel=0.4)
    assert f"{1e3 * found.rms_mm:.2g} µm" in found.sentence
    assert found.as_json()["matters"] is matters


def test_nothing_beyond_chance_leaves_nothing_over() -> None:
    clean = ScoreTest((), (Scored("w", 1.0, 0.3, 0.9),), {}, {})
    assert remainder(with_wave(0.0, presses(8)), clean, level=0.05) is None


def test_the_least_p_of_all_is_the_familys() -> None:
    family = ScoreTest(
        (Scored("tilt", 9.0, 0.01, 0.2),), (Scored("w", 9.0, 0.1, 0.6),), {}, {}, (Scored("x", 9.0, 0.001, 0.04),)
    )
    assert family.lack_of_fit == 0.04
    assert family.family_p == 0.04


def test_a_press_of_its_own_is_in_the_one_test() -> None:
    data = presses(20)
    force = MODEL.predict(TRUTH, data.shifted(np.where(data.press == 5, 0.05, 0.0)))
    found = score_test(
        pure(measured(data, force, np.random.default_rng(1))),
        (),
        rng=np.random.default_rng(0),
        draws=99,
        of_rig=True,
    )
    told = {one.key: one.p_adjusted for one in found.others}
    assert told["a press of its own"] < 0.01
    assert found.family_p < 0.01


def test_draws_have_the_error_models_size_and_the_tails_of_the_data() -> None:
    data = presses(30)
    rng = np.random.default_rng(3)
    normal = pure(measured(data, MODEL.predict(TRUTH, data), rng))
    heavy = pure(data.with_force(MODEL.predict(TRUTH, data) + 0.004 * rng.standard_t(3, data.size)))
    drawn = [draw_errors(one, np.random.default_rng(0), 60) for one in (normal, heavy)]
    expected = np.sqrt(
        (normal.noise.gain * normal.about.force_N) ** 2
        + (normal.noise.zero_mm * normal.about.slope_N_per_mm) ** 2
        + normal.noise.scale**2
    )
    assert drawn[0].std() == pytest.approx(np.sqrt(np.mean(expected**2)), rel=0.1)
    kurtosis = [np.mean((d / d.std()) ** 4) for d in drawn]
    assert kurtosis[1] > kurtosis[0] + 1


def test_a_depths_noise_shows_in_stiff_presses_and_is_given_its_share() -> None:
    rng = np.random.default_rng(4)
    clean, slope = MODEL.predict(BASE, RICH), MODEL.slope(BASE, RICH)
    noisy = clean + 0.002 * rng.standard_normal(RICH.size) + 0.004 * slope * rng.standard_normal(RICH.size)
    assert depth_over_force(pure(RICH.with_force(noisy))) == pytest.approx(2.0, rel=0.5)
    white = pure(RICH.with_force(clean + 0.004 * rng.standard_normal(RICH.size)))
    assert with_sample_noise(white).depth_over_force_noise == 0.0
