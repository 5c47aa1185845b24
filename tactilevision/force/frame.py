"""One frame of a recording into forces: depth, then, where something touches, shear, then tractions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tactilevision.batch.jobs import Row
from tactilevision.certificate.depth.face_depth import NO_CORRECTION, FaceDepthCorrection
from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.door.numbers import read_cells
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.force.calibrated import Sensitivity, material_sensitivity
from tactilevision.force.field import NO_CONTACT, ForceField
from tactilevision.force.store import FIELDS, TractionStore
from tactilevision.reconstruct import Reconstructor
from tactilevision.recording import BadFrame
from tactilevision.records import Frame, HeightMap, ShearMap, TractionMap
from tactilevision.records.flags import BEYOND_BALLS, MEANING, add
from tactilevision.shear.measure import NOTHING_TO_FOLLOW, Untouched

NO_REFERENCE = "no picture of the untouched gel to follow it from"
NOTHING = (float("nan"),) * 3  # N: a force that is not known
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class FrameForce:
    """What one frame says, or `why` it says nothing; `flags` in words.

    `depth_mm` is the greatest depth of what touches, `place_mm` the middle of the pressure on the pad,
    `measured_N` the F/T sensor's force at the time; NaN where not known. `reading_clipped`: in its press the F/T
    sensor stood at its end.
    """

    frame: str
    time_s: float
    resultant_N: Triple = NOTHING
    resultant_std_N: Triple = NOTHING
    moment_Nmm: Triple = NOTHING
    depth_mm: float = float("nan")
    place_mm: tuple[float, float] = NOTHING[:2]
    flags: str = ""
    why: str = ""
    measured_N: Triple = NOTHING
    press: str = ""
    reading_clipped: bool = False

    @property
    def read(self) -> bool:
        """Whether there is a force, be it none at all."""
        return not self.why

    def as_row(self) -> Row:
        """As text, every digit kept, without what is put beside it later."""
        numbers = (
            self.time_s,
            *self.resultant_N,
            *self.resultant_std_N,
            *self.moment_Nmm,
            self.depth_mm,
            *self.place_mm,
        )
        return (self.frame, *(repr(float(number)) for number in numbers), self.flags, self.why)

    @classmethod
    def of(cls, row: Row) -> Self:
        """From its row of text. Raises InputError where a cell is no number."""
        n = read_cells(row[1:14], where=row[0])
        return cls(row[0], n[0], (n[1], n[2], n[3]), (n[4], n[5], n[6]), (n[7], n[8], n[9]), n[10], (n[11], n[12]),
                   row[14], row[15])  # fmt: skip


@dataclass(frozen=True, slots=True)
class Solved:
    """One frame with all that was made of it, for a drawing."""

    height: HeightMap
    shear: ShearMap | None
    found: TractionMap


@dataclass(frozen=True)
class ForceJob:
    """Frames into forces (streaming.Job). Not thread-safe, as the reconstructor is not.

    `untouched` None: no reference, so that fx and fy stay unknown. `anchor` puts certified faces where they were.
    Frames in which nothing touches cost no shear.
    """

    field: ForceField
    reconstructor: Reconstructor
    untouched: Untouched | None
    store: TractionStore
    columns: int = 16
    anchor: FaceDepthCorrection = NO_CORRECTION

    def __call__(self, frame: Frame | BadFrame, number: int) -> Row:
        """Keep the tractions; the row holds the resultant, or why there is none."""
        if isinstance(frame, BadFrame):
            return FrameForce(frame.name, frame.time_s, why=f"unreadable: {frame.why}").as_row()
        try:
            found = self.solve(frame).found
        except InputError as fault:
            return FrameForce(frame.name, frame.time_s, why=f"rejected: {fault.what}").as_row()
        except ConvergenceError as fault:
            return FrameForce(frame.name, frame.time_s, why=f"not solved: {fault}").as_row()
        self.store.write(number, {name: getattr(found, name).astype(np.float32) for name in FIELDS})
        return as_force(found, frame).as_row()

    def solve(self, frame: Frame) -> Solved:
        """Raises InputError for a frame that cannot be read, ConvergenceError where the contact never settles."""
        solved = self._solved(frame, self.reconstructor.height_map(frame))
        doubts = tuple(MEANING[flag] for flag in add(solved.height.flags, self._beyond_balls(solved.height)))
        return replace(solved, found=replace(solved.found, flags=(*solved.found.flags, *doubts)))

    def _beyond_balls(self, height: HeightMap) -> tuple[str, ...]:
        """The flag of a contact whose depth is extrapolated; what a border cuts, the field says itself."""
        if not self.field.touched(height):
            return ()
        error = self.reconstructor.error
        return tuple(flag for flag in contact_flags(find_contact(height, error), error) if flag == BEYOND_BALLS)

    def _solved(self, frame: Frame, height: HeightMap) -> Solved:
        if not self.field.touched(height):
            return self._without_shear(height, "")
        height = self.anchor(height)
        if self.untouched is None or not self.untouched.shows:
            return self._without_shear(height, NO_REFERENCE if self.untouched is None else NOTHING_TO_FOLLOW)
        shear = self.untouched.shear(self.reconstructor.rectified(frame))
        return Solved(height, shear, self.field(height, shear))

    def sensitivity(self, solved: Solved) -> tuple[Sensitivity, ...]:
        """What the material's own 95 % interval does to the force; nothing where it states none."""
        if self.field.material.covariance is None:
            return ()
        return material_sensitivity(self.field, solved.found, solved.height, solved.shear)

    def _without_shear(self, height: HeightMap, why: str) -> Solved:
        found = self.field(height)
        flags = tuple(dict.fromkeys((*found.flags, why))) if why else found.flags
        return Solved(height, None, replace(found, flags=flags))

    def kept(self, row: Row) -> bool:
        """Whether the store that holds the frame's tractions is there."""
        FrameForce.of(row)
        return bool(row[15]) or self.store.exists()


def as_force(found: TractionMap, frame: Frame) -> FrameForce:
    """The numbers of a map of tractions."""
    pressure = np.maximum(np.nan_to_num(found.t_z), 0)
    total = float(pressure.sum())
    place = NOTHING[:2]
    if total > 0:
        rows, columns = np.indices(pressure.shape)
        step_x, step_y = found.mm_per_px
        place = (
            found.first_mm[0] + step_x * float((columns * pressure).sum()) / total,
            found.first_mm[1] + step_y * float((rows * pressure).sum()) / total,
        )
    return FrameForce(frame.name, frame.time_s, found.resultant_N, found.resultant_std_N,
                      found.moment_Nmm or NOTHING, found.depth_mm, place, "; ".join(found.flags))  # fmt: skip


def nothing_touches(row: FrameForce) -> bool:
    """Whether the frame was read and shows a gel that is free."""
    return row.read and NO_CONTACT in row.flags
