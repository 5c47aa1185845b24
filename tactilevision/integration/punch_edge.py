"""The wall round one flat face: where it stands, how the surface falls along it, and what it hides of the step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactilevision.records import Floats, Pair
from tactilevision.records.taught_walls import TaughtWalls


@dataclass(frozen=True, slots=True)
class PunchEdge:
    """The wall round one flat face.

    `centre_mm` from the middle of the picture's top left pixel; `radius_mm` of the edge; `reach_mm` from the edge
    within which slopes are replaced; `places_mm`, `fall_mm` (n,): distances from the edge, and how far the
    surface lies below the face there; `depth_mm` of the face over the gel at the profile's end, about;
    `missing_mm` what the slopes as read lack of the step, `std_mm` how far the step may be off.
    """

    centre_mm: Pair
    radius_mm: float
    reach_mm: float
    places_mm: Floats
    fall_mm: Floats
    depth_mm: float
    missing_mm: float
    std_mm: float

    def taught_by(self, walls: TaughtWalls) -> PunchEdge:
        """The wall with the depth that certified faces have it hide, mm; their deviation, where it is smaller."""
        fall = float(np.interp(self.reach_mm, self.places_mm, self.fall_mm))
        if not (fall > 0 and self.missing_mm > 0):
            return self
        change, std_mm = walls.change_mm(self.missing_mm, self.depth_mm)
        return replace(
            self,
            fall_mm=self.fall_mm * ((fall + change) / fall),
            depth_mm=self.depth_mm + change,
            missing_mm=self.missing_mm + change,
            std_mm=min(self.std_mm, std_mm),
        )
