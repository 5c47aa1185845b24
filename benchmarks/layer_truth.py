"""Surface compliance of a bonded layer by finite elements over its thickness: no code of the library.

For one wave number k along L, u_L = i a(z) exp(i k L), u_z = b(z) exp(i k L), across it u_T = c(z) exp(i k L), and

    energy = Int lambda/2 (b' - k a)^2 + mu (k^2 a^2 + b'^2) + mu/2 (a' + k b)^2 + mu/2 (c'^2 + k^2 c^2) dz,

solved with elements of Legendre polynomials that are graded towards the face; waves short against the thickness
move as on a half-space (Johnson, Contact Mechanics, 1985, chapter 3).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import CubicSpline

from tactilevision.records.measured import Floats

ORDER = 8
EDGES = np.array([0.0, 0.02, 0.06, 0.15, 0.35, 0.65, 1.0])  # of the thickness
SHORT, COUNT = 40.0, 240  # k h beyond which a layer is a half-space; wave numbers of the table


def surface_compliance(k_x: Floats, k_y: Floats, *, modulus: float, nu: float, thickness: float) -> Floats:
    """Return (ky, kx, 3, 3), complex: displacement by traction of each wave, mm/MPa."""
    k = np.hypot(k_x, k_y)
    along, normal, coupling, across = _by_wave(np.maximum(k * thickness, 1e-3), nu)
    scale = thickness / (modulus / (2 * (1 + nu)))
    turn = np.arctan2(*np.broadcast_arrays(k_y, k_x))
    cos, sin = np.cos(turn), np.sin(turn)
    found = np.empty((*k.shape, 3, 3), dtype=complex)
    found[..., 0, 0] = along * cos**2 + across * sin**2
    found[..., 1, 1] = along * sin**2 + across * cos**2
    found[..., 0, 1] = found[..., 1, 0] = (along - across) * cos * sin
    found[..., 0, 2], found[..., 1, 2] = 1j * coupling * cos, 1j * coupling * sin
    found[..., 2, 0], found[..., 2, 1] = -found[..., 0, 2], -found[..., 1, 2]
    found[..., 2, 2] = normal
    return scale * found


def _by_wave(q: Floats, nu: float) -> Floats:
    """Return (4, ...): compliance along the wave, normal, of one by the other, and across, times mu/h, at k h."""
    at, values = _table(nu)
    inside = CubicSpline(np.log(at), values * at, axis=1)(np.log(np.minimum(q, SHORT))) / np.minimum(q, SHORT)
    far = np.array([1 - nu, 1 - nu, 0.5 - nu, 1.0])
    return np.where(q > SHORT, far.reshape(-1, *[1] * q.ndim) / q, inside)


@cache
def _table(nu: float) -> tuple[Floats, Floats]:
    q = np.geomspace(1e-3, SHORT, COUNT)
    mass, slope, mixed = _matrices()
    lame = 2 * nu / (1 - 2 * nu)  # over mu
    n, found = len(mass), np.empty((4, COUNT))
    for at, k in enumerate(q):
        stiff = np.zeros((2 * n, 2 * n))
        stiff[:n, :n] = (lame + 2) * k**2 * mass + slope
        stiff[n:, n:] = (lame + 2) * slope + k**2 * mass
        stiff[:n, n:] = -lame * k * mixed + k * mixed.T  # mixed[i, j] = Int phi_i phi_j'
        stiff[n:, :n] = stiff[:n, n:].T
        moved = np.linalg.solve(stiff, np.eye(2 * n)[:, [0, n]])
        across = np.linalg.solve(slope + k**2 * mass, np.eye(n)[:, 0])
        found[:, at] = moved[0, 0], moved[n, 1], moved[0, 1], across[0]
    return q, found


@cache
def _matrices() -> tuple[Floats, Floats, Floats]:
    """Return Int phi_i phi_j, Int phi_i' phi_j', Int phi_i phi_j' over [0, 1]; phi_0 alone is 1 at the face."""
    points, weights = legendre.leggauss(ORDER + 2)
    basis = [(1 - points) / 2, (1 + points) / 2]
    slopes = [np.full_like(points, -0.5), np.full_like(points, 0.5)]
    for p in range(2, ORDER + 1):
        bubble = legendre.Legendre.basis(p) - legendre.Legendre.basis(p - 2)
        basis.append(bubble(points))
        slopes.append(bubble.deriv()(points))
    f, g, elements = np.array(basis), np.array(slopes), len(EDGES) - 1
    size = elements + 1 + elements * (ORDER - 1)
    mass, slope, mixed = np.zeros((3, size, size))
    for e, width in enumerate(np.diff(EDGES)):
        own = [e, e + 1, *range(elements + 1 + e * (ORDER - 1), elements + 1 + (e + 1) * (ORDER - 1))]
        w, place = weights * width / 2, np.ix_(own, own)
        mass[place] += (f * w) @ f.T
        slope[place] += (g * w) @ g.T * (2 / width) ** 2
        mixed[place] += (f * w) @ g.T * (2 / width)
    free = np.delete(np.arange(size), elements)  # the base is held
    places = np.ix_(free, free)
    return mass[places], slope[places], mixed[places]
