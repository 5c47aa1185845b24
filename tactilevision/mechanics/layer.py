"""The surface of an elastic layer bonded to a rigid base, wave by wave: displacement = C(k) traction.

A traction t exp(i (kx x + ky y)) on the layer's free face, z into the gel, moves the face by C t exp(i ...), where

    C = [[C_LL, i c], [-i c, C_zz]]  along (k/|k|, z),        C_T  across k in the face,
    C_zz = (1 - nu)/(mu q) (2 k sinh 2u - 4u)/D,    C_LL = (1 - nu)/(mu q) (2 k sinh 2u + 4u)/D,
    c    = (1/(2 mu q)) (2 k (1 - 2 nu)(cosh 2u - 1) - 4u^2)/D,                C_T = tanh(u)/(mu q),
    D = 2k cosh 2u + 4u^2 + 1 + k^2,   k = 3 - 4 nu,   q = |k| (1/mm),   u = q h,   mu = E/(2 (1 + nu)).

C is Hermitian (reciprocity) and positive definite. Limits: q -> 0: C_zz = h/M with the constrained modulus M
(it vanishes at nu = .5), C_LL = C_T = h/mu, c = 0. q -> inf: the half-space of Boussinesq and Cerruti,
(1 - nu)/(mu q) for C_zz and C_LL, (1 - 2 nu)/(2 mu q) for c, 1/(mu q) for C_T. Small strain; the layer reaches far
beyond the contact. nu in [0, .5], any q >= 0; InputError outside.

Source: the plane-strain layer in Papkovich-Neuber form; C_zz is Hayes et al. (1972), eq. 13; the half-space is
Johnson, Contact Mechanics (1985), sections 3.2 and 3.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_equation import POISSON_RANGE, check_within, positive
from tactilevision.records.measured import Floats

SERIES_BELOW = 0.05  # u, below which sinh(2u) - 2u is a series: the truncation error is below 1e-13


@dataclass(frozen=True, slots=True)
class LayerCompliance:
    """The four independent entries of C in units of h/mu, each of the shape of u; `coupling` is c."""

    normal: Floats
    along: Floats
    across: Floats
    coupling: Floats


def layer_compliance(u: npt.ArrayLike, poisson_ratio: float) -> LayerCompliance:
    """Return C_zz, C_LL, C_T and c in units of h/mu at u = q h >= 0 (any shape).

    Exact at u = 0 and at nu = .5 too.
    """
    u = np.asarray(u, dtype=float)
    if not (u >= 0).all():
        raise InputError("a wave number lies at or above 0", where="layer_compliance", value=float(np.min(u)))
    check_within("Poisson's ratio lies in", poisson_ratio, POISSON_RANGE, where="layer_compliance")
    k, fall = 3 - 4 * poisson_ratio, np.exp(-2 * u)
    below = k * (1 + fall**2) + (4 * u**2 + 1 + k**2) * fall
    safe = np.where(u > 0, u, 1.0)
    ramp = np.where(u > 0, -np.expm1(-4 * u) / safe, 4)  # (1 - exp(-4u))/u
    share = (1 - poisson_ratio) / below
    coupling = (k * (1 - 2 * poisson_ratio) * np.expm1(-2 * u) ** 2 - 4 * u**2 * fall) / (2 * safe * below)
    return LayerCompliance(
        normal=np.asarray(share * _compression(u, k, fall, ramp)),
        along=np.asarray(share * (k * ramp + 4 * fall)),
        across=np.where(u > 0, np.tanh(u) / safe, 1.0),
        coupling=np.asarray(coupling),
    )


def surface_compliance(
    kx_per_mm: npt.ArrayLike,
    ky_per_mm: npt.ArrayLike,
    *,
    youngs_modulus_MPa: float,
    poisson_ratio: float,
    thickness_mm: float,
) -> npt.NDArray[np.complex128]:
    """Return C (..., 3, 3) in mm/MPa for wave numbers of the common shape (...): u_i = C_ij t_j, i and j over x,
    y, z.

    Waves are exp(+i k x), the convention of numpy.fft.ifft. At k = 0 the direction does not matter: C is diagonal.
    """
    kx, ky = np.broadcast_arrays(np.asarray(kx_per_mm, dtype=float), np.asarray(ky_per_mm, dtype=float))
    thickness = float(positive("thickness_mm", thickness_mm))
    q = np.hypot(kx, ky)
    cosine = np.divide(kx, q, out=np.ones_like(q), where=q > 0)
    sine = np.divide(ky, q, out=np.zeros_like(q), where=q > 0)
    part = layer_compliance(q * thickness, poisson_ratio)
    compliance = np.empty((*q.shape, 3, 3), dtype=np.complex128)
    compliance[..., 0, 0] = part.along * cosine**2 + part.across * sine**2
    compliance[..., 1, 1] = part.along * sine**2 + part.across * cosine**2
    compliance[..., 0, 1] = compliance[..., 1, 0] = (part.along - part.across) * cosine * sine
    compliance[..., 2, 2] = part.normal
    compliance[..., 0, 2], compliance[..., 1, 2] = 1j * part.coupling * cosine, 1j * part.coupling * sine
    compliance[..., 2, 0], compliance[..., 2, 1] = -1j * part.coupling * cosine, -1j * part.coupling * sine
    compliance *= 2 * (1 + poisson_ratio) * thickness / float(positive("youngs_modulus_MPa", youngs_modulus_MPa))
    return compliance


def _compression(u: Floats, k: float, fall: Floats, ramp: Floats) -> Floats:
    """Return (2k sinh 2u - 4u) exp(-2u)/u.

    For small u, where the terms cancel at k = 1, from the series of sinh.
    """
    y = 2 * np.minimum(u, SERIES_BELOW)
    excess = y**2 / 3 * (1 + y**2 / 20 * (1 + y**2 / 42 * (1 + y**2 / 72)))
    return np.asarray(np.where(u < SERIES_BELOW, fall * (4 * (k - 1) + 2 * k * excess), k * ramp - 4 * fall))
