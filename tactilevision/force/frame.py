"""Tractions and resultants of the frames of a recording, stored, with the readings of a force/torque sensor."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.ndimage import binary_erosion, center_of_mass

from tactilevision.batch.jobs import run_job
from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.files.documents import csv_text
from tactilevision.files.writing import remove, replacing, write_text
from tactilevision.files.zarr_store import begin_frames, end_frames, read_frames, settle, write_frame
from tactilevision.force.calibrated import check_gel, read_thickness_mm
from tactilevision.force.compliance import GelCompliance
from tactilevision.force.field import BEYOND, CUT, NO_CONTACT, ForceField
from tactilevision.force.nodes import NodeGrid
from tactilevision.force.patches import PatchTracker
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.press.certified_faces import NO_CORRECTION, FaceDepthCorrection
from tactilevision.recording.model import BadFrame, Recording, is_bare
from tactilevision.recording.write import table_cell
from tactilevision.records.maps import BEYOND_BALLS, MEANING, Frame, HeightMap, ShearMap, TractionMap, add
from tactilevision.records.measured import Bools, Floats, Material
from tactilevision.records.rig import Gel, Press
from tactilevision.records.wrench import PATCH_COLUMNS, STDS, Triple, triple
from tactilevision.shear.displacement import NOTHING_TO_FOLLOW, Untouched, read_untouched, untouched_frame

# Tractions of many frames on disk, written by many processes a frame at a time as Zarr, then moved to their place.
#
# tractions.npz     good frames: frame (N,) names, t_x, t_y, t_z (N, rows, columns) float32 in MPa, mm_per_px,
#                   first_mm, patch (N, rows, columns), the number of each cell's patch, 0 outside
# tractions.zarr    all frames, NaN for a frame without tractions: the same fields; scale and place as attributes

FIELDS = ("t_x", "t_y", "t_z")
PATCH = "patch"
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
        return self.out / ".tractions.zarr-unfinished"

    def prepare(self, frames: Sequence[str], *, anew: bool) -> None:
        """Clean up after killed runs, and make an empty scratch where `anew`."""
        settle(self.path)
        if anew:
            units = dict.fromkeys(FIELDS, "MPa") | {PATCH: "1"}
            begin_frames(self.scratch, frames, fields=units, shape=self.grid.shape, about=self._about())

    def write(self, number: int, found: TractionMap) -> None:
        """Write one frame's tractions."""
        fields = {name: getattr(found, name).astype(np.float32) for name in FIELDS}
        numbers = np.zeros(self.grid.shape) if found.patch_map is None else found.patch_map
        write_frame(self.scratch, number, fields=fields | {PATCH: numbers.astype(np.float32)})

    def number_patches(self, good: Sequence[int]) -> list[dict[int, int]]:
        """Give the patches of the frames `good`, in order, lasting numbers; return them by the frame's own."""
        every, track, names = read_frames(self.scratch, (PATCH,))[PATCH], PatchTracker(), []
        for number in good:
            names.append(track.follow(every[number].astype(np.intp)))
            if not np.array_equal(lasting := np.asarray(track.numbered, dtype=np.float32), every[number]):
                write_frame(self.scratch, number, fields={PATCH: lasting})
        return names

    def end(self, frames: Sequence[str], good: Sequence[int]) -> None:
        """Put the store in place; `good` are the numbers of the frames that have tractions."""
        if self.form == "zarr":
            end_frames(self.scratch, self.path)
            return
        arrays = {name: field[good] for name, field in read_frames(self.scratch, (*FIELDS, PATCH)).items()}
        names = np.array([frames[number] for number in good], dtype=np.str_)
        with replacing(self.path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, frame=names, **arrays, **self._about())
        remove(self.scratch)

    def _about(self) -> dict[str, Any]:
        step = self.grid.spacing_mm
        return {"mm_per_px": [step, step], "first_mm": [float(self.grid.x_mm[0]), float(self.grid.y_mm[0])]}


NO_REFERENCE = "no picture of the untouched gel to follow it from"
FAST = "faster than the presses of the calibration: a viscoelastic gel is stiffer"
RATE_S = 0.2  # over which a rate is taken
RATE_MM = 0.03  # error of a change of depth
NOTHING = (float("nan"),) * 3  # N: a force that is not known
JOURNAL = ".force-journal"


