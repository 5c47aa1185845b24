"""How much stiffer a punch is that sticks than one that slides freely, for a linear bonded layer.

Complementary energy over shapes of pressure P_2n(s)/s and of shear that end like 1/s at the punch's edge, where
s^2 = 1 - r^2. Their Hankel transforms are spherical Bessel functions, which are orthogonal:

    A a + B b = w f,    B^T a + D b = 0,    P_stick/P_free = f^T (A - B D^-1 B^T)^-1 f / (f^T A^-1 f)

with A, B, D the Hankel integrals of the layer's compliances C_zz, C_zr, C_rr. Both numerator and denominator come
from below; their ratio is good to .1 %. On a half-space it tends to Spence's (1 - nu) ln(3 - 4 nu)/(1 - 2 nu).
Sources: Spence, Proc. R. Soc. A 305 (1968) 55; Sneddon, Fourier Transforms (1951), sec. 52.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.mechanics.layer import layer_compliance
from tactilevision.records import Floats

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

SHAPES = 12  # of pressure and of shear: the ratio is good to .1 %
XI_END = 600.0  # largest wave number, 1/a
XI_STEP = 0.05  # between wave numbers, 1/a: a twentieth of what a layer of thickness a asks for


def sticking_surplus(poisson_ratio: float, a_over_h: float) -> float:
    """P_stick/P_free - 1: 0 for a half-space at nu = .5, some per cent at a/h near 1, smooth in nu.

    nu in [0, .4999] and a/h in [.05, 5]; beyond, the nearest of these.
    """
    nu = min(max(poisson_ratio, 0.0), 0.4999)
    return max(float(_spline(round(min(max(a_over_h, 0.05), 5.0), 3))(nu)), 0.0)


@lru_cache(maxsize=128)
def _spline(a_over_h: float) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    nodes = 0.4999 * np.sin(np.linspace(0, np.pi / 2, 14))  # crowded towards nu = .5
    return CubicSpline(nodes, [exact_surplus(float(nu), a_over_h) for nu in nodes])


def exact_surplus(poisson_ratio: float, a_over_h: float) -> float:
    """The same without interpolation; a few milliseconds."""
    xi, weight = _waves()
    pressure, shear = _transforms()
    part = layer_compliance(xi / a_over_h, poisson_ratio)
    along = weight * xi
    A = (pressure * (along * part.normal)) @ pressure.T
    B = (pressure * (along * part.coupling)) @ shear.T
    D = (shear * (along * part.along)) @ shear.T
    force = pressure[:, 0]  # the transform at xi = 0 is the total over 2 pi
    free = force @ np.linalg.solve(A, force)
    stick = force @ np.linalg.solve(A - B @ np.linalg.solve(D, B.T), force)
    return max(float(stick / free) - 1, 0.0)


@lru_cache(maxsize=1)
def _waves() -> tuple[Floats, Floats]:
    xi = np.arange(1e-6, XI_END, XI_STEP)
    weight = np.full(xi.size, XI_STEP)
    weight[0] /= 2
    return xi, weight


@lru_cache(maxsize=1)
def _transforms() -> tuple[Floats, Floats]:
    """Of the pressures with J0, j_0 j_2 j_4 ..., and of the shears with J1, j_1 j_3 ...: (SHAPES, waves) each."""
    from scipy.special import spherical_jn

    xi, _ = _waves()
    order = 2 * np.arange(SHAPES)[:, None]
    return spherical_jn(order, xi), spherical_jn(order + 1, xi)
