"""Equivalent uniform thickness of an uneven gel under a punch.

To first order in the unevenness the stiffness depends on the thickness by the energy density at the bonded base
(the shape derivative of the elastic energy; all tangential strain vanishes there):

    d(c w^2/2) = -Int W(r) dh(x, y) dA,   W = (sigma_zz^2/M + sigma_rz^2/mu)/2,   h_eq = Int W h dA / Int W dA,

M the constrained and mu the shear modulus; the stresses at the base are those under a frictionless punch on a
uniform layer (profile.py's pressure, wave by wave). A wedge has no effect to first order if the punch is at its
middle; 94 % of the weight is within a + h of the axis, most of it outside the face where nu is near .5. For
unevenness of a tenth of h and slopes below .1 the error is of second order, about a per cent of h. nu in [0, .5),
a/h in [.05, 10].

Source: Hadamard's formula for a clamped boundary; Sokolowski, Zolesio, Introduction to Shape Optimization (1992).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.material import constrained_modulus, positive, shear_modulus
from tactilevision.mechanics.punch_equation import gauss, solve_punch
from tactilevision.records.measured import Bools, Floats, Pair

WAVES = 256  # nodes of the integral over wave numbers
LAST_WAVE = 40  # of u: the stresses at the base fall like u exp(-u)
GRID = 200  # places across the base


def base_energy(r_mm: npt.ArrayLike, *, radius_mm: float, thickness_mm: float, poisson_ratio: float) -> Floats:
    """Return W(r) (any shape) under a punch at unit depth on a gel of unit Young's modulus, 1/mm^2 times MPa."""
    from scipy.special import j0, j1

    r = np.asarray(r_mm, dtype=float) / float(positive("thickness_mm", thickness_mm))
    alpha = float(positive("radius_mm", radius_mm)) / thickness_mm
    punch = solve_punch(poisson_ratio, alpha)
    u, weights = gauss(WAVES, LAST_WAVE)
    normal, shear = base_stress(u, poisson_ratio)
    # p(xi) xi dxi = (E* w/pi) a Phi(alpha u) u du / h^2, for w = 1 and E = 1
    load = (
        weights * u * punch.transform(alpha * u) * radius_mm / (np.pi * (1 - poisson_ratio**2) * thickness_mm**2)
    )
    waves = np.multiply.outer(r, u)
    sigma, tau = j0(waves) @ (load * normal), j1(waves) @ (load * shear)
    M, mu = constrained_modulus(1.0, poisson_ratio), shear_modulus(1.0, poisson_ratio)
    return np.asarray((sigma**2 / M + tau**2 / mu) / 2)


def base_stress(u: Floats, poisson_ratio: float) -> tuple[Floats, Floats]:
    """Return (sigma_zz, sigma_rz) at the base over the surface's pressure wave, at u = q h (n,), up to their
    signs.
    """
    k, nu = 3 - 4 * poisson_ratio, poisson_ratio
    lame, one, zero, fall = 2 * nu / (1 - 2 * nu), np.ones_like(u), np.zeros_like(u), np.exp(-u)
    # u_z = (A + B z) exp(-z) + (C + D z) exp(z - u), u_x = i g; rows: u_z, g, their z-derivatives
    top = np.array(
        [
            [one, zero, fall, zero],
            [-one, k * one, fall, k * fall],
            [-one, one, fall, fall],
            [one, -(1 + k) * one, fall, (1 + k) * fall],
        ]
    )
    low = np.array(
        [
            [fall, u * fall, one, u],
            [-fall, (k - u) * fall, one, k + u],
            [-fall, (1 - u) * fall, one, 1 + u],
            [fall, (u - 1 - k) * fall, one, 1 + k + u],
        ]
    )
    pressed = -(lame * (top[2] - top[1]) + 2 * top[2])
    matrix = np.moveaxis(np.stack([low[0], low[1], pressed, top[3] + top[0]]), -1, 0)
    load = np.zeros((len(u), 4, 1))
    load[:, 2] = 1.0
    answer = np.linalg.solve(matrix, load)[..., 0].T
    normal = (lame * (low[2] - low[1]) + 2 * low[2]) * answer
    return normal.sum(axis=0), ((low[3] + low[0]) * answer).sum(axis=0)


def equivalent_thickness(
    thickness_mm: Floats, known: Bools, *, mm_per_px: Pair, centre_mm: Pair, radius_mm: float, poisson_ratio: float
) -> float:
    """Return h_eq (mm) of a thickness map (H, W), `known` where it is valid, for a punch at `centre_mm` on the
    pad.

    Raises InputError if the map lacks more than a tenth of the weight, or has a thickness not above 0.
    """
    height, width = thickness_mm.shape
    x = (np.arange(width) - (width - 1) / 2) * mm_per_px[0] - centre_mm[0]
    y = (np.arange(height) - (height - 1) / 2) * mm_per_px[1] - centre_mm[1]
    r = np.hypot(x[None, :], y[:, None])
    values = positive("thickness_mm", thickness_mm[known])
    near = r[known] < 2 * radius_mm
    mean = float(np.mean(values[near])) if near.any() else float(np.mean(values))
    grid = np.linspace(0, radius_mm + 4 * mean, GRID)
    energy = base_energy(grid, radius_mm=radius_mm, thickness_mm=mean, poisson_ratio=poisson_ratio)
    weight = np.interp(r[known], grid, energy, right=0.0)
    seen = float(weight.sum()) * mm_per_px[0] * mm_per_px[1]
    whole = float(np.trapezoid(2 * np.pi * grid * energy, grid))
    if seen < 0.9 * whole:
        raise InputError(
            "the thickness map lacks more than a tenth of the weight under the punch",
            where="equivalent_thickness",
            value=seen / whole,
        )
    return float(weight @ values / weight.sum())
