"""Gel under a ball, on a layer of finite thickness.

A ball's contact is a pile of flat punches whose radii a grow from 0 to the contact's radius A (Mossakovskii):

    u(r) = ∫₀ᴬ g(r; a) w'(a) da,   g(r; a) = 1 for r < a, else the surface beside a flat punch of radius a

Inside, u is the ball itself, which fixes w'(a) = Σ c_k a^(2k+1); its integral is the depth. On a half-space this
gives w = (A/2) ln((R + A)/(R - A)), about A²/R. Frictionless linear theory; the ink is taken not to move sideways.
Source: Mossakovskii, J. Appl. Math. Mech. 27 (1963); Sneddon, Int. J. Eng. Sci. 3 (1965).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactilevision.records import Floats, Pair
from tactilevision.synthetic.gel import Area, Flat, Grid, Singles, lookup
from tactilevision.synthetic.layer import FAR, fade, layer_surface

_TERMS = 5  # odd powers of a, see above


@dataclass(frozen=True, slots=True)
class BallPress:
    """A ball of `radius_mm` whose contact circle has `contact_radius_mm`, on the layer of `poisson_ratio`."""

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
        """Depth (H, W) mm on the grid."""
        return lookup(grid.distance(self.centre_mm), *self.section())

    def section(self) -> tuple[Floats, Floats]:
        """Distances (N,) mm from the axis and the depth (N,) mm there."""
        press, outside, depth = _surface(
            self.radius_mm, self.contact_radius_mm, self.thickness_mm, self.poisson_ratio
        )
        inside = np.linspace(0.0, self.contact_radius_mm, 200, endpoint=False)
        cap = press - self.radius_mm + np.sqrt(self.radius_mm**2 - inside**2)
        return np.concatenate([inside, outside]), np.concatenate([cap, depth])

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Sideways shift (H, W) mm of the ink in x and in y."""
        return Flat().shift_mm(grid)


@lru_cache(maxsize=64)
def _surface(radius_mm: float, contact_mm: float, thickness_mm: float, nu: float) -> tuple[float, Floats, Floats]:
    """Depth of the ball, and places outside the contact with the depth there."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    a, da = contact_mm * (nodes + 1) / 2, contact_mm * weights / 2
    powers = (a[:, None] / contact_mm) ** (2 * np.arange(_TERMS) + 1)
    # a tenth of the contact radius per step is enough for five even powers
    inside = contact_mm * np.linspace(0.1, 1.0, 10)
    sunk = np.array([_below(r, powers, contact_mm, thickness_mm, nu) for r in inside])
    ball = radius_mm - np.sqrt(radius_mm**2 - inside**2)
    terms = np.linalg.lstsq(sunk, ball, rcond=None)[0]
    spread = powers @ terms * da
    reach = np.linspace(0.0, 1.0, 90) ** 2 * FAR * thickness_mm
    around = [layer_surface(nu, one / thickness_mm, radii=(contact_mm + reach) / thickness_mm)[0] for one in a]
    return float(spread.sum()), contact_mm + reach, fade(reach / thickness_mm) * (spread @ np.array(around))


def _below(r: float, powers: Floats, contact_mm: float, thickness_mm: float, nu: float) -> Floats:
    """∫₀ʳ (1 - g(r; a)) (a/A)^(2k+1) da for each k; with a = r sin θ the root at a = r is gone."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    angle = np.pi / 4 * (nodes + 1)
    a = r * np.sin(angle)
    g = np.array([layer_surface(nu, one / thickness_mm, radii=np.array([r / thickness_mm]))[0][0] for one in a])
    step = np.pi / 4 * weights * r * np.cos(angle)
    orders = 2 * np.arange(powers.shape[1]) + 1
    return np.asarray(((1 - g) * step) @ (a[:, None] / contact_mm) ** orders)
