"""Robust statistics against drawn normal numbers, with and without wild ones among them."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.robust import (
    TUKEY_WIDTH,
    mad_std,
    median,
    second_difference_std,
    tukey_weight,
)


@each("count", [1, 2, 7, 10])
def test_the_quick_median_is_numpys(count: int) -> None:
    values = np.random.default_rng(count).standard_normal((3, count))
    np.testing.assert_array_equal(median(values), np.median(values, axis=-1))


@pytest.mark.parametrize("seed", range(3))
def test_the_deviation_of_normal_numbers_comes_back_though_some_are_wild(seed: int) -> None:
    values = 3.0 + 0.2 * np.random.default_rng(seed).standard_normal(20000)
    assert mad_std(values) == pytest.approx(0.2, rel=0.03)
    assert mad_std(values, centre=3.0) == pytest.approx(0.2, rel=0.03)
    assert mad_std(np.concatenate([values, np.full(1000, 1e6)])) == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_noise_on_a_ramp_with_corners_is_that_of_one_reading(seed: int) -> None:
    ramp = np.abs(np.linspace(-5.0, 5.0, 20001))
    noise = 0.05 * np.random.default_rng(seed).standard_normal(ramp.size)
    assert second_difference_std(ramp + noise) == pytest.approx(0.05, rel=0.04)


def test_tukeys_weight_falls_to_nothing() -> None:
    assert tukey_weight(np.array([0.0, TUKEY_WIDTH]), 1.0).tolist() == [1.0, 0.0]
