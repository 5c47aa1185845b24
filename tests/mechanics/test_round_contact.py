"""Ball and cone on the bonded layer: half-space, flat punch as increment, printed corrections, own bodies."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics import round_contact as thin_layer
from tactilevision.mechanics.kappa import kappa
from tactilevision.mechanics.round_contact import (
    Ball,
    Cone,
    RoundBody,
    contact_at,
    contact_curve,
    contact_force,
    half_space_force,
)
from tactilevision.records.measured import Floats

BALL, CONE = Ball(50.0), Cone(89.0)  # shallow: the ball is a parabola to 1e-4


@each("body", [BALL, CONE])
@each("nu", [0.0, 0.48])
def test_thick_layer_is_a_half_space(body: Ball | Cone, nu: float) -> None:
    depth = np.array([1e-6, 1e-5])
    gel = {"youngs_modulus_MPa": 0.2, "poisson_ratio": nu}
    ratio = contact_force(body, depth, thickness_mm=10.0, **gel) / half_space_force(body, depth, **gel)
    np.testing.assert_allclose(ratio, 1, atol=3e-3)
    assert np.abs(ratio - 1)[0] < np.abs(ratio - 1)[1]


@each("body", [Ball(6.0), Cone(70.0)])
@each("nu, alpha", [(0.0, 0.3), (0.48, 0.8), (0.5, 3.0)])
def test_increment_is_a_flat_punch(body: RoundBody, nu: float, alpha: float) -> None:
    # dP/dw = 2 a E kappa(nu, a/h)/(1 - nu^2) for every smooth frictionless contact of radius a
    h = 1.0
    step = 1e-4
    (w0, p0), (w1, p1) = (contact_at(body, alpha + d, thickness_mm=h, poisson_ratio=nu) for d in (-step, step))
    assert (p1 - p0) / (w1 - w0) == pytest.approx(2 * alpha * kappa(nu, alpha) / (1 - nu**2), rel=1e-6)


def test_curve_passes_through_its_points() -> None:
    ball = Ball(4.0)
    radii = np.array([0.05, 0.3, 0.9, 1.7])
    exact = np.array([contact_at(ball, a, thickness_mm=3.0, poisson_ratio=0.48) for a in radii])
    curve = contact_curve(ball, exact[:, 0], thickness_mm=3.0, poisson_ratio=0.48)
    np.testing.assert_allclose(curve.force_over_E_mm2, exact[:, 1], rtol=1e-6)
    np.testing.assert_allclose(curve.contact_radius_mm, radii, rtol=1e-6)


@each(
    "chi, dimitriadis, garcia, cone",
    [(0.1, 0.004, 0.002, 0.001), (0.3, 0.03, 0.003, 0.002), (0.5, 0.09, 0.01, 0.003), (1.0, 0.17, 0.15, 0.02)],
)
def test_printed_corrections_hold_their_stated_range(
    chi: float, dimitriadis: float, garcia: float, cone: float
) -> None:
    gel = {"youngs_modulus_MPa": 1.0, "poisson_ratio": 0.5}

    def exact(body: Ball | Cone, depth: float) -> float:
        force = contact_force(body, depth, thickness_mm=1.0, **gel) / half_space_force(body, depth, **gel)
        return float(force)

    ball, point = exact(BALL, chi**2 / BALL.radius_mm), exact(CONE, chi / np.tan(np.radians(CONE.half_angle_deg)))
    assert thin_layer.dimitriadis_ball(chi) == pytest.approx(ball, rel=dimitriadis)
    assert thin_layer.garcia_ball(chi) == pytest.approx(ball, rel=garcia)
    assert thin_layer.garcia_cone(chi) == pytest.approx(point, rel=cone)


def test_second_order_of_the_expansion_is_garcias() -> None:
    # the exact solution decides between 1.497 (Garcia) and 1.283 (Dimitriadis) for the term in chi^2
    chi = np.array([0.02, 0.04, 0.06])
    gel = {"youngs_modulus_MPa": 1.0, "poisson_ratio": 0.5}
    ball, depth = Ball(1e4), chi**2 / 1e4
    ratio = contact_force(ball, depth, thickness_mm=1.0, **gel) / half_space_force(ball, depth, **gel)
    second = np.polynomial.Polynomial.fit(chi, (ratio - 1) / chi, 2).convert().coef
    assert second[0] == pytest.approx(thin_layer.GARCIA_BALL[0], abs=0.01)
    assert second[1] == pytest.approx(thin_layer.GARCIA_BALL[1], abs=0.1)


def test_own_body_is_taken() -> None:
    class Parabola:
        def sag(self, x_mm: Floats, /) -> Floats:
            return x_mm**2 / 50.0

        def largest_contact_mm(self) -> float:
            return 100.0

    gel = {"youngs_modulus_MPa": 1.0, "poisson_ratio": 0.45, "thickness_mm": 2.0}
    assert contact_force(Parabola(), 0.01, **gel) == pytest.approx(
        float(contact_force(BALL, 0.01, **gel)), rel=1e-3
    )


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="depth_mm"):
        contact_curve(BALL, [0.1, -0.1], thickness_mm=1.0, poisson_ratio=0.4)
    with pytest.raises(InputError, match="exceeds ten"):
        contact_curve(Ball(1.0), 2.0, thickness_mm=1.0, poisson_ratio=0.4)
    with pytest.raises(InputError, match="Poisson"):
        contact_curve(BALL, 0.1, thickness_mm=1.0, poisson_ratio=0.7)
    with pytest.raises(InputError, match="chi"):
        thin_layer.garcia_ball(1.2)


@each("body, size", [(Ball, -1.0), (Ball, 0.0), (Cone, 0.0), (Cone, 90.0), (Cone, float("nan"))])
def test_a_body_that_cannot_be_is_refused(body: type[Ball] | type[Cone], size: float) -> None:
    with pytest.raises(InputError):
        body(size)