@dataclass(frozen=True, slots=True)
class FrameForce:
    """The force of one frame, or `why` there is none; `flags` in words.

    `depth_mm` is the greatest depth of the contact, `place_mm` the centre of pressure on the pad, `measured_N` the
    F/T sensor's force at the time; NaN: unknown. `reading_clipped`: the F/T sensor was at the end of its range in
    the press. `model_std_N`: the solver's own part of fz's std; `cut`: the share of the contact's outline on the
    picture's border. `could_hide_N` is the upper 95 % limit of an unseen normal force; `patches` have a row of
    PATCH_COLUMNS each.
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
    model_std_N: float = float("nan")
    cut: float = 0.0
    moment_std_Nmm: Triple = NOTHING
    could_hide_N: float = float("nan")
    patches: tuple[tuple[float, ...], ...] = ()

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
                self.field.gel, follows, self.anchor, self.reconstructor.taught,
                material.deepest_mm)  # fmt: skip

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

    def records(self, frames: Iterable[Frame | BadFrame], numbers: Iterable[int]) -> Iterator[FrameForce]:
        """Compute the forces of frames, one by one."""
        return map(self, frames, numbers)

    def solve(self, frame: Frame) -> Solved:
        """Solve for the forces.

        Raises InputError for a frame that cannot be read, ConvergenceError if the contact does not settle.
        """
        height, shear, why, found = self.maps(frame)
        doubts = height.flags
        if found is None:  # a contact cut by the border is flagged by the field itself
            found, error = self.field(height, shear), self.reconstructor.error
            more = contact_flags(find_contact(height, error), error)
            doubts = add(doubts, tuple(flag for flag in more if flag == BEYOND_BALLS))
        flags = (*dict.fromkeys((*found.flags, *why)), *(MEANING[flag] for flag in doubts))
        return Solved(height, shear, replace(found, flags=flags))

    def maps(self, frame: Frame) -> tuple[HeightMap, ShearMap | None, list[str], TractionMap | None]:
        """Return the height of a frame, its shear, why there is none, and the tractions where nothing touches."""
        rgb = self.reconstructor.rectified(frame)
        height = self.reconstructor.rectified_map(rgb, time_s=frame.time_s, name=frame.name)
        if (free := self.field.free(height)) is not None:
            return height, None, [], free
        height = self.anchor(height)
        if self.untouched is None or not self.untouched.shows:
            return height, None, [NO_REFERENCE if self.untouched is None else NOTHING_TO_FOLLOW], None
        return height, self.untouched.shear(rgb), [], None

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
                      found.moment_Nmm or NOTHING, found.depth_mm, place, "; ".join(found.flags),
                      model_std_N=found.model_std_N,
                      cut=_cut(pressure > 0) if CUT in found.flags else 0.0,
                      moment_std_Nmm=found.moment_std_Nmm or NOTHING, could_hide_N=found.could_hide_N,
                      patches=tuple(one.row for one in found.patches))  # fmt: skip


def _cut(touching: Bools) -> float:
    """Return the share of the outline of touching cells (rows, columns) that lies on the border of the cells."""
    outline, border = touching & ~binary_erosion(touching), np.ones_like(touching)
    border[1:-1, 1:-1] = False
    return float(np.mean(border[outline])) if outline.any() else 0.0


def nothing_touches(row: FrameForce) -> bool:
    """Return whether the frame was read and shows a gel that is free."""
    return row.read and NO_CONTACT in row.flags


# Readings of the force/torque sensor.

STUCK = 5  # equal readings at the extreme: a sensor at the end of its range


class Readings:
    """Force/torque readings at camera times, zeroed between presses.

    `clock_offset_s` (F/T minus camera) is used if the recording states none.
    """

    def __init__(self, recording: Recording, clock_offset_s: float | None = None) -> None:
        stated = recording.clock_offset_s
        self.forces, self.offset = recording.forces, (stated if stated is not None else clock_offset_s) or 0.0
        self.presses = recording.presses
        self._zero = None if recording.forces is None else self._free(recording)

    def at(self, time_s: float) -> Floats:
        """Return the force (3,) at a camera time, NaN outside the readings."""
        if self.forces is None or not np.isfinite(time_s):
            return np.full(3, np.nan)
        now, times = time_s + self.offset, self.forces.time_s
        if len(times) == 0 or not times[0] <= now <= times[-1]:
            return np.full(3, np.nan)
        read = np.array([np.interp(now, times, axis) for axis in self.forces.force_N.T])
        if self._zero is None:
            return read
        free_s, *zero = self._zero.T
        return np.asarray(read - [np.interp(now, free_s, axis) for axis in zero])

    def clipped(self, press: Press) -> bool:
        """Return whether the F/T sensor stood at the end of its range: STUCK and more equal readings at its
        extreme.

        Noise does not repeat a number so often, and a sensor at rest is not at its extreme.
        """
        if self.forces is None:
            return False
        times, force = self.forces.time_s, self.forces.force_N
        under_way = (times > press.start_s + self.offset) & (times < press.end_s + self.offset)
        at_end = (np.abs(force[under_way]) == self._ends) & (self._ends > 0)
        return bool((at_end.sum(axis=0) >= STUCK).any())

    @cached_property
    def _ends(self) -> Floats:
        """Return the greatest force (3,) along each axis."""
        assert self.forces is not None
        return np.asarray(np.abs(self.forces.force_N).max(axis=0))

    def _free(self, recording: Recording) -> Floats | None:
        """Return (G, 4) middle time and median force of every gap between presses.

        None if presses are not listed.
        """
        assert recording.forces is not None
        if not recording.presses:
            return None
        times, force = recording.forces.time_s, recording.forces.force_N
        busy = sorted((p.start_s + self.offset, p.end_s + self.offset) for p in recording.presses)
        starts, ends = [-np.inf, *(end for _, end in busy)], [*(start for start, _ in busy), np.inf]
        rows = []
        for start, end in zip(starts, ends, strict=True):
            free = (times > start) & (times < end)
            if free.any():
                rows.append([float(times[free].mean()), *np.median(force[free], axis=0)])
        return np.array(rows) if rows else None


# Tractions and resultants of all frames of a recording, with the F/T readings: streamed on all cores and resumed
# where a run was interrupted (batch/jobs.py).

TABLE, PATCHES = "resultants.csv", "patches.csv"
AXES = ("fx", "fy", "fz")
COLUMNS = ("frame", "time_s", *(f"{a}_N" for a in AXES), *(f"{a}_std_N" for a in AXES), "mx_Nmm", "my_Nmm",
           "mz_Nmm", "depth_mm", "x_mm", "y_mm", "flags", "press", *(f"ft_{a}_N" for a in AXES),
           *STDS[3:], "could_hide_N", "patches")  # fmt: skip


def force_folder(
    recording: Recording,
    job: ForceJob,
    *,
    clock_offset_s: float | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[FrameForce, ...]:
    """Write the tractions of every frame and resultants.csv; return its rows in the frames' order.

    `job` comes from `force_job`. `clock_offset_s` (F/T minus camera) is used if the recording states none.
    `cluster` as in batch/jobs.py. A frame that cannot be read is listed with the reason. An unfinished run of
    the same job is resumed.
    """
    readings = Readings(recording, clock_offset_s)

    def end(done: list[FrameForce]) -> tuple[FrameForce, ...]:
        rows = flag_rates([with_reading(row, readings) for row in done], job.field.material.fastest_mm_s)
        good = [number for number, row in enumerate(rows) if row.read]
        for number, names in zip(good, job.store.number_patches(good), strict=True):
            lasting = sorted((float(names[int(own)]), *values) for own, *values in rows[number].patches)
            rows[number] = replace(rows[number], patches=tuple(lasting))
        job.store.end(recording.frame_names, good)
        write_text(job.out / TABLE, table(rows))
        write_text(job.out / PATCHES, csv_text([("frame", "time_s", *PATCH_COLUMNS), *patch_cells(rows)]))
        return tuple(rows)

    return run_job(recording, job, end=end, workers=workers, cluster=cluster, progress=progress)


def force_job(
    recording: Recording,
    reconstructor: Reconstructor,
    *,
    material: Material,
    out: Path | str,
    form: Form = "npz",
    untouched: Untouched | None = None,
    compliance: GelCompliance | None = None,
) -> ForceJob:
    """Prepare what every frame needs: compliance, the untouched gel, and where tractions go.

    Shear is measured from the first frame of the untouched gel among the recording's references, or from
    `untouched`; without one, or with one of another crop, fx and fy are unknown. `compliance` is the gel's if it
    was computed before. Raises InputError if the sensor's gel is not described.
    """
    sensor = recording.sensor
    if sensor.gel is None:
        bare = is_bare(recording)
        raise InputError(
            "forces need the gel's thickness",
            where=recording.path if bare else recording.path / "recording.toml",
            remedy="Name a TOML file with [sensor.gel] thickness_mm, shape and size, or a profile, with --sensor."
            if bare
            else "Add [sensor.gel] with thickness_mm, shape and size.",
        )
    view = (sensor.height_px, sensor.width_px)
    field = ForceField(sensor.gel, material, sensor.mm_per_px, view_px=view, compliance=compliance)
    assert field.compliance is not None
    store = TractionStore(Path(out).absolute(), form, field.compliance.grid)
    if untouched is None and not (reconstructor.match and reconstructor.match.registered):
        untouched = _untouched(recording)
    return ForceJob(field, reconstructor, untouched, store)


def with_gel(recording: Recording, calibration: Path | None) -> Recording:
    """Return the recording with a gel as thick as the calibration's, and a warning, where it describes none.

    Raises InputError where its own gel is not that of the file `calibration`.
    """
    if calibration is None:
        return recording
    gel = recording.sensor.gel
    if gel is not None:
        check_gel(calibration, gel)
        return recording
    thickness_mm = read_thickness_mm(calibration)
    if thickness_mm is None:
        return recording
    guess = f"guessed: the gel is {thickness_mm:g} mm thick, as the calibration's, and has no sides nearby"
    sensor = replace(recording.sensor, gel=Gel(thickness_mm))
    return replace(recording, sensor=sensor, warnings=(*recording.warnings, guess))


def with_reading(row: FrameForce, readings: Readings) -> FrameForce:
    """Add the F/T reading and the press of its time to a row."""
    measured = triple(readings.at(row.time_s))
    press = next((one for one in readings.presses if one.start_s <= row.time_s <= one.end_s), None)
    if press is None:
        return replace(row, measured_N=measured)
    return replace(row, measured_N=measured, press=press.press, reading_clipped=readings.clipped(press))


def flag_rates(rows: Sequence[FrameForce], fastest_mm_s: float | None) -> list[FrameForce]:
    """Flag frames in which the depth changes faster than in the fastest press of the calibration.

    The change since a frame RATE_S before, or since the last one, must exceed the error of two depths, RATE_MM.
    """
    moving = [k for k, row in enumerate(rows) if row.read and np.isfinite(row.time_s)]
    moving.sort(key=lambda k: rows[k].time_s)
    flagged, times = list(rows), [rows[k].time_s for k in moving]
    for place, k in enumerate(moving[1:], start=1) if fastest_mm_s else ():
        before = rows[moving[min(bisect_left(times, times[place] - RATE_S), place - 1)]]
        moved_mm = abs(np.nan_to_num(rows[k].depth_mm) - np.nan_to_num(before.depth_mm))
        if moved_mm > BEYOND * (fastest_mm_s or 0.0) * (rows[k].time_s - before.time_s) + RATE_MM:
            flagged[k] = replace(rows[k], flags="; ".join(filter(None, (rows[k].flags, FAST))))
    return flagged


def table(rows: Sequence[FrameForce]) -> str:
    """Return resultants.csv; what is not known is left empty."""
    return csv_text([COLUMNS, *map(_cells, rows)])


def _cells(row: FrameForce) -> tuple[str, ...]:
    numbers = (*row.resultant_N, *row.resultant_std_N, *row.moment_Nmm, row.depth_mm, *row.place_mm)
    about = (row.why or row.flags, row.press)
    limits = (*row.moment_std_Nmm, row.could_hide_N, len(row.patches) if row.read else np.nan)
    return (
        row.frame,
        table_cell(row.time_s),
        *map(_cell, numbers),
        *about,
        *map(_cell, (*row.measured_N, *limits)),
    )


def patch_cells(rows: Sequence[FrameForce]) -> list[tuple[str, ...]]:
    """Return the lines of patches.csv, one for each patch of each frame."""
    return [(row.frame, table_cell(row.time_s), *map(_cell, one)) for row in rows for one in row.patches]


def _untouched(recording: Recording) -> Untouched | None:
    frame = untouched_frame(recording)
    sensor = recording.sensor
    return None if frame is None else read_untouched(frame, sensor.mm_per_px, markers=sensor.has_markers or None)


def _cell(value: float) -> str:
    return f"{value:.7g}" if np.isfinite(value) else ""
