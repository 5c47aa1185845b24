"""Convert a frame of a recording to tractions, and store the tractions of many frames."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.ndimage import center_of_mass

from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.files.writing import output_errors, replacing
from tactilevision.files.zarr_store import begin_frames, end_frames, settle, write_frame
from tactilevision.force.field import NO_CONTACT, ForceField, Triple
from tactilevision.force.nodes import NodeGrid
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.press.certified_faces import NO_CORRECTION, FaceDepthCorrection
from tactilevision.recording.model import BadFrame
from tactilevision.records.maps import BEYOND_BALLS, MEANING, Frame, HeightMap, ShearMap, TractionMap, add
from tactilevision.shear.displacement import NOTHING_TO_FOLLOW, Untouched

# Tractions of many frames on disk, written by many processes a frame at a time, then moved to their place.
#
# tractions.npz     good frames: frame (N,) names, t_x, t_y, t_z (N, rows, columns) float32 in MPa, mm_per_px,
#                   first_mm
# tractions.zarr    all frames, NaN for a frame without tractions: the same fields; scale and place as attributes

FIELDS = ("t_x", "t_y", "t_z")
Form = Literal["npz", "zarr"]


@dataclass(frozen=True, slots=True)
class TractionStore:
    """Store of tractions `out`/tractions.FORM, written to a scratch next to it first."""

    out: Path
    form: Form
    grid: NodeGrid

    @property
    def path(self) -> Path:
        """The finished store."""
        return self.out / f"tractions.{self.form}"

    @property
    def scratch(self) -> Path:
        """The store that is being filled."""
        return self.out / f".tractions.{self.form}-unfinished"

    def prepare(self, frames: Sequence[str], *, anew: bool) -> None:
        """Clean up after killed runs, also those in the other form, and make an empty scratch where `anew`."""
        if self.form == "zarr":
            settle(self.path)
            replace(self, form="npz").scratch.unlink(missing_ok=True)
            if anew:
                units = dict.fromkeys(FIELDS, "MPa")
                begin_frames(self.scratch, frames, fields=units, shape=self.grid.shape, about=self._about())
            return
        shutil.rmtree(replace(self, form="zarr").scratch, ignore_errors=True)
        if anew:
            shape = (len(frames), len(FIELDS), *self.grid.shape)
            with output_errors(self.scratch):
                np.lib.format.open_memmap(self.scratch, mode="w+", dtype=np.float32, shape=shape).flush()
                if hasattr(
                    os, "posix_fallocate"
                ):  # a full disk raises here instead of killing a worker by a signal
                    with self.scratch.open("r+b") as file:
                        os.posix_fallocate(file.fileno(), 0, self.scratch.stat().st_size)

    def write(self, number: int, found: TractionMap) -> None:
        """Write one frame's tractions."""
        fields = {name: getattr(found, name).astype(np.float32) for name in FIELDS}
        if self.form == "zarr":
            write_frame(self.scratch, number, fields=fields)
            return
        stack = np.lib.format.open_memmap(self.scratch, mode="r+")
        stack[number] = np.stack(list(fields.values()))
        stack.flush()

    def end(self, frames: Sequence[str], good: Sequence[int]) -> None:
        """Put the store in place; `good` are the numbers of the frames that have tractions."""
        if self.form == "zarr":
            end_frames(self.scratch, self.path)
            return
        every = np.lib.format.open_memmap(self.scratch, mode="r")
        kept = every if len(good) == len(frames) else every[good]
        arrays = {name: kept[:, part] for part, name in enumerate(FIELDS)} | self._about()
        names = np.array([frames[number] for number in good], dtype=np.str_)
        with replacing(self.path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, frame=names, **arrays)
        self.scratch.unlink()

    def _about(self) -> dict[str, Any]:
        step = self.grid.spacing_mm
        return {"mm_per_px": [step, step], "first_mm": [float(self.grid.x_mm[0]), float(self.grid.y_mm[0])]}


NO_REFERENCE = "no picture of the untouched gel to follow it from"
NOTHING = (float("nan"),) * 3  # N: a force that is not known
JOURNAL = ".force-journal"


