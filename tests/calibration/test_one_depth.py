"""Presses of one depth tell a secant: c and E with what theory leaves of the curvature, and a flag."""

from __future__ import annotations

import numpy as np
import pytest
from each import each
from made_recordings import points_of

from calibration.report.report import summary
from calibration.tasks.calibrate import calibrate
from tactilevision.errors import InputError
from tactilevision.records.rig import Gel


@each("beta", [0.15, 0.6, 0.87, 1.1])
def test_one_depth_leaves_the_curvature_to_theory_and_says_so(beta: float) -> None:
    depth, noise = np.full(5, 0.3), 0.003 * np.array([0.4, -1.2, 0.9, 0.3, -0.6])
    gel = Gel(3.0, shape="disc", radius_mm=15.0, poisson_ratio=0.48, poisson_ratio_std=0.002)
    measured = points_of(depth, 3.5 * depth * (1 + beta * depth / 3) + noise, gel=gel)
    result = calibrate(measured)
    low, high = result.c.interval95 or (0, 0)
    assert low < 3.5 < high
    assert 0.03 < (high - low) / 3.5 < 0.2, "as wide as theory's curvature leaves it"
    assert result.youngs_modulus.value is not None
    assert result.beta.value is None
    assert result.beta.why
    assert result.beta.interval95 == pytest.approx((0.1, 1.23), abs=0.05)
    assert "one_depth" in result.flags
    with pytest.raises(InputError, match="one depth"):
        calibrate(measured, law="paper")


def test_depths_apart_by_their_scatter_are_one_depth() -> None:
    aside = 0.003 * np.array([0.6, -0.9, -1.4, -2.1, 0.3, 0.1])
    gel = Gel(3.0, shape="disc", radius_mm=15.0, poisson_ratio=0.48, poisson_ratio_std=0.002)
    falling = 3.5 * 0.3 * 1.085 - 0.1 * aside  # by chance
    result = calibrate(points_of(0.3 + aside, falling, gel=gel))
    assert "one_depth" in result.flags
    low, high = result.c.interval95 or (0, 0)
    assert low < 3.5 < high
    few = calibrate(points_of(np.array([0.146, 0.152, 0.158]), np.array([0.58, 0.57, 0.56]), gel=gel))
    assert "one_depth" in few.flags


@each("beta", [0.15, 0.6, 1.1])
@each("depth", [0.15, 0.6])
def test_one_point_tells_what_its_secant_allows_and_says_so(depth: float, beta: float) -> None:
    gel = Gel(3.0, shape="disc", radius_mm=15.0, poisson_ratio=0.48, poisson_ratio_std=0.002)
    force = 3.5 * depth * (1 + beta * depth / 3)
    result = calibrate(points_of(np.array([depth]), np.array([force]), gel=gel))
    low, high = result.c.interval95 or (0, 0)
    assert low < 3.5 < high
    assert 0.05 < (high - low) / 3.5 < 0.4
    assert "one_depth" in result.flags
    assert any("there is one press" in warning for warning in result.warnings)
    low, high = result.youngs_modulus.interval95 or (0, 0)
    sliding = result.youngs_modulus.value or 0
    assert low < sliding * 3.5 / (result.c.value or 1) < high
    assert result.beta.value is None
    assert not any("nan" in line for line in summary(result))


def test_one_point_with_nothing_said_of_nu_leaves_e_open() -> None:
    result = calibrate(points_of(np.array([0.4]), np.array([1.6])))
    assert result.c.value is not None
    assert result.youngs_modulus.value is None
    assert result.youngs_modulus.interval95 is not None
