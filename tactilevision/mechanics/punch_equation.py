"""The frictionless flat punch on a layer bonded to a rigid base, as an integral equation.

    phi(x) - (2/pi) Int_0^1 M(x, y) phi(y) dy = 1,      0 <= x <= 1 (in punch radii),
    M(x, y) = alpha Int_0^inf (1 - K(u)) cos(alpha u x) cos(alpha u y) du,     alpha = a/h,
    K(u) = (2k sinh 2u - 4u) / (2k cosh 2u + 4u^2 + 1 + k^2),                  k = 3 - 4 nu.

The punch pressure has the Hankel transform  p(xi) = (w E*/pi) a Int_0^1 phi(x) cos(xi a x) dx,  E* = E/(1 - nu^2),
so every quantity of the linear problem follows from phi. 1 - K falls like exp(-2u): both integrals are done by
Gauss-Legendre rules that converge geometrically (64 nodes in x give 11 digits or more up to a/h = 10).

Source: Hayes, Keer, Herrmann, Mockros, J. Biomech. 5 (1972) 541; Lebedev, Ufliand, PMM 22 (1958) 442.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from numpy.polynomial import Legendre

from tactilevision.errors import InputError
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Floats, Pair

NODES = 64  # of Gauss and Legendre on the punch's radius
KERNEL_NODES = 320  # of the kernel's integral
KERNEL_END = 24  # (4 u^2) exp(-2u) has fallen to 3e-18 there
POISSON_RANGE = (0.0, 0.5)  # Poisson's ratio, range of validity
A_OVER_H_RANGE = (0.05, 10)  # a/h, range of validity


@dataclass(frozen=True, slots=True)
class PunchSolution:
    """Solution at one (nu, a/h): `phi` (n,) at the Gauss nodes `x` (n,) in (0, 1) with `weights` (n,)."""

    x: Floats
    weights: Floats
    phi: Floats

    @property
    def kappa(self) -> float:
        """Int_0^1 phi dx = P (1 - nu^2) / (2 a E w)."""
        return float(self.weights @ self.phi)

    @property
    def series(self) -> Legendre:
        """phi on [0, 1] as the Legendre series that the Gauss rule gives: as exact as phi at its nodes."""
        return legendre_series(self.phi)

    def transform(self, xi: Floats) -> Floats:
        """Return Int_0^1 phi(x) cos(xi x) dx, xi in 1/a, of any shape."""
        return np.asarray(np.cos(np.multiply.outer(xi, self.x)) @ (self.weights * self.phi))


@lru_cache(maxsize=8)
def gauss(nodes: int, end: float = 1.0) -> tuple[Floats, Floats]:
    """Return Gauss-Legendre nodes and weights (n,), dimensionless, on [0, end].

    Read-only, since they are shared.
    """
    x, weights = np.polynomial.legendre.leggauss(nodes)
    x, weights = end * (x + 1) / 2, end * weights / 2
    x.setflags(write=False)
    weights.setflags(write=False)
    return x, weights


def layer_defect(u: Floats, poisson_ratio: float) -> Floats:
    """Return 1 - K(u), dimensionless, for u of any shape, written so that nothing cancels.

    1 at u = 0 for nu = .5, and ~ 4u^2 exp(-2u)/k for large u.
    """
    k = 3 - 4 * poisson_ratio
    fall = np.exp(-2 * u)
    part = (4 * u**2 + 1 + k**2) * fall
    return np.asarray((2 * k * fall**2 + part + 4 * u * fall) / (k * (1 + fall**2) + part))


def solve_punch(poisson_ratio: float, a_over_h: float, *, nodes: int = NODES) -> PunchSolution:
    """Solve the equation at one nu in [0, .5] and a/h in [.05, 10]; about a millisecond.

    Raises InputError outside that range: nothing is extrapolated.
    """
    check_range(poisson_ratio, a_over_h, where="solve_punch")
    x, weights = gauss(nodes)
    phi = np.linalg.solve(equation_matrix(poisson_ratio, a_over_h, nodes=nodes), np.ones(nodes))
    return PunchSolution(x, weights, phi.astype(float))


def equation_matrix(poisson_ratio: float, a_over_h: float, *, nodes: int = NODES) -> Floats:
    """Return 1 - (2/pi) M W at the Gauss nodes, (nodes, nodes): applied to phi it gives the right-hand side."""
    x, weights = gauss(nodes)
    u, u_weights = gauss(KERNEL_NODES, KERNEL_END)
    waves = np.cos(np.multiply.outer(a_over_h * u, x))
    kernel = a_over_h * (waves.T * (u_weights * layer_defect(u, poisson_ratio))) @ waves
    return np.asarray(np.eye(nodes) - (2 / np.pi) * kernel * weights)


def legendre_series(values: Floats) -> Legendre:
    """Return the polynomial through values (n,) at the n Gauss nodes of [0, 1]."""
    x, weights = gauss(len(values))
    degree = np.arange(len(values))
    modes = np.polynomial.legendre.legvander(2 * x - 1, len(values) - 1)
    return Legendre((2 * degree + 1) * ((weights * values) @ modes), domain=[0, 1])


def check_range(poisson_ratio: object, a_over_h: object, *, where: str) -> None:
    """Raise InputError unless every nu and every a/h (numbers or arrays) lies in the range of validity."""
    check_within("Poisson's ratio lies in", poisson_ratio, POISSON_RANGE, where=where)
    remedy = "Check the punch radius and the gel thickness, both in mm."
    check_within("a/h lies in", a_over_h, A_OVER_H_RANGE, where=where, remedy=remedy)


def check_within(said: str, value: object, ends: Pair, *, where: str, remedy: str = "") -> None:
    """Raise InputError unless every number of `value`, of any shape, lies between `ends`; `said` begins it."""
    numbers, (low, high) = np.asarray(value, dtype=float), ends
    outside = ~((numbers >= low - ROUNDING) & (numbers <= high + ROUNDING))
    if outside.any():
        first = float(numbers[outside].flat[0])
        raise InputError(f"{said} [{low:g}, {high:g}]", where=where, value=first, remedy=remedy)


def positive(name: str, value: npt.ArrayLike) -> Floats:
    """Return `value` as an array of any shape, in its unit; raise InputError if any is not finite and above 0."""
    numbers = np.asarray(value, dtype=float)
    if not (np.isfinite(numbers) & (numbers > 0)).all():
        raise InputError(
            f"{name} is a finite number above 0",
            where="mechanics",
            value=np.min(numbers).item(),
            remedy="Check its unit and its sign.",
        )
    return numbers
