"""All frames of a recording into tractions and resultants, with the F/T reading beside where there is one."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.files import replacing, write_text
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.reconstruct import Reconstructor
from tactilevision.recording import BadFrame, Recording, iter_frames, read_image
from tactilevision.records import Bytes, Floats, Frame, Material, ShearMap, TractionMap
from tactilevision.sensors import rectify
from tactilevision.shear.measure import measure_shear

TABLE, TRACTIONS = "resultants.csv", "tractions.npz"
AXES = ("fx", "fy", "fz")
COLUMNS = ("frame", "time_s", *(f"{a}_N" for a in AXES), *(f"{a}_std_N" for a in AXES),
           "mx_Nmm", "my_Nmm", "mz_Nmm", "flags", *(f"ft_{a}_N" for a in AXES))  # fmt: skip
NOTHING = (float("nan"),) * 3


@dataclass(frozen=True, slots=True)
class FrameForce:
    """One frame's outcome: `found` None where it could not be read, `why` then says why; `measured_N` (3,), NaN
    where the F/T sensor says nothing."""

    frame: str
    time_s: float
    found: TractionMap | None
    measured_N: Floats
    why: str = ""


def force_folder(recording: Recording, reconstructor: Reconstructor, material: Material, out: Path | str, *,
                 settings: ForceSettings | None = None, clock_offset_s: float | None = None,
                 progress: Callable[[int, int], None] | None = None) -> tuple[FrameForce, ...]:  # fmt: skip
    """Write tractions.npz (frame, t_x, t_y, t_z (N, rows, columns) float32 in MPa, mm_per_px) and resultants.csv.

    Shear is followed from the first frame of the untouched gel among the recording's references; without one,
    fx and fy stay empty. `clock_offset_s` (F/T minus camera) stands in where the recording does not state it. A
    frame that cannot be read is listed with the reason. Raises InputError where the sensor's gel is not described.
    """
    out, sensor = Path(out), recording.sensor
    if sensor.gel is None:
        raise InputError("forces need the gel's thickness", where=recording.path / "recording.toml",
                         remedy="Add [sensor.gel] with thickness_mm, shape and size.")  # fmt: skip
    field = ForceField(sensor.gel, material, sensor.mm_per_px, settings=settings)
    untouched = untouched_frame(recording)
    measured = _Readings(recording, clock_offset_s)
    results = []
    for frame in iter_frames(recording):
        results.append(_one(frame, field, reconstructor, untouched, measured))
        if progress is not None:
            progress(len(results), len(recording.frame_names))
    write_text(out / TABLE, table(results))
    _write_tractions(out / TRACTIONS, results)
    return tuple(results)


def untouched_frame(recording: Recording) -> Bytes | None:
    """The first reference picture of the untouched gel, rectified; None where the recording has none."""
    if not recording.flats:
        return None
    return rectify(recording.sensor, read_image(recording.flats[0], white_level=recording.white_level))


def table(results: list[FrameForce]) -> str:
    """resultants.csv: what is not known is left empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in results:
        found = row.found
        numbers = (NOTHING * 3) if found is None else (
            *found.resultant_N, *found.resultant_std_N, *(found.moment_Nmm or NOTHING))  # fmt: skip
        flags = row.why if found is None else "; ".join(found.flags)
        cells = [_cell(value) for value in numbers]
        writer.writerow([row.frame, _cell(row.time_s), *cells, flags, *(_cell(value) for value in row.measured_N)])
    return text.getvalue()


class _Readings:
    """The F/T sensor at the camera's times, its zero taken where no press is under way."""

    def __init__(self, recording: Recording, clock_offset_s: float | None) -> None:
        stated = recording.clock_offset_s
        self.forces, self.offset = recording.forces, (stated if stated is not None else clock_offset_s) or 0.0
        self.tare = None if recording.forces is None else self._free(recording)

    def at(self, time_s: float) -> Floats:
        """Force (3,) at a camera time, NaN outside the readings."""
        if self.forces is None or not np.isfinite(time_s):
            return np.full(3, np.nan)
        now, times = time_s + self.offset, self.forces.time_s
        if len(times) == 0 or not times[0] <= now <= times[-1]:
            return np.full(3, np.nan)
        read = np.array([np.interp(now, times, self.forces.force_N[:, k]) for k in range(3)])
        if self.tare is None:
            return read
        zero = [np.interp(now, self.tare[:, 0], self.tare[:, 1 + k]) for k in range(3)]
        return np.asarray(read - np.array(zero))

    def _free(self, recording: Recording) -> Floats | None:
        """(G, 4) middle time and median force of every gap between presses; None where presses are not listed."""
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


def _one(frame: Frame | BadFrame, field: ForceField, reconstructor: Reconstructor, untouched: Bytes | None,
         measured: _Readings) -> FrameForce:  # fmt: skip
    reading = measured.at(frame.time_s)
    if isinstance(frame, BadFrame):
        return FrameForce(frame.name, frame.time_s, None, reading, f"unreadable: {frame.why}")
    try:
        height = reconstructor.height_map(frame)
    except InputError as fault:
        return FrameForce(frame.name, frame.time_s, None, reading, f"rejected: {fault.what}")
    shear: ShearMap | None = None
    if untouched is not None:
        picture = rectify(reconstructor.sensor, frame.rgb)
        shear = measure_shear(
            untouched, picture, field.mm_per_px, markers=reconstructor.sensor.has_markers or None
        )
    try:
        return FrameForce(frame.name, frame.time_s, field(height, shear), reading)
    except ConvergenceError as fault:
        return FrameForce(frame.name, frame.time_s, None, reading, f"not solved: {fault}")


def _write_tractions(path: Path, results: list[FrameForce]) -> None:
    maps: Iterator[FrameForce] = (row for row in results if row.found is not None)
    kept = [(row.frame, row.found) for row in maps if row.found is not None]
    if not kept:
        return
    t_x, t_y, t_z = (
        np.stack([getattr(found, name) for _, found in kept]).astype(np.float32) for name in ("t_x", "t_y", "t_z")
    )
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, frame=np.array([name for name, _ in kept]),
        mm_per_px=np.array(kept[0][1].mm_per_px),
                            first_mm=np.array(kept[0][1].first_mm), t_x=t_x, t_y=t_y, t_z=t_z)  # fmt: skip


def _cell(value: float) -> str:
    return f"{value:.7g}" if np.isfinite(value) else ""
