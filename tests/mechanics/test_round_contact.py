"""Ball and cone on the bonded layer: half-space, flat punch as increment, printed corrections."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import kappa
from tactilevision.mechanics.round_contact import (
    Ball,
    Cone,
    contact_at,
    contact_curve,
)
from tactilevision.records.measured import Floats

BALL, CONE = Ball(50.0), Cone(89.0)  # shallow: the ball is a parabola to 1e-4
# Coefficients of chi to chi^4 of printed corrections at nu = .5; chi is sqrt(R w)/h for a ball, w tan(angle)/h for
# a cone. Dimitriadis et al., Biophys. J. 82 (2002) 2798, eq. 12; Garcia and Garcia, Biophys. J. 114 (2018) 2923.
DIMITRIADIS = (1.133, 1.283, 0.769, 0.0975)
GARCIA = (1.133, 1.497, 1.469, 0.755)
GARCIA_CONE = (0.721, 0.650, 0.491, 0.225)


def over_half_space(body: Ball | Cone, depth_mm: Floats, thickness_mm: float, nu: float) -> Floats:
    """Return the force over that of Hertz' ball or Sneddon's cone."""
    force = contact_curve(body, depth_mm, thickness_mm=thickness_mm, poisson_ratio=nu).force_over_E_mm2
    if isinstance(body, Ball):
        hertz: Floats = 4 / 3 * np.sqrt(body.radius_mm) * depth_mm**1.5
    else:
        hertz = 2 / np.pi * np.tan(np.radians(body.half_angle_deg)) * depth_mm**2
    return np.asarray(force * (1 - nu**2) / hertz)


@each("body", [BALL, CONE])
@each("nu", [0.0, 0.48])
def test_thick_layer_is_a_half_space(body: Ball | Cone, nu: float) -> None:
    depth = np.array([1e-6, 1e-5])
    ratio = over_half_space(body, depth, 10.0, nu)
    np.testing.assert_allclose(ratio, 1, atol=3e-3)
    assert np.abs(ratio - 1)[0] < np.abs(ratio - 1)[1]


@each("body", [Ball(6.0), Cone(70.0)])
@each("nu, alpha", [(0.0, 0.3), (0.48, 0.8), (0.5, 3.0)])
def test_increment_is_a_flat_punch(body: Ball | Cone, nu: float, alpha: float) -> None:
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
    slope = np.tan(np.radians(CONE.half_angle_deg))
    ball = float(over_half_space(BALL, np.array(chi**2 / BALL.radius_mm), 1.0, 0.5))
    point = float(over_half_space(CONE, np.array(chi / slope), 1.0, 0.5))
    for terms, exact, error in (
        (DIMITRIADIS, ball, dimitriadis),
        (GARCIA, ball, garcia),
        (GARCIA_CONE, point, cone),
    ):
        assert np.polynomial.Polynomial((1, *terms))(chi) == pytest.approx(exact, rel=error)


def test_second_order_of_the_expansion_is_garcias() -> None:
    # the exact solution decides between 1.497 (Garcia) and 1.283 (Dimitriadis) for the term in chi^2
    chi = np.array([0.02, 0.04, 0.06])
    ratio = over_half_space(Ball(1e4), chi**2 / 1e4, 1.0, 0.5)
    second = np.polynomial.Polynomial.fit(chi, (ratio - 1) / chi, 2).convert().coef
    assert second[0] == pytest.approx(GARCIA[0], abs=0.01)
    assert second[1] == pytest.approx(GARCIA[1], abs=0.1)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="depth_mm"):
        contact_curve(BALL, [0.1, -0.1], thickness_mm=1.0, poisson_ratio=0.4)
    with pytest.raises(InputError, match="exceeds ten"):
        contact_curve(Ball(1.0), 2.0, thickness_mm=1.0, poisson_ratio=0.4)
    with pytest.raises(InputError, match="Poisson"):
        contact_curve(BALL, 0.1, thickness_mm=1.0, poisson_ratio=0.7)


@each("body, size", [(Ball, -1.0), (Ball, 0.0), (Cone, 0.0), (Cone, 90.0), (Cone, float("nan"))])
def test_a_body_that_cannot_be_is_refused(body: type[Ball] | type[Cone], size: float) -> None:
    with pytest.raises(InputError):
        body(size)
