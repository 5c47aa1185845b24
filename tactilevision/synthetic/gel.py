"""Surfaces of the gel under a body, independent of the reconstruction.

A surface gives the depth (mm, into the gel, towards the camera) and the sideways shift of the ink on a Grid of
places. z into the gel, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from scipy.special import j0

from tactilevision.records.measured import Floats, Pair

Singles = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle on the pad."""

    centre_mm: Pair
    half_mm: Pair


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Places on the pad in mm: columns `x_mm` (W,), rows `y_mm` (H,), both evenly spaced."""

    x_mm: Floats
    y_mm: Floats

    @property
    def spacing_mm(self) -> Pair:
        return float(self.x_mm[1] - self.x_mm[0]), float(self.y_mm[1] - self.y_mm[0])

    def places(self, centre_mm: Pair = (0.0, 0.0)) -> tuple[Singles, Singles]:
        """Return x, y (H, W) from a centre."""
        x, y = np.meshgrid(self.x_mm - centre_mm[0], self.y_mm - centre_mm[1])
        return x.astype(np.float32), y.astype(np.float32)

    def distance(self, centre_mm: Pair) -> Singles:
        """Return the distance (H, W) from a centre, cached."""
        return _distance(self, centre_mm)

    def part(self, area: Area) -> tuple[slice, slice]:
        """Return the rows and columns in an area; empty where it is out of the grid."""
        columns, rows = (
            slice(*np.searchsorted(along, [centre - half, centre + half]).tolist())
            for along, centre, half in zip((self.x_mm, self.y_mm), area.centre_mm, area.half_mm, strict=True)
        )
        return rows, columns

    def finer(self, part: tuple[slice, slice], times: int) -> Grid:
        """Return the grid that divides each pixel of a part `times` along either axis."""
        offsets = (np.arange(times) + 0.5) / times - 0.5
        x = (self.x_mm[part[1], None] + offsets * self.spacing_mm[0]).ravel()
        y = (self.y_mm[part[0], None] + offsets * self.spacing_mm[1]).ravel()
        return Grid(x, y)


class Surface:
    """A gel surface: the untouched gel, of which others differ in depth, steep areas and the shift of the ink."""

    @property
    def steep(self) -> tuple[Area, ...]:
        """Areas where slopes change within a pixel."""
        return ()

    def depth_mm(self, grid: Grid) -> Singles:
        """Return the depth (H, W) mm on the grid."""
        return np.zeros((grid.y_mm.size, grid.x_mm.size), np.float32)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Return the sideways shift (H, W) mm of the ink at each place in x and in y."""
        zero = np.zeros((grid.y_mm.size, grid.x_mm.size), np.float32)
        return zero, zero.copy()


@dataclass(frozen=True)
class Flat(Surface):
    """The untouched gel."""


@dataclass(frozen=True)
class Prescribed(Surface):
    """A given height map: `depth_map_mm` on `map_grid`, linear in between, nearest beyond. No sideways shift."""

    depth_map_mm: Floats
    map_grid: Grid
    steep: tuple[Area, ...] = ()

    def depth_mm(self, grid: Grid) -> Singles:
        """Return the depth (H, W) mm on the grid."""
        from scipy.ndimage import map_coordinates

        step_x, step_y = self.map_grid.spacing_mm
        rows = (grid.y_mm - self.map_grid.y_mm[0]) / step_y
        columns = (grid.x_mm - self.map_grid.x_mm[0]) / step_x
        places = np.meshgrid(rows, columns, indexing="ij")
        return np.asarray(map_coordinates(self.depth_map_mm, places, order=1, mode="nearest"), dtype=np.float32)


def smooth_step(x: Floats) -> Floats:
    """Return 3 x² - 2 x³ of x clipped to 0 to 1, of any shape."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3 - 2 * x))


@lru_cache(maxsize=16)
def _distance(grid: Grid, centre_mm: Pair) -> Singles:
    x, y = grid.places(centre_mm)
    return np.asarray(np.hypot(x, y), dtype=np.float32)


def lookup(r: Singles, places: Floats, values: Floats, *, rounding_mm: float = 0.0) -> Singles:
    """Return `values` (n,) interpolated at distances `r` (H, W) mm: constant below the first, 0 after the last."""
    step = 0.005
    even = np.arange(0.0, places[-1] + 2 * step, step)
    table = np.interp(even, places, values, left=values[0], right=0.0)
    if rounding_mm > 0:
        sigma = rounding_mm / step
        table = cv2.GaussianBlur(table[None], (0, 0), sigma, borderType=cv2.BORDER_REPLICATE).ravel()
    at = np.minimum(r * np.float32(1 / step), np.float32(even.size - 2))
    low = at.astype(np.int32)
    table = table.astype(np.float32)
    below = table[low]
    return np.asarray(below + (table[low + 1] - below) * (at - low), dtype=np.float32)


# Surface of a bonded gel layer outside a flat frictionless punch by linear theory.
#
#     u_z(r)/w = (2a/π) ∫₀^∞ K(kh) Φ(ka) J₀(kr) dk         Φ(ka) = ∫₀¹ φ(x) cos(kax) dx
#     φ + (2/π) ∫₀¹ M(x, y) φ(y) dy = 1 with 1 - K in M
#     K(u) = (2κ sinh 2u - 4u)/(2κ cosh 2u + κ² + 1 + 4u²)   κ = 3 - 4ν
#
# K is the compliance of a layer bonded to a rigid base, over a half-space's. The rim of the pad is far away.
# Source: Hayes et al., J. Biomech. 5 (1972), eqs. 20-24.

FAR = 5  # thicknesses beyond the edge at which the surface counts as untouched


def layer_surface(poisson_ratio: float, a_over_h: float, *, radii: Floats) -> Floats:
    """Return ratios u_z/w (n,) at `radii` (in thicknesses, outside the punch) by linear theory."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    x, dx = (nodes + 1) / 2, weights / 2
    u, du, K = _waves(poisson_ratio)
    phi = _punch_density(x, dx, u, (1 - K) * du, a_over_h)
    transform = np.cos(np.outer(u * a_over_h, x)) @ (phi * dx)
    missing = j0(np.outer(radii, u)) @ ((1 - K) * transform * du)
    return np.asarray(2 * a_over_h / np.pi * (_half_space(radii, a_over_h, x, phi) - missing))


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
def _waves(poisson_ratio: float) -> tuple[Floats, Floats, Floats]:
    """Return wave numbers u (per thickness) up to 25, where 1 - K vanishes, their weights, and K."""
    nodes, weights = np.polynomial.legendre.leggauss(480)
    half = 25 / 2
    u, kappa = half * (nodes + 1), 3 - 4 * poisson_ratio
    upper = 2 * kappa * np.sinh(2 * u) - 4 * u
    return u, half * weights, upper / (2 * kappa * np.cosh(2 * u) + kappa**2 + 1 + 4 * u**2)


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
    around = [layer_surface(nu, one / thickness_mm, radii=(contact_mm + reach) / thickness_mm) for one in a]
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
    g = np.array([layer_surface(nu, one / thickness_mm, radii=np.array([r / thickness_mm]))[0] for one in a])
    step = np.pi / 4 * weights * r * np.cos(angle)
    orders = 2 * np.arange(powers.shape[1]) + 1
    return np.asarray(((1 - g) * step) @ (a[:, None] / contact_mm) ** orders)
