"""How much stiffer a sticking punch is: its two limits, and a system of equations that rounding does not move."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

import calibration.laws.theory as theory
from calibration.laws.theory import exact_surplus, sticking_surplus


def half_space(nu: float) -> float:
    """Spence's surplus on a half-space."""
    return float((1 - nu) * np.log(3 - 4 * nu) / (1 - 2 * nu)) - 1


@pytest.mark.parametrize("nu", [0.3, 0.4, 0.45])
def test_on_a_deep_layer_it_is_spences(nu: float) -> None:
    assert exact_surplus(nu, 0.02) == pytest.approx(half_space(nu), abs=7e-4)


@pytest.mark.parametrize(
    ("nu", "low", "high"), [(0.45, 0.010, 0.016), (0.4797, 0.025, 0.033), (0.495, 0.040, 0.048)]
)
def test_on_a_layer_it_is_that_of_finite_elements(nu: float, low: float, high: float) -> None:
    assert low < sticking_surplus(nu, 2.5 / 3) < high


@each("a_over_h", [0.4, 0.83, 1.3, 3.0])
def test_neither_the_number_of_shapes_nor_rounding_decides(
    a_over_h: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Powers of 1 - r^2 as shapes left 2 % of the stiffness at nu = .48, a/h = 1.3 to the processor's rounding."""
    few = [exact_surplus(nu, a_over_h) for nu in (0.45, 0.48, 0.4999)]
    monkeypatch.setattr(theory, "SHAPES", 18)
    theory._transforms.cache_clear()
    many = [exact_surplus(nu, a_over_h) for nu in (0.45, 0.48, 0.4999)]
    theory._transforms.cache_clear()
    np.testing.assert_allclose(few, many, atol=2e-4)
