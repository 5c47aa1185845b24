"""The wall round one flat face: where it stands, how the surface falls along it, and what it hides of the step.

And what walls of one sensor's pictures are found by.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactilevision.records import Floats, Pair
from tactilevision.records.taught_walls import TaughtWalls

LEAN = 2.1  # 1/tan of 25 degrees: lamps of these sensors stand at 15 to 35
GENTLER = 0.5  # of the limit, from which walls are told where nothing of them is steeper than it
LEAST_MM = 1e-6  # mm: smaller changes of depth are carried as this one


@dataclass(frozen=True, slots=True)
class WallLaw:
    """How walls are found: `limit` is the steepest slope that is read reliably; infinite, and there are none.

    `lean` of the lamps: 1/tan of their mean elevation. Not `strict`: also walls that the slopes outside do not
    keep to, of a picture whose shadows are half undone. `taught` by certified faces of the sensor.
    """

    limit: float
    lean: float = LEAN
    strict: bool = True
    taught: TaughtWalls | None = None

    @property
    def gentlest(self) -> float:
        """The slope that a wall shows somewhere, at least: a camera blurs even a steep one that is narrow.

        Where shadows may be left these look like such walls, and only what is steeper than the limit is told.
        """
        return self.limit if self.strict else GENTLER * self.limit


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

    @property
    def fall_at_reach_mm(self) -> float:
        """How far the surface lies below the face where slopes are read again."""
        return float(np.interp(self.reach_mm, self.places_mm, self.fall_mm))

    @property
    def teachable(self) -> bool:
        """Whether it falls, and by more than the slopes as read: others stay as they are."""
        return self.fall_at_reach_mm > 0 and self.missing_mm > 0

    def carried(self, change_mm: float) -> Floats:
        """Part (n,) of a change of the face's depth at each of `places_mm`: 1 on it, 0 where slopes are read.

        It lies where the wall is steepest, over the slope T that leaves as much above it,

            |change| = int max(u' - T, 0) ds

        so that no wall overhangs that falls by more. What faces are off by lies there, less than .1 mm from the
        edge (docs/evidence/rendered.md); from there on the law is held by slopes that are read.
        """
        fall = np.interp(np.minimum(self.places_mm, self.reach_mm), self.places_mm, self.fall_mm)
        steps = np.maximum(np.diff(fall), 0.0)  # u' ds of even places
        sorted_steps = np.append(np.sort(steps)[::-1], 0.0)
        above = np.cumsum(sorted_steps) - sorted_steps * np.arange(1, sorted_steps.size + 1)
        over = np.maximum(steps - np.interp(max(abs(change_mm), LEAST_MM), above, sorted_steps), 0.0)
        return np.append(1.0, 1.0 - np.cumsum(over) / over.sum())

    def taught_by(self, walls: TaughtWalls) -> PunchEdge:
        """The wall with the depth that certified faces have it hide, mm; their deviation, where it is smaller."""
        if not self.teachable:
            return self
        change, std_mm = walls.change_mm(self.missing_mm, self.depth_mm)
        return replace(
            self,
            fall_mm=self.fall_mm + change * (1.0 - self.carried(change)),
            depth_mm=self.depth_mm + change,
            missing_mm=self.missing_mm + change,
            std_mm=min(self.std_mm, std_mm),
        )
