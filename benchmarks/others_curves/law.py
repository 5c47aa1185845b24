"""Force of a flat punch, radius a, pressed w into a layer, thickness h, that is glued to its base.

    P = 2 a E kappa w / (1 - nu^2) * g(w/h),    kappa = integral of phi over 0..1
    phi(x) - (1/pi) int_0^1 phi(t) [k(x - t) + k(x + t)] dt = 1
    k(u) = (a/h) int_0^inf (1 - L(s)) cos(s u a/h) ds
    L(s) = [(3 - 4 nu) sinh 2s - 2s] / [(3 - 4 nu) cosh 2s + 2 s^2 + 5 - 12 nu + 8 nu^2]

The face slides. Source: Lebedev, Ufliand, J. Appl. Math. Mech. 22 (1958) 442. g is 1 + b w/h + c (w/h)^2; b
grows with a/h and c is small, as finite elements of others have it for a face that sticks.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
NODES = 32  # of the quadrature over the face
WAVES = 400  # of the quadrature over wave numbers
GROWN = 5  # places between the contact at first and the whole face
BEND = 0.92  # b over a/h: .84 of elements of a neo-Hookean solid, 1.02 of a Hencky one

gauss = cache(np.polynomial.legendre.leggauss)


@cache
def kappa(nu: float, a_over_h: float) -> float:
    """How much stiffer than a half-space, (1)."""
    x, weight = gauss(NODES)
    x, weight = (x + 1) / 2, weight / 2
    s, ds = gauss(WAVES)
    s, ds = 15 * (s + 1), 15 * ds
    above = (3 - 4 * nu) * np.sinh(2 * s) - 2 * s
    below = (3 - 4 * nu) * np.cosh(2 * s) + 2 * s**2 + 5 - 12 * nu + 8 * nu**2
    lost = (1 - above / below) * ds

    wave = np.cos(a_over_h * x[:, None] * s)  # k(x - t) + k(x + t), by the sum of their cosines as a product
    table = 2 * a_over_h * (wave * lost) @ wave.T
    phi = np.linalg.solve(np.eye(NODES) - table * weight / np.pi, np.ones(NODES))
    return float(weight @ phi)


def kappa_between(nu: float, a_over_h: Array, *, ends: tuple[float, float]) -> Array:
    """kappa at each a/h (N,) between two ends, through exact values at GROWN places."""
    places = np.round(np.linspace(*ends, GROWN), 6)
    exact = [kappa(nu, float(one)) for one in places]
    return np.asarray(np.polynomial.Polynomial.fit(places, exact, GROWN - 1)(a_over_h))


def slope_N_per_mm(modulus_MPa: float, nu: float, radius_mm: float, thickness_mm: float) -> float:
    """dP/dw at first touch, N/mm."""
    a_over_h = round(radius_mm / thickness_mm, 6)
    return 2 * radius_mm * modulus_MPa * kappa(round(nu, 6), a_over_h) / (1 - nu**2)


def growth(strain: Array, bend: float, *, curve: float) -> Array:
    """g at w/h (N,)."""
    return np.asarray(1 + bend * strain + curve * strain**2)


def rounded(depth_mm: Array, radius_mm: float, edge_mm: float) -> tuple[Array, Array]:
    """Radius of contact (N,) and what the half-space's force has over 2 E* a w for a face with a circular edge.

    w(a) = a int_0^a f'(r) / sqrt(a^2 - r^2) dr of the profile f, by quadrature: Sneddon (1965).
    """
    flat = radius_mm - edge_mm
    radii = np.linspace(flat, radius_mm, 120)
    u, weight = gauss(60)
    deep = []
    for a in radii:
        top = np.arccos(min(flat / a, 1.0))
        angle = top * (u + 1) / 2  # r = a cos(angle)
        beyond = a * np.cos(angle) - flat
        steep = beyond / np.sqrt(np.maximum(edge_mm**2 - beyond**2, (0.02 * edge_mm) ** 2))
        deep.append(a * float(steep @ weight) * top / 2)
    sunk = np.array(deep)
    lost = np.concatenate([[0.0], np.cumsum(np.diff(radii) * (sunk[1:] + sunk[:-1]) / 2)])
    force = radii * sunk - lost  # over 2 E*
    a = np.interp(depth_mm, sunk, radii)
    at = np.interp(depth_mm, sunk, force) + radius_mm * np.maximum(depth_mm - sunk[-1], 0.0)
    share = np.where(depth_mm > 1e-9, at / np.maximum(radius_mm * depth_mm, 1e-12), flat / radius_mm)
    return np.asarray(a), np.asarray(share)
