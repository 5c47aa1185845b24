"""Contact of a ridge (a cylinder lying on its side) with a bonded layer in plane strain, exact up to quadrature.

The pressure over |x| < b is p = sum_n c_n T_2n(x/b)/sqrt(1 - x^2/b^2), and the surface below it moves by

    u_z(x) = (1/pi) Int_0^inf C_zz(q) P(q) cos(q x) dq,    P(q) = pi b sum_n (-1)^n c_n J_2n(q b),

with the layer's C_zz of layer.py. Projected on the same functions, u_z = w - f(x) gives c_n; the pressure vanishes
at the edge, sum_n c_n = 0, which gives w for each b. The force is pi b c_0 times the length. Ends of the ridge are
neglected: its length exceeds the contact's width by far. Small strain; nu in [0, .5].

Limits: a thin compressible layer acts as springs of M/h per area (M: constrained modulus); b << h is the plane
Hertz contact, F/L = pi E* b^2/(4 R). Source: Johnson, Contact Mechanics (1985), sections 4.2(c) and 5.8.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactilevision.mechanics.layer import layer_compliance
from tactilevision.mechanics.punch_equation import positive
from tactilevision.records.measured import Floats

TERMS = 10  # terms of the pressure: six digits of the force
LAST_WAVE = 400.0  # q b to which waves are summed; beyond, the half-space's are integrated in closed form
PANELS = 200  # intervals of sixteen Gauss nodes up to the last wave


@dataclass(frozen=True, slots=True)
class Ridge:
    """A cylinder of `radius_mm` that lies on the gel over `length_mm`."""

    radius_mm: float
    length_mm: float

    def __post_init__(self) -> None:
        positive("radius_mm", self.radius_mm)
        positive("length_mm", self.length_mm)

    def largest_contact_mm(self) -> float:
        """Return the largest half width of the body's description."""
        return 0.95 * self.radius_mm


def ridge_at(
    body: Ridge, half_width_mm: float, *, thickness_mm: float, poisson_ratio: float
) -> tuple[float, float]:
    """Return (depth in mm, force over E in mm^2) at which the contact has this half width."""
    waves, weights, bessel = _waves()
    signs = (-1.0) ** np.arange(TERMS)
    scale = 2 * (1 + poisson_ratio) * thickness_mm  # mm: h/mu times E
    spring = scale * layer_compliance(waves * thickness_mm / half_width_mm, poisson_ratio).normal
    matrix = (bessel * (weights * spring)) @ bessel.T * np.multiply.outer(signs, signs)
    # beyond: C_zz = (1 - nu)/(mu q), and J_2m J_2n is (-1)^(m + n)/(pi q b) on average
    matrix += 2 * (1 - poisson_ratio**2) * half_width_mm / (np.pi * LAST_WAVE)
    angle = np.pi * (np.arange(64) + 0.5) / 64
    sag = body.radius_mm - np.sqrt(body.radius_mm**2 - (half_width_mm * np.cos(angle)) ** 2)
    bent = np.array([np.mean(sag * np.cos(2 * m * angle)) for m in range(TERMS)])
    flat, round_part = np.linalg.solve(matrix, np.stack([np.eye(TERMS)[0], bent], axis=1)).T
    depth = float(round_part.sum() / flat.sum())
    return depth, float(np.pi * half_width_mm * (depth * flat[0] - round_part[0]) * body.length_mm)


@lru_cache(maxsize=1)
def _waves() -> tuple[Floats, Floats, Floats]:
    """Return q b (Q,), the weights of its integral, and J_2n there (TERMS, Q)."""
    from scipy.special import jv

    x, weight = np.polynomial.legendre.leggauss(16)
    ends = np.linspace(0, np.sqrt(LAST_WAVE), PANELS + 1) ** 2  # small waves, where a thin layer varies, densely
    half = np.diff(ends)[:, None] / 2
    waves = (ends[:-1, None] + half * (x + 1)).ravel()
    return waves, (half * weight).ravel(), np.asarray(jv(2 * np.arange(TERMS)[:, None], waves))