@dataclass(frozen=True, slots=True)
class FrameForce:
    """The force of one frame, or `why` there is none; `flags` in words.

    `depth_mm` is the greatest depth of the contact, `place_mm` the centre of pressure on the pad, `measured_N` the
    F/T sensor's force at the time; NaN: unknown. `reading_clipped`: the F/T sensor was at the end of its range in
    the press.
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
        """Whether there is a force, also 0."""
        return not self.why


@dataclass(frozen=True, slots=True)
class Solved:
    """Maps of one frame, for a plot."""

    height: HeightMap
    shear: ShearMap | None
    found: TractionMap


@dataclass(frozen=True)
class ForceJob:
    """Job that computes the forces of frames.

    `untouched` None: no reference, so fx and fy are unknown. `anchor` corrects the depth of certified faces. Shear
    is computed only for frames with contact.
    """

    field: ForceField
    reconstructor: Reconstructor
    untouched: Untouched | None
    store: TractionStore
    record: type[FrameForce] = FrameForce
    journal: str = JOURNAL
    anchor: FaceDepthCorrection = NO_CORRECTION

    @property
    def out(self) -> Path:
        """Folder of the results."""
        return self.store.out

    def decides(self) -> tuple[object, ...]:
        """Return what determines a force besides the frame and its height map."""
        material = self.field.material
        covariance = None if material.covariance is None else material.covariance.tolist()
        follows = self.untouched is not None and self.untouched.shows
        return (self.store, material.youngs_modulus_MPa, material.poisson_ratio, covariance, self.field.settings,
                self.field.gel, follows, self.anchor.depth_scale, self.reconstructor.taught)  # fmt: skip

    def prepare(self, names: Sequence[str], *, anew: bool) -> None:
        """Prepare the store."""
        self.store.prepare(names, anew=anew)

    def __call__(self, frame: Frame | BadFrame, number: int) -> FrameForce:
        """Store the tractions; return the resultant, or why there is none."""
        if isinstance(frame, BadFrame):
            return FrameForce(frame.name, frame.time_s, why=f"unreadable: {frame.why}")
        try:
            found = self.solve(frame).found
        except InputError as fault:
            return FrameForce(frame.name, frame.time_s, why=f"rejected: {fault.what}")
        except ConvergenceError as fault:
            return FrameForce(frame.name, frame.time_s, why=f"not solved: {fault}")
        self.store.write(number, found)
        return as_force(found, frame)

    def solve(self, frame: Frame) -> Solved:
        """Solve for the forces.

        Raises InputError for a frame that cannot be read, ConvergenceError if the contact does not settle.
        """
        height, shear, why = self.reconstructor.height_map(frame), None, []
        doubts: tuple[str, ...] = ()
        if self.field.touched(height):
            height = self.anchor(height)
            if self.untouched is None or not self.untouched.shows:
                why = [NO_REFERENCE if self.untouched is None else NOTHING_TO_FOLLOW]
            else:
                shear = self.untouched.shear(self.reconstructor.rectified(frame))
            error = self.reconstructor.error
            doubts = contact_flags(find_contact(height, error), error)
        found = self.field(height, shear)
        # a contact cut by the border is flagged by the field itself
        doubts = add(height.flags, tuple(flag for flag in doubts if flag == BEYOND_BALLS))
        flags = (*dict.fromkeys((*found.flags, *why)), *(MEANING[flag] for flag in doubts))
        return Solved(height, shear, replace(found, flags=flags))

    def kept(self, result: FrameForce) -> bool:
        """Return whether the store that holds the frame's tractions is there."""
        return not result.read or self.store.scratch.exists()


def as_force(found: TractionMap, frame: Frame) -> FrameForce:
    """Return the numbers of a map of tractions."""
    pressure, place = np.maximum(np.nan_to_num(found.t_z), 0), NOTHING[:2]
    if pressure.any():
        row, column = center_of_mass(pressure)
        place = found.first_mm[0] + found.mm_per_px[0] * column, found.first_mm[1] + found.mm_per_px[1] * row
    return FrameForce(frame.name, frame.time_s, found.resultant_N, found.resultant_std_N,
                      found.moment_Nmm or NOTHING, found.depth_mm, place, "; ".join(found.flags))  # fmt: skip


def nothing_touches(row: FrameForce) -> bool:
    """Return whether the frame was read and shows a gel that is free."""
    return row.read and NO_CONTACT in row.flags
