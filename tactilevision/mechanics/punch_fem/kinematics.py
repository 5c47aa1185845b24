"""Deformation of an axisymmetric solid, as five numbers a point, and the invariants built from them.

F = (F_rr, F_rz, F_zr, F_zz, F_tt): row the component, column the reference direction, t the hoop. All
arrays are (N, 5), first derivatives (N, 5), second derivatives (N, 5, 5), for N points.
Source: Holzapfel, Nonlinear Solid Mechanics (2000), chapter 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records import Floats

IDENTITY = np.array([1.0, 0.0, 0.0, 1.0, 1.0])  # deformation gradient at rest: F_rr, F_rz, F_zr, F_zz, F_tt

# The in-plane determinant j = F_rr F_zz - F_rz F_zr is quadratic: its second derivative is this constant.
PLANE_HESSIAN = np.array(
    [
        [0.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, -1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


@dataclass(frozen=True, slots=True)
class Deformation:
    """F (N, 5); `plane` (N,) in-plane determinant and its gradient (N, 5); `volume` J (N,) with gradient and
    hessian."""

    F: Floats
    plane: Floats
    plane_gradient: Floats
    volume: Floats
    volume_gradient: Floats
    volume_hessian: Floats


def deformation(F: Floats) -> Deformation:
    """The determinants of F (N, 5) and their derivatives: J = (F_rr F_zz - F_rz F_zr) F_tt."""
    hoop = F[:, 4]
    plane = F[:, 0] * F[:, 3] - F[:, 1] * F[:, 2]
    plane_gradient = np.zeros_like(F)
    plane_gradient[:, 0], plane_gradient[:, 1] = F[:, 3], -F[:, 2]
    plane_gradient[:, 2], plane_gradient[:, 3] = -F[:, 1], F[:, 0]
    gradient = plane_gradient * hoop[:, None]
    gradient[:, 4] = plane
    hessian = hoop[:, None, None] * PLANE_HESSIAN
    hessian[:, 4, :4] = hessian[:, :4, 4] = plane_gradient[:, :4]
    return Deformation(F, plane, plane_gradient, plane * hoop, gradient, hessian)


def outer(left: Floats, right: Floats) -> Floats:
    """Dyad of two (N, 5) fields: (N, 5, 5)."""
    product: Floats = left[:, :, None] * right[:, None, :]
    return product
