"""Gel under a flat cylinder and its bevel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records import Pair
from tactilevision.synthetic.bevel import Bevel, bevel_dent
from tactilevision.synthetic.gel import Area, Grid, Singles, lookup
from tactilevision.synthetic.profile import PunchProfile

MIN_MM = 1e-6  # of depth, below which the surface has the shape that it has there


@dataclass(frozen=True, slots=True)
class PunchPress:
    """Gel under a flat cylinder at `face_mm`, with its bevel where there is one.

    Under the face the depth is the face's plane; outside the profile beside the punch, scaled by the depth of
    the nearest point of the rim (exact without tilt). The sharp rim is rounded over `rounding_mm`, as an edge's
    radius and the ink's thickness do. Where the bevel overlaps the free surface the gel follows the bevel,
    and beside it recovers as beside a half-space's punch, (2/π) asin(1/(1 + q/ℓ)).
    """

    profile: PunchProfile
    face_mm: float
    centre_mm: Pair
    tilt: Pair = (0.0, 0.0)
    bevel: Bevel | None = None
    rounding_mm: float = 0.03

    @property
    def steep(self) -> tuple[Area, ...]:
        half = self.profile.punch_radius_mm + 1.0
        wall = Area(self.centre_mm, (half, half))
        return (
            (wall,) if self.bevel is None else (wall, self.bevel.area(self.centre_mm, (0.5, 1.0), beside_mm=0.5))
        )

    def depth_mm(self, grid: Grid) -> Singles:
        """Depth (H, W) mm on the grid."""
        depth = self._free(grid)
        if self.bevel is not None and self.face_mm > 0.5 * self.bevel.height_mm:
            part = grid.part(self.bevel.area(self.centre_mm, (2.5, 3.0), beside_mm=2.5))
            window = Grid(grid.x_mm[part[1]], grid.y_mm[part[0]])
            if depth[part].size:
                depth[part] += bevel_dent(
                    depth[part],
                    self.bevel,
                    places=window.places(self.centre_mm),
                    face_mm=self.face_mm,
                    tilt=self.tilt,
                )
        return depth

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Sideways shift (H, W) mm of the ink in x and in y."""
        x, y = grid.places(self.centre_mm)
        r = np.maximum(grid.distance(self.centre_mm), np.float32(1e-6))
        face = max(self.face_mm, 0.0)
        amount = lookup(r, self.profile.seen(face)[0], self.profile.carried(face)) / r
        return (amount * x).astype(np.float32), (amount * y).astype(np.float32)

    def _free(self, grid: Grid) -> Singles:
        r = grid.distance(self.centre_mm)
        deep = max(self.face_mm, MIN_MM)
        places, depths = self.profile.seen(deep)
        unit = lookup(r, places, depths / deep, rounding_mm=self.rounding_mm)
        face = np.full_like(r, self.face_mm)
        if self.tilt != (0.0, 0.0):
            x, y = grid.places(self.centre_mm)
            inward = np.minimum(1.0, self.profile.punch_radius_mm / np.maximum(r, np.float32(1e-6)))
            face += (np.float32(self.tilt[0]) * x + np.float32(self.tilt[1]) * y) * inward
        return np.asarray(np.maximum(face, 0.0) * unit, dtype=np.float32)
