"""Hencky's law: linear elasticity between Kirchhoff stress and logarithmic strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.mechanics.punch_fem.kinematics import PLANE_HESSIAN, Deformation, outer
from tactilevision.records import Floats

# |F_plane|² - 2 j = (F_rr - F_zz)² + (F_rz + F_zr)², free of cancellation; half its second derivative:
_SHAPE = np.array(
    [
        [1.0, 0.0, 0.0, -1.0, 0.0],
        [0.0, 1.0, 1.0, 0.0, 0.0],
        [0.0, 1.0, 1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)

_SERIES_BELOW = 1e-3  # of the excess, below which the logarithm comes from its series


@dataclass(frozen=True, slots=True)
class Hencky:
    """W_d = mu dev(ln V):dev(ln V), with volumetric measure g = ln J.

    In closed form, without eigenvectors: e1² + e2² + e3² = (ln j)²/2 + (arccosh x)²/2 + (ln F_tt)², where
    j is the in-plane determinant and x = |F_plane|²/(2 j). Stable to stretches of about 2 (its shear modulus
    softens beyond). Source: Hencky (1928); Anand, J. Appl. Mech. 46 (1979) 78.
    """

    name: str = "hencky"

    def energy(self, state: Deformation, shear_MPa: float) -> Floats:
        """Energy of distortion per volume (N,), MPa."""
        square = _arccosh_square(_excess(state))[0]
        plane, hoop = np.log(state.plane), np.log(state.F[:, 4])
        energy: Floats = shear_MPa * (plane**2 / 2 + square / 2 + hoop**2 - (plane + hoop) ** 2 / 3)
        return energy

    def distortion(self, state: Deformation, shear_MPa: float) -> tuple[Floats, Floats]:
        """Stress (N, 5) and tangent (N, 5, 5) of the distortion, MPa."""
        j, hoop, grad_j = state.plane, state.F[:, 4], state.plane_gradient
        log_j, log_hoop = np.log(j), np.log(hoop)
        # W_d/mu = (ln j)²/6 + (2/3)(ln F_tt)² - (2/3) ln j ln F_tt + q(x)/2
        first = (log_j / 3 - 2 / 3 * log_hoop) / j
        second = (1 / 3) / j**2 - first / j
        excess = _excess(state)
        _, slope, curvature = _arccosh_square(excess)
        shape = state.F @ _SHAPE
        grad_x = shape / j[:, None] - (excess / j)[:, None] * grad_j
        hess_x = _SHAPE / j[:, None, None]
        mixed = outer(shape, grad_j) / (j**2)[:, None, None]
        hess_x = hess_x - mixed - mixed.transpose(0, 2, 1)
        hess_x += (2 * excess / j**2)[:, None, None] * outer(grad_j, grad_j)
        hess_x -= (excess / j)[:, None, None] * PLANE_HESSIAN
        stress = first[:, None] * grad_j + (slope / 2)[:, None] * grad_x
        tangent = second[:, None, None] * outer(grad_j, grad_j) + first[:, None, None] * PLANE_HESSIAN
        tangent += (curvature / 2)[:, None, None] * outer(grad_x, grad_x)
        tangent += (slope / 2)[:, None, None] * hess_x
        across = -(2 / 3) / (j * hoop)
        tangent[:, 4, :] += across[:, None] * grad_j
        tangent[:, :, 4] += across[:, None] * grad_j
        stress[:, 4] += (4 / 3 * log_hoop - 2 / 3 * log_j) / hoop
        tangent[:, 4, 4] += (4 / 3 - (4 / 3 * log_hoop - 2 / 3 * log_j)) / hoop**2
        return shear_MPa * stress, shear_MPa * tangent

    def volume(self, J: Floats) -> tuple[Floats, Floats, Floats]:
        """Volumetric measure g(J) (N,), with g' and g''."""
        return np.log(J), 1 / J, -1 / J**2


def _excess(state: Deformation) -> Floats:
    """x - 1 = ((F_rr - F_zz)² + (F_rz + F_zr)²) / (2 j) >= 0 (N,)."""
    F = state.F
    value: Floats = ((F[:, 0] - F[:, 3]) ** 2 + (F[:, 1] + F[:, 2]) ** 2) / (2 * state.plane)
    return value


def _arccosh_square(excess: Floats) -> tuple[Floats, Floats, Floats]:
    """q(x) = arccosh(x)² and its first two derivatives at x = 1 + excess; a series where they cancel."""
    y = np.maximum(excess, _SERIES_BELOW)
    angle = 2 * np.arcsinh(np.sqrt(y / 2))  # arccosh(1 + y) without its cancellation
    root = np.sqrt(y * (2 + y))
    first = 2 * angle / root
    second = 2 / root**2 - (1 + y) * first / root**2
    z = excess
    small = excess < _SERIES_BELOW
    # arccosh(1 + z)² = 2z - z²/3 + 4z³/45 - z⁴/35 + ...
    return (
        np.where(small, z * (2 + z * (-1 / 3 + z * (4 / 45 - z / 35))), angle**2),
        np.where(small, 2 + z * (-2 / 3 + z * (4 / 15 - z * 4 / 35)), first),
        np.where(small, -2 / 3 + z * (8 / 15 - z * 12 / 35), second),
    )
