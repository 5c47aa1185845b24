"""The surface beside the punch: balances, the half-space, an independent transform, and the camera."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics.layer import layer_compliance
from tactilevision.mechanics.profile import (
    PunchCase,
    exact_profile,
    linear_profile,
    seen_profile,
)
from tactilevision.mechanics.punch_equation import solve_punch
from tactilevision.records.measured import Floats


@each("alpha", [0.2, 2.5 / 3, 3.0])
@each("nu", [0.0, 0.3, 0.48, 0.5])
def test_displaced_volume_is_that_of_the_compressed_layer(nu: float, alpha: float) -> None:
    # Int u_z dA = P h/M: the wave of length infinity; an incompressible gel rises by what the punch displaces
    t, weights = np.polynomial.legendre.leggauss(200)
    s, weights = (t + 1) / 2 * np.sqrt(20), weights / 2 * np.sqrt(20)
    r = 1 + s**2 / alpha
    rise, _ = exact_profile(r, nu, a_over_h=alpha)
    volume = np.pi - 2 * np.pi * np.sum(weights * rise * r * 2 * s / alpha)
    one_over_M = (1 + nu) * (1 - 2 * nu) / (1 - nu)
    assert volume == pytest.approx(2 * solve_punch(nu, alpha).kappa / (1 - nu**2) / alpha * one_over_M, abs=2e-5)


def test_shallow_punch_tends_to_the_half_space() -> None:
    r, nu = np.array([1.0, 1.3, 2.0, 4.0]), 0.3
    half_space = -2 / np.pi * np.arcsin(1 / r)
    outward = -(1 - 2 * nu) / (np.pi * (1 - nu)) / r
    first, second = (np.array(exact_profile(r, nu, a_over_h=alpha)) for alpha in (0.1, 0.05))
    np.testing.assert_allclose(2 * second - first, [half_space, outward], atol=0.005)
    assert second[0][0] == pytest.approx(-1, abs=1e-9)  # the gel meets the punch's edge at every a/h


@pytest.mark.parametrize(("nu", "alpha"), [(0.2, 2.5 / 3), (0.48, 2.5 / 3), (0.5, 2.0)])
def test_profile_is_the_transform_of_pressure_and_compliance(nu: float, alpha: float) -> None:
    # u = Int C(xi) p(xi) J(xi r) xi d xi, cut off at 300/a and averaged over the cut, as it oscillates
    from scipy.special import j0, j1

    punch = solve_punch(nu, alpha, nodes=256)
    r = np.array([1.4, 2.0, 3.0])
    xi = np.linspace(0.0025, 299.9975, 60_000)
    part = layer_compliance(xi / alpha, nu)
    density = 2 / np.pi * punch.transform(xi) * xi / alpha / (1 - nu)
    rise = [-_averaged(np.asarray(density * part.normal * j0(xi * place)), xi) for place in r]
    outward = [-_averaged(np.asarray(density * part.coupling * j1(xi * place)), xi) for place in r]
    np.testing.assert_allclose(exact_profile(r, nu, a_over_h=alpha), [rise, outward], atol=3e-5)


def _averaged(density: Floats, xi: Floats) -> float:
    running = np.cumsum(density) * (xi[1] - xi[0])
    late = xi > 150
    window = np.hanning(int(late.sum()))
    return float(running[late] @ window / window.sum())


def test_rise_of_the_literature() -> None:
    rise = {nu: float(exact_profile(2.0, nu, a_over_h=2.5 / 3)[0]) for nu in (0.475, 0.48, 0.485)}
    assert rise[0.48] == pytest.approx(0.097, abs=5e-4)
    assert rise[0.485] - rise[0.475] == pytest.approx(0.011, abs=1e-3)


def test_spline_holds_its_stated_error() -> None:
    s = np.random.default_rng(5).uniform(0, np.sqrt(20), 200)
    for nu, alpha, error in [(0.3, 0.2, 3e-6), (0.48, 2.5 / 3, 3e-6), (0.5, 10.0, 3e-6), (0.4, 0.05, 1e-4)]:
        r = 1 + s**2 / alpha
        fast, exact = linear_profile(r, PunchCase(nu, alpha)), exact_profile(r, nu, a_over_h=alpha)
        assert max(np.abs(f - e).max() for f, e in zip(fast, exact, strict=True)) < error
        far = np.array([1 + 20.5 / alpha])
        assert np.abs(exact_profile(far, nu, a_over_h=alpha)).max() < 3e-6
        assert linear_profile(far, PunchCase(nu, alpha))[0] == 0


def test_camera_sees_the_surface_where_it_went() -> None:
    r = np.linspace(2.6, 12, 40)
    for depth in (0.05, 0.4):
        rise, outward = exact_profile(r / 2.5, 0.48, a_over_h=2.5 / 3)
        seen = seen_profile((r + depth * outward) / 2.5, PunchCase(0.48, 2.5 / 3, depth / 3))
        np.testing.assert_allclose(seen, rise, atol=2e-5)


def test_face_is_at_its_depth_and_the_gel_is_continuous() -> None:
    r = np.array([0.0, 0.4, 1.0, 1.0 + 1e-9])
    np.testing.assert_allclose(seen_profile(r, PunchCase(0.48, 2.5 / 3)), -1, atol=1e-3)
    assert seen_profile(r.reshape(2, 2), PunchCase(0.48, 2.5 / 3)).shape == (2, 2)


def test_another_source_is_taken_as_it_is() -> None:
    def cone(r_over_a: Floats, case: PunchCase, /) -> tuple[Floats, Floats]:
        return case.w_over_h / r_over_a, 0 * r_over_a

    rise = seen_profile(np.array([2.0]), PunchCase(0.48, 2.5 / 3, 0.1), source=cone)
    np.testing.assert_allclose(rise, 0.1 / 2, rtol=1e-4)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="r = a"):
        exact_profile(0.5, 0.4, a_over_h=1.0)
    with pytest.raises(InputError, match="Poisson"):
        exact_profile(2.0, 0.52, a_over_h=1.0)
