"""Reference pictures: the untouched gel, and balls pressed into it here and there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records import Bytes, Floats, Pair
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import Area, Flat, Grid, Singles

_AVERAGED = 16  # frames in one reference picture: the gel stands still, so one averages
_FAR = 1.2  # thicknesses over which a ball's dent dies out in a bonded layer


@dataclass(frozen=True, slots=True)
class BallPress:
    """Gel under a ball of `radius_mm` pressed by `depth_mm`.

    Inside the contact, of radius A = √(R w) (Hertz, half-space), the gel is the ball. Outside
    u/w = [(2 - ρ²) asin(1/ρ) + √(ρ² - 1)]/π with ρ = r/A, times exp(-((r - A)/1.2h)²) for the bonded layer.
    """

    radius_mm: float
    press_mm: float
    thickness_mm: float
    centre_mm: Pair

    @property
    def steep(self) -> tuple[Area, ...]:
        half = self.contact_radius_mm + 0.6
        return (Area(self.centre_mm, (half, half)),)

    @property
    def contact_radius_mm(self) -> float:
        return float(np.sqrt(self.radius_mm * self.press_mm))

    def depth_mm(self, grid: Grid) -> Singles:
        x, y = grid.places(self.centre_mm)
        return self.depth_at(np.hypot(x, y).astype(np.float64)).astype(np.float32)

    def depth_at(self, r_mm: Floats) -> Floats:
        """Depth at distances from the axis."""
        contact = self.contact_radius_mm
        inside = np.minimum(r_mm, contact)
        cap = self.press_mm - (self.radius_mm - np.sqrt(self.radius_mm**2 - inside**2))
        rim = self.press_mm - (self.radius_mm - np.sqrt(self.radius_mm**2 - contact**2))
        rho = np.maximum(r_mm / contact, 1.0)
        tail = ((2 - rho**2) * np.arcsin(1 / rho) + np.sqrt(rho**2 - 1)) * 2 / np.pi
        fade = np.exp(-((np.maximum(r_mm - contact, 0.0) / (_FAR * self.thickness_mm)) ** 2))
        return np.asarray(np.where(r_mm <= contact, cap, rim * tail * fade))

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        return Flat().shift_mm(grid)


def picture_still(camera: Camera, surface: BallPress | Flat, rng: np.random.Generator) -> Bytes:
    """A reference picture: the mean of several frames, raw geometry, uint8."""
    return camera.expose(camera.ideal(surface), rng, averaged=_AVERAGED)


def plan_balls(
    count: int, radii_mm: tuple[float, ...], half_mm: Pair, thickness_mm: float, rng: np.random.Generator
) -> tuple[BallPress, ...]:
    """Ball presses over the whole field, by a sequence that fills it evenly (R2), radii in turn."""
    start = rng.random(2)
    steps = np.array([0.7548776662466927, 0.5698402909980532])
    balls = []
    for i in range(count):
        place = ((start + i * steps) % 1.0) * 2 - 1
        radius = radii_mm[i % len(radii_mm)]
        depth = radius * rng.uniform(0.12, 0.30)
        centre = place * (np.asarray(half_mm) - 1.0 - np.sqrt(radius * depth))
        balls.append(BallPress(radius, float(depth), thickness_mm, (float(centre[0]), float(centre[1]))))
    return tuple(balls)
