"""Gel under a flat ring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records import Pair
from tactilevision.synthetic.gel import Area, Flat, Grid, Singles, lookup
from tactilevision.synthetic.profile import punch_profile


@dataclass(frozen=True, slots=True)
class RingPress:
    """A flat ring between two radii, pressed by `face_mm`.

    Outside it the gel lies as beside a full punch of the outer radius r₂; in the hole of radius r₁ it bulges,
    u/w = 1 - κ √(1 - (r/r₁)²), κ = 1 - exp(-r₁/h): the middle of a hole far wider than the layer is untouched.
    A picture of a shape with known edges, not a solution of the contact problem.
    """

    inner_mm: float
    outer_mm: float
    face_mm: float
    thickness_mm: float
    poisson_ratio: float
    centre_mm: Pair
    rounding_mm: float = 0.03

    @property
    def steep(self) -> tuple[Area, ...]:
        half = self.outer_mm + 1.0
        return (Area(self.centre_mm, (half, half)),)

    def depth_mm(self, grid: Grid) -> Singles:
        """Depth (H, W) mm on the grid."""
        full_punch = punch_profile(self.poisson_ratio, self.outer_mm, self.thickness_mm)
        places, depths = full_punch.seen(self.face_mm)
        recovery = 1 - np.exp(-self.inner_mm / self.thickness_mm)
        hole = np.linspace(0.0, self.inner_mm, 200)
        floor = self.face_mm * (1 - recovery * np.sqrt(np.maximum(1 - (hole / self.inner_mm) ** 2, 0.0)))
        all_places, all_depths = np.concatenate([hole, places]), np.concatenate([floor, depths])
        return lookup(grid.distance(self.centre_mm), all_places, all_depths, rounding_mm=self.rounding_mm)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Sideways shift (H, W) mm of the ink in x and in y."""
        return Flat().shift_mm(grid)
