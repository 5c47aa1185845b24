"""The tabulated profile against finite elements of others, at its own limits, and in the fit it was made for."""

from __future__ import annotations

import numpy as np
import pytest
from each import each
from made_surfaces import THICKNESS_MM, views

from tactilevision.mechanics.poisson_from_surface import fit_poisson_ratio
from tactilevision.mechanics.profile import (
    LINEAR,
    PunchCase,
    exact_profile,
    friction_of_share,
    seen_profile,
)
from tactilevision.mechanics.tables.punch import TABULATED, profile_model

table_profile = TABULATED.source
RADII = np.array([4.0, 5.0, 6.0, 8.0, 10.0]) / 2.5

# Rise over depth at w = .4, a = 2.5, h = 3, R = 15 mm, edge .05 mm, mu = .3, material radius 4, 5, 6, 8, 10 mm:
# neo-Hooke by NGSolve (P2/P1, real contact), two digits
NGSOLVE = {
    0.45: (0.048, 0.071, 0.052, 0.020, 0.008),
    0.47: (0.077, 0.090, 0.063, 0.024, 0.011),
    0.48: (0.094, 0.101, 0.070, 0.027, 0.012),
    0.49: (0.114, 0.114, 0.078, 0.031, 0.014),
    0.497: (0.129, 0.123, 0.084, 0.033, 0.015),
}


@each("nu", NGSOLVE)
def test_table_agrees_with_another_solver(nu: float) -> None:
    rise, _ = table_profile(RADII, PunchCase(nu, 2.5 / 3, 0.4 / 3, 0.3))
    np.testing.assert_allclose(rise, NGSOLVE[nu], atol=0.0035)  # ours is 2 % higher throughout


def test_camera_sees_the_profile_of_another_solver() -> None:
    rise = seen_profile(RADII, PunchCase(0.48, 2.5 / 3, 0.4 / 3, 0.3), source=table_profile)
    np.testing.assert_allclose(rise, (0.088, 0.102, 0.072, 0.028, 0.012), atol=0.0035)


def test_correction_to_linear_theory_is_small_where_it_should_be() -> None:
    # without friction and at no depth only the edge radius and the pad's radius are left: some 3 % of the rise
    for nu in (0.42, 0.47, 0.49):
        found, linear = table_profile(RADII, PunchCase(nu, 2.5 / 3)), exact_profile(RADII, nu, a_over_h=2.5 / 3)
        np.testing.assert_allclose(found[0], linear[0], atol=0.007)
        np.testing.assert_allclose(found[1], linear[1], atol=0.012)


def test_friction_saturates() -> None:
    assert friction_of_share(0.0) == 0
    assert friction_of_share(1.0) == friction_of_share(2.0) == pytest.approx(0.3)
    for share in (0.0, 0.3, 0.9, 1.0):
        part = friction_of_share(share) / 0.3
        assert part * (1.4 - 0.4 * part) == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize("friction", [0.0, pytest.param(0.3, marks=pytest.mark.slow)])
def test_poisson_ratio_is_found_with_friction_unknown(friction: float) -> None:
    nu, rng = 0.477, np.random.default_rng(11)
    made = views(nu, rng, source=table_profile, friction=friction)
    fit = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, thickness_std_mm=0.03, model=TABULATED)
    assert fit.poisson_ratio.value == pytest.approx(nu, abs=0.004)
    low, high = fit.poisson_ratio.interval95 or (1, 0)
    assert low < nu < high
    linear = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, thickness_std_mm=0.03, model=LINEAR)
    low, high = linear.poisson_ratio.interval95 or (1, 0)
    assert low < nu < high  # linear theory is off, and says so


def test_presses_out_of_range_are_left_out_and_named() -> None:
    made = views(
        0.477,
        np.random.default_rng(12),
        depths_mm=(0.3, 0.9),
        source=lambda r, case: exact_profile(r, 0.477, a_over_h=2.5 / 3),
    )
    fit = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, model=TABULATED)
    assert fit.left_out == ("1",)


def test_model_is_chosen_by_what_the_table_holds() -> None:
    soft = views(0.28, np.random.default_rng(13), depths_mm=(0.3, 0.4), noise_mm=5e-4)
    assert fit_poisson_ratio(soft, thickness_mm=THICKNESS_MM).model == LINEAR.name  # nu below the table
    assert fit_poisson_ratio(soft, thickness_mm=15.0).model == LINEAR.name  # a/h below the table
    usual = views(0.48, np.random.default_rng(14), depths_mm=(0.3, 0.4), source=table_profile, friction=0.3)
    assert fit_poisson_ratio(usual, thickness_mm=THICKNESS_MM).model == TABULATED.name


@pytest.mark.parametrize(("nu", "alpha", "deepest"), [(0.2, 0.8, 0.1), (0.48, 0.1, 0.1), (0.48, 0.8, 0.3)])
def test_linear_theory_stands_in_beyond_the_table(nu: float, alpha: float, deepest: float) -> None:
    assert profile_model(nu, alpha, deepest=deepest) is LINEAR
    assert profile_model(0.48, 0.8, deepest=0.1) is TABULATED


def test_beyond_the_solved_depths_the_surface_goes_on_smoothly() -> None:
    rises = [table_profile(RADII, PunchCase(0.487, 1.0, depth, 0.3))[0] for depth in (0.1, 0.15, 0.2, 0.25)]
    steps = np.diff(rises, axis=0)
    np.testing.assert_allclose(steps[2], steps[0], atol=0.004)
