"""Gel surface under a ball, on a bonded layer of finite thickness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import j0, j1

from tactilevision.records.measured import Floats, Pair
from tactilevision.synthetic.gel import Area, Grid, Singles, Surface, lookup, smooth_step

# Surface of a bonded gel layer outside a flat frictionless punch by linear theory.
#
#     u_z(r)/w = (2a/π) ∫₀^∞ K(kh) Φ(ka) J₀(kr) dk        u_r(r)/w = (2a/π) ∫₀^∞ K_r(kh) Φ(ka) J₁(kr) dk
#     Φ(ka) = ∫₀¹ φ(x) cos(kax) dx                         φ + (2/π) ∫₀¹ M(x, y) φ(y) dy = 1 with 1 - K in M
#
# K and K_r are solved wave by wave from Navier's equations (four exponentials, a free surface, a bonded base),
# independently of `tactilevision.mechanics`. The rim of the pad is far away.
# Source: Hayes et al., J. Biomech. 5 (1972), eqs. 20-24.

FAR = 5  # thicknesses beyond the edge at which the surface counts as untouched


def layer_surface(poisson_ratio: float, a_over_h: float, *, radii: Floats) -> tuple[Floats, Floats]:
    """Return ratios u_z/w and u_r/w (n,) at `radii` (in thicknesses, outside the punch) by linear theory."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    x, dx = (nodes + 1) / 2, weights / 2
    u, du, K, K_r, K_r_far = _waves(poisson_ratio)
    phi = _punch_density(x, dx, u, (1 - K) * du, a_over_h)
    transform = np.cos(np.outer(u * a_over_h, x)) @ (phi * dx)
    scale = 2 * a_over_h / np.pi
    depth = scale * (_half_space(radii, a_over_h, x, phi) - j0(np.outer(radii, u)) @ ((1 - K) * transform * du))
    far = K_r_far * float(phi @ dx) / radii
    shift = scale * (far + j1(np.outer(radii, u)) @ ((K_r - K_r_far) * transform * du))
    return depth, shift


def _half_space(radii: Floats, a_over_h: float, x: Floats, phi: Floats) -> Floats:
    """Return ∫₀¹ φ(x) (r² - a²x²)^(-1/2) dx, by the substitution ax = r sin θ."""
    even = np.polynomial.polynomial.Polynomial.fit(x * x, phi, 8)
    limit = np.arcsin(np.minimum(a_over_h / radii, 1.0))
    nodes, weights = np.polynomial.legendre.leggauss(32)
    angle = 0.5 * limit[:, None] * (nodes + 1)
    values = even((radii[:, None] * np.sin(angle) / a_over_h) ** 2)
    return np.asarray((values @ weights) * 0.5 * limit / a_over_h, dtype=np.float64)


def _punch_density(x: Floats, dx: Floats, u: Floats, missing: Floats, a_over_h: float) -> Floats:
    """Return φ at the nodes x from φ - (2/π) ∫ M φ = 1, M = α ∫ (1 - K) cos(αxu) cos(αyu) du."""
    waves = np.cos(np.outer(x, u) * a_over_h)
    M = a_over_h * (waves * missing) @ waves.T
    return np.asarray(np.linalg.solve(np.eye(x.size) - (2 / np.pi) * M * dx, np.ones(x.size)), dtype=np.float64)


