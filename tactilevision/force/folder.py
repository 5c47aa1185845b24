"""Tractions and resultants of all frames of a recording, with the F/T readings.

Streamed on all cores and resumed where a run was interrupted (jobs.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactilevision.batch.jobs import run_job
from tactilevision.errors import InputError
from tactilevision.files.documents import csv_text
from tactilevision.files.writing import write_text
from tactilevision.force.calibrated import check_gel
from tactilevision.force.comparison import Readings
from tactilevision.force.compliance import GelCompliance
from tactilevision.force.field import ForceField, ForceSettings, triple
from tactilevision.force.frame import ForceJob, Form, FrameForce, TractionStore
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.model import Recording, is_bare
from tactilevision.recording.write import table_cell
from tactilevision.records.measured import Material
from tactilevision.records.rig import Gel
from tactilevision.shear.displacement import Untouched, read_untouched, untouched_frame

TABLE = "resultants.csv"
AXES = ("fx", "fy", "fz")
COLUMNS = ("frame", "time_s", *(f"{a}_N" for a in AXES), *(f"{a}_std_N" for a in AXES), "mx_Nmm", "my_Nmm",
           "mz_Nmm", "depth_mm", "x_mm", "y_mm", "flags", "press", *(f"ft_{a}_N" for a in AXES))  # fmt: skip


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
        rows = tuple(with_reading(row, readings) for row in done)
        job.store.end(recording.frame_names, [number for number, row in enumerate(rows) if row.read])
        write_text(job.out / TABLE, table(rows))
        return rows

    return run_job(recording, job, end=end, workers=workers, cluster=cluster, progress=progress)


def force_job(
    recording: Recording,
    reconstructor: Reconstructor,
    *,
    material: Material,
    out: Path | str,
    settings: ForceSettings | None = None,
    form: Form = "npz",
    untouched: Untouched | None = None,
    compliance: GelCompliance | None = None,
) -> ForceJob:
    """Prepare what every frame needs: compliance, the untouched gel, and where tractions go.

    Shear is measured from the first frame of the untouched gel among the recording's references, or from
    `untouched`; without one, fx and fy are unknown. `compliance` is the gel's if it was computed before. Raises
    InputError if the sensor's gel is not described.
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
    field = ForceField(
        sensor.gel, material, sensor.mm_per_px, view_px=view, settings=settings, compliance=compliance
    )
    assert field.compliance is not None
    store = TractionStore(Path(out).absolute(), form, field.compliance.grid)
    return ForceJob(field, reconstructor, untouched or _untouched(recording), store)


def with_gel(recording: Recording, calibration: Path | None, thickness_mm: float | None) -> Recording:
    """Return the recording with a gel as thick as the calibration's, and a warning, where it describes none.

    Raises InputError where its own gel is not that of the file `calibration`.
    """
    gel = recording.sensor.gel
    if gel is not None:
        if calibration is not None:
            check_gel(calibration, gel)
        return recording
    if thickness_mm is None:
        return recording
    guess = f"guessed: the gel is {thickness_mm:g} mm thick, as the calibration's, and has no sides nearby"
    sensor = replace(recording.sensor, gel=Gel(thickness_mm))
    return replace(recording, sensor=sensor, warnings=(*recording.warnings, guess))


def with_reading(row: FrameForce, readings: Readings) -> FrameForce:
    """Add the F/T reading and the press of its time to a row."""
    press, measured = readings.press_at(row.time_s), triple(readings.at(row.time_s))
    if press is None:
        return replace(row, measured_N=measured)
    return replace(row, measured_N=measured, press=press.press, reading_clipped=readings.clipped(press))


def table(rows: Sequence[FrameForce]) -> str:
    """Return resultants.csv; what is not known is left empty."""
    return csv_text([COLUMNS, *map(_cells, rows)])


def _cells(row: FrameForce) -> tuple[str, ...]:
    numbers = (*row.resultant_N, *row.resultant_std_N, *row.moment_Nmm, row.depth_mm, *row.place_mm)
    about = (row.why or row.flags, row.press)
    return (row.frame, table_cell(row.time_s), *map(_cell, numbers), *about, *map(_cell, row.measured_N))


def _untouched(recording: Recording) -> Untouched | None:
    frame = untouched_frame(recording)
    sensor = recording.sensor
    return None if frame is None else read_untouched(frame, sensor.mm_per_px, markers=sensor.has_markers or None)


def _cell(value: float) -> str:
    return f"{value:.7g}" if np.isfinite(value) else ""
