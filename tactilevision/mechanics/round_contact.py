"""Contact of a ball, a cone or a ridge with a bonded layer, exact up to quadrature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_equation import (
    A_OVER_H_RANGE,
    POISSON_RANGE,
    check_within,
    equation_matrix,
    gauss,
    legendre_series,
    positive,
)
from tactilevision.mechanics.ridge_contact import Ridge, ridge_at
from tactilevision.records.measured import Floats

# Frictionless contact of a smooth round body, exact up to quadrature.
#
# The body's face f(r) (f(0) = 0) pressed to the depth w touches the gel within r < a, u_z = w - f. The equation of
# punch_equation.py has the same kernel and another right-hand side,
#
#     phi(x) - (2/pi) Int_0^1 M(x, y) phi(y) dy = w - s(a x),     s(x) = x Int_0^x f'(r)/sqrt(x^2 - r^2) dr,
#
# and the edge of a smooth contact is where the pressure vanishes, phi(1) = 0: this gives w for each a, and
#
#     P = 2 E* a Int_0^1 phi dx,   E* = E/(1 - nu^2).
#
# Limits: a << h is Hertz' ball, P = 4/3 E* sqrt(R) w^1.5, and Sneddon's cone, P = (2/pi) E* tan(half-angle) w^2.
# Small strain: depth well below the thickness and the ball's radius. nu in [0, .5], a/h up to 10; InputError
# beyond.
#
# Source: Sneddon, Int. J. Eng. Sci. 3 (1965) 47 (half-space); Hayes et al., J. Biomech. 5 (1972) 541 (layer).

NODES = 48  # of Gauss and Legendre on the contact's radius
CURVE_POINTS = 80  # radii of contact along a curve


@dataclass(frozen=True, slots=True)
class Ball:
    """A sphere: f = R - sqrt(R^2 - r^2), s = x artanh(x/R)."""

    radius_mm: float

    def __post_init__(self) -> None:
        positive("radius_mm", self.radius_mm)

    def sag(self, x_mm: Floats, /) -> Floats:
        """Return s(x) of the equation, mm, any shape."""
        return np.asarray(x_mm * np.arctanh(x_mm / self.radius_mm))

    def largest_contact_mm(self) -> float:
        """Return the largest contact radius of the body's description."""
        return 0.95 * self.radius_mm


@dataclass(frozen=True, slots=True)
class Cone:
    """f = r/tan(half-angle), s = (pi/2) x/tan(half-angle); a flat angle is a half-angle of 90 degrees."""

    half_angle_deg: float

    def __post_init__(self) -> None:
        if not 0 < self.half_angle_deg < 90:
            raise InputError(
                "a cone's half-angle lies between 0 and 90 degrees",
                where="Cone",
                value=self.half_angle_deg,
                remedy="It is measured from the axis.",
            )

    def sag(self, x_mm: Floats, /) -> Floats:
        """Return s(x) of the equation, mm, any shape."""
        return np.asarray(np.pi / 2 * x_mm / np.tan(np.radians(self.half_angle_deg)))

    def largest_contact_mm(self) -> float:
        """Return the largest contact radius of the body's description."""
        return float("inf")


Body = Ball | Cone | Ridge


@dataclass(frozen=True, slots=True)
class ContactCurve:
    """Depth (mm), force over Young's modulus (mm^2) and contact radius (mm), (n,) each, all growing."""

    depth_mm: Floats
    force_over_E_mm2: Floats
    contact_radius_mm: Floats


def contact_at(
    body: Body, contact_radius_mm: float, *, thickness_mm: float, poisson_ratio: float
) -> tuple[float, float]:
    """Return (depth in mm, force over E in mm^2) at which the contact has this radius; half a millisecond.

    The radius of a ridge's contact is half its width.
    """
    if isinstance(body, Ridge):
        return ridge_at(body, contact_radius_mm, thickness_mm=thickness_mm, poisson_ratio=poisson_ratio)
    x, weights = gauss(NODES)
    alpha = contact_radius_mm / thickness_mm
    right = np.stack([np.ones(NODES), body.sag(contact_radius_mm * x)], axis=1)
    flat, bent = np.linalg.solve(equation_matrix(poisson_ratio, alpha, nodes=NODES), right).T
    depth = float(legendre_series(bent)(1.0) / legendre_series(flat)(1.0))
    mean = float(weights @ (depth * flat - bent))
    return depth, 2 * contact_radius_mm * mean / (1 - poisson_ratio**2)


def contact_curve(
    body: Body, depth_mm: npt.ArrayLike, *, thickness_mm: float, poisson_ratio: float
) -> ContactCurve:
    """Return the force and contact radius at depths > 0 (any shape), from 80 solutions and a smooth curve through
    them.

    Interpolated in logarithms, in which the half-space's power laws are straight: relative error below 1e-6.
    """
    from scipy.interpolate import CubicSpline

    depth = positive("depth_mm", depth_mm)
    thickness = float(positive("thickness_mm", thickness_mm))
    check_within("Poisson's ratio lies in", poisson_ratio, POISSON_RANGE, where="contact_curve")
    case = {"thickness_mm": thickness, "poisson_ratio": poisson_ratio}
    low, high = _bracket(body, (float(depth.min()), float(depth.max())), case)
    radii = np.geomspace(low, high, CURVE_POINTS)
    solved = np.log([contact_at(body, float(radius), **case) for radius in radii])
    through = CubicSpline(solved[:, 0], np.stack([solved[:, 1], np.log(radii)], axis=1))
    force, radius = np.moveaxis(np.exp(through(np.log(depth))), -1, 0)
    return ContactCurve(depth, force, radius)


def _bracket(body: Body, depths: tuple[float, float], case: dict[str, float]) -> tuple[float, float]:
    """Return the contact radii whose depths enclose those asked for."""
    largest = min(A_OVER_H_RANGE[1] * case["thickness_mm"], body.largest_contact_mm())
    low = high = min(0.1 * case["thickness_mm"], largest)
    while contact_at(body, low, **case)[0] > depths[0]:
        low /= 2
    while contact_at(body, high, **case)[0] < depths[1]:
        if high >= largest:
            raise InputError(
                "at this depth the contact exceeds ten thicknesses or the body",
                where="contact_curve",
                value=depths[1],
            )
        high = min(1.5 * high, largest)
    return 0.9 * low, min(1.05 * high, largest)
