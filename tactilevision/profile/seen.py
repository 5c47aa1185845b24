"""What a calibrated sensor says of a frame, and of many at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools, Floats, Footprint, HeightMap, TractionMap, Wrench

Singles = npt.NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame.

    `height` is the map; `contact` (H, W) where something presses; `footprint` the face of the indenter that is
    looked for, None without one; `tractions` None where E and nu are not known, or the force was not solved.
    `flags` say what makes the frame doubtful: those of the map, then those of the force, in words.
    """

    height: HeightMap
    contact: Bools
    footprint: Footprint | None
    tractions: TractionMap | None
    flags: tuple[str, ...]

    @property
    def std(self) -> Singles | None:
        """Standard deviation (H, W) of the depth, mm; None where the method states none."""
        return self.height.std_mm

    @property
    def wrench(self) -> Wrench | None:
        """Force (N) and moment (N mm) with their deviations; None where no force is known."""
        return None if self.tractions is None else self.tractions.wrench


@dataclass(frozen=True, slots=True)
class SeenBatch:
    """N frames: what `Seen` has, stacked; `frames` has each by itself.

    `height` (N, H, W) depth in mm, NaN where it is not known; `std` alike; `contact` (N, H, W); `tractions`
    (N, 3, rows, columns) MPa along x, y, z and `wrench` (N, 6), N and N mm, NaN where they are not known.
    """

    frames: tuple[Seen, ...]

    @property
    def height(self) -> Singles:
        """Depth (N, H, W), mm."""
        return np.stack([np.where(one.height.valid, one.height.depth_mm, np.nan) for one in self.frames])

    @property
    def std(self) -> Singles:
        """Standard deviation (N, H, W) of the depth, mm."""
        unknown = np.full(self.frames[0].contact.shape, np.nan, np.float32)
        return np.stack([unknown if one.std is None else one.std for one in self.frames])

    @property
    def contact(self) -> Bools:
        """Mask (N, H, W) of where something presses."""
        return np.stack([one.contact for one in self.frames])

    @property
    def footprint(self) -> tuple[Footprint | None, ...]:
        """The face in each frame."""
        return tuple(one.footprint for one in self.frames)

    @property
    def tractions(self) -> Floats | None:
        """Tractions (N, 3, rows, columns), MPa; None where no frame has any."""
        known = [one.tractions for one in self.frames]
        shape = next(((3, *one.t_z.shape) for one in known if one is not None), None)
        if shape is None:
            return None
        unknown = np.full(shape, np.nan)
        return np.stack([unknown if one is None else np.stack([one.t_x, one.t_y, one.t_z]) for one in known])

    @property
    def wrench(self) -> Floats:
        """Force and moment (N, 6), N and N mm."""
        wrenches = [one.wrench for one in self.frames]
        return np.array([_UNKNOWN if one is None else (*one.force_N, *one.moment_Nmm) for one in wrenches])

    @property
    def flags(self) -> Sequence[tuple[str, ...]]:
        """What makes each frame doubtful."""
        return tuple(one.flags for one in self.frames)


_UNKNOWN = (float("nan"),) * 6  # N and N mm: a wrench that is not known