@lru_cache(maxsize=8)
def _waves(poisson_ratio: float) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Return wave numbers (per thickness) up to 25, where 1 - K vanishes, their weights, and the kernels there."""
    nodes, weights = np.polynomial.legendre.leggauss(480)
    half = 25 / 2
    u = half * (nodes + 1)
    return (u, half * weights, *_kernels(u, poisson_ratio))


def _kernels(u: Floats, poisson_ratio: float) -> tuple[Floats, Floats, float]:
    """Return K, K_r at u = kh and K_r of the half-space: surface displacements relative to those of a half-space.

    Each wave is a sum of (U, W) = (1, 1)e^(-kz), (z + s, z)e^(-kz) and their mirror images from the base.
    """
    s = -(3 - 4 * poisson_ratio) / u
    e = np.exp(-u)
    one = np.ones_like(u)
    lame = poisson_ratio / (1 - 2 * poisson_ratio)  # λ / 2μ
    dilatation = -2 * (1 - 2 * poisson_ratio)  # of the second pair: kU + W'
    rows: list[list[Floats]] = [
        [e, (1 + s) * e, one, s],  # U at the base, h = 1
        [e, e, -one, 0 * u],  # W at the base
        [-2 * u, 1 - u * s, 2 * u * e, (-1 + u * (1 + s) + u) * e],  # U' - kW at the surface
        [-u, (lame * dilatation + 1) * one, -u * e, (lame * dilatation + 1 - u) * e],  # (λ/2μ) div + W'
    ]
    matrix = np.moveaxis(np.array(rows), 2, 0)
    load = np.zeros((u.size, 4, 1))
    load[:, 3, 0] = -0.5 / (1 - poisson_ratio)  # -p/2μ for p = E*/2, which makes uW the ratio K
    A = np.linalg.solve(matrix, load)[..., 0]
    W = A[:, 0] - A[:, 2] * e - A[:, 3] * e
    U = A[:, 0] + A[:, 1] * s + (A[:, 2] + A[:, 3] * (1 + s)) * e
    return u * W, u * U, -(1 - 2 * poisson_ratio) / (2 * (1 - poisson_ratio))


# Gel under a ball on a layer of finite thickness. The contact is a superposition of flat punches whose radii a
# grow from 0 to the contact radius A (Mossakovskii):
#
#     u(r) = ∫₀ᴬ g(r; a) w'(a) da,   g(r; a) = 1 for r < a, else the surface outside a flat punch of radius a
#
# Inside, u is the ball, which determines w'(a) = Σ c_k a^(2k+1); its integral is the depth. On a half-space
# w = (A/2) ln((R + A)/(R - A)), about A²/R. Frictionless linear theory; the ink does not move sideways.
# Source: Mossakovskii, J. Appl. Math. Mech. 27 (1963); Sneddon, Int. J. Eng. Sci. 3 (1965).

_TERMS = 5  # odd powers of a, see above


@dataclass(frozen=True)
class BallPress(Surface):
    """A ball of `radius_mm` with a contact circle of `contact_radius_mm` on a layer of `poisson_ratio`."""

    radius_mm: float
    contact_radius_mm: float
    thickness_mm: float
    poisson_ratio: float
    centre_mm: Pair

    @property
    def press_mm(self) -> float:
        """Depth of the ball's lowest point."""
        return _surface(self.radius_mm, self.contact_radius_mm, self.thickness_mm, self.poisson_ratio)[0]

    @property
    def steep(self) -> tuple[Area, ...]:
        half = self.contact_radius_mm + 0.6
        return (Area(self.centre_mm, (half, half)),)

    def depth_mm(self, grid: Grid) -> Singles:
        """Return the depth (H, W) mm on the grid."""
        return lookup(grid.distance(self.centre_mm), *self.section())

    def section(self) -> tuple[Floats, Floats]:
        """Return distances (N,) mm from the axis and the depth (N,) mm there."""
        press, outside, depth = _surface(
            self.radius_mm, self.contact_radius_mm, self.thickness_mm, self.poisson_ratio
        )
        inside = np.linspace(0.0, self.contact_radius_mm, 200, endpoint=False)
        cap = press - self.radius_mm + np.sqrt(self.radius_mm**2 - inside**2)
        return np.concatenate([inside, outside]), np.concatenate([cap, depth])


@lru_cache(maxsize=64)
def _surface(radius_mm: float, contact_mm: float, thickness_mm: float, nu: float) -> tuple[float, Floats, Floats]:
    """Return the depth of the ball, places outside the contact, and the depth there."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    a, da = contact_mm * (nodes + 1) / 2, contact_mm * weights / 2
    powers = (a[:, None] / contact_mm) ** (2 * np.arange(_TERMS) + 1)
    inside = contact_mm * np.linspace(0.1, 1, 10)
    sunk = np.array([_below(r, powers, contact_mm, thickness_mm, nu) for r in inside])
    ball = radius_mm - np.sqrt(radius_mm**2 - inside**2)
    terms = np.linalg.lstsq(sunk, ball, rcond=None)[0]
    spread = powers @ terms * da
    reach = np.linspace(0.0, 1.0, 90) ** 2 * FAR * thickness_mm
    around = [layer_surface(nu, one / thickness_mm, radii=(contact_mm + reach) / thickness_mm)[0] for one in a]
    return (
        float(spread.sum()),
        contact_mm + reach,
        smooth_step((FAR - reach / thickness_mm) / 2) * (spread @ np.array(around)),
    )


def _below(r: float, powers: Floats, contact_mm: float, thickness_mm: float, nu: float) -> Floats:
    """Return ∫₀ʳ (1 - g(r; a)) (a/A)^(2k+1) da for each k, by the substitution a = r sin θ."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    angle = np.pi / 4 * (nodes + 1)
    a = r * np.sin(angle)
    g = np.array([layer_surface(nu, one / thickness_mm, radii=np.array([r / thickness_mm]))[0][0] for one in a])
    step = np.pi / 4 * weights * r * np.cos(angle)
    orders = 2 * np.arange(powers.shape[1]) + 1
    return np.asarray(((1 - g) * step) @ (a[:, None] / contact_mm) ** orders)
