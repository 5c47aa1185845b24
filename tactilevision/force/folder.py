"""All frames of a recording into tractions and resultants, with the F/T reading beside where there is one.

Streamed on all cores and taken up again where it was cut off (jobs.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactilevision.batch.jobs import Journal, fingerprint_of, run_job, way_of_reading
from tactilevision.cluster.connect import check_cluster
from tactilevision.errors import InputError
from tactilevision.files.documents import csv_text
from tactilevision.files.runs import output_lock
from tactilevision.files.writing import write_text
from tactilevision.force.comparison import Readings
from tactilevision.force.compliance import GelCompliance
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.force.frame import ForceJob, Form, FrameForce, TractionStore
from tactilevision.force.wrench import triple
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.model import Recording, is_bare
from tactilevision.recording.pictures import read_flats
from tactilevision.recording.write import table_cell
from tactilevision.records.measured import Bytes, Material
from tactilevision.sensors.rectification import rectify
from tactilevision.shear.displacement import Untouched, read_untouched

TABLE, JOURNAL = "resultants.csv", ".force-journal.csv"
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
    """Write the tractions of every frame (store.py) and resultants.csv; returns its rows in the frames' order.

    `job` is what `force_job` gives. `clock_offset_s` (F/T minus camera) stands in where the recording does not
    state it. `cluster` as in batch/folder.py. A frame that cannot be read is listed with the reason. An unfinished
    run of the same job goes on.
    """
    if cluster is not None:
        check_cluster(cluster)
    with output_lock(job.store.out):
        return _solve(
            recording,
            job,
            Readings(recording, clock_offset_s),
            workers=workers,
            cluster=cluster,
            progress=progress,
        )


def _solve(
    recording: Recording,
    job: ForceJob,
    readings: Readings,
    *,
    workers: int | None,
    cluster: str | None,
    progress: Callable[[int, int], None] | None,
) -> tuple[FrameForce, ...]:
    store, names = job.store, recording.frame_names
    store.settle()
    seen = way_of_reading(recording, job.reconstructor.height_map)
    journal = Journal(store.out / JOURNAL, fingerprint_of(recording, store, seen, *_what_decides(job)))
    done = run_job(
        recording,
        job,
        journal=journal,
        workers=workers,
        cluster=cluster,
        progress=progress,
        begin=lambda: store.begin(names),
    )
    rows = tuple(beside(FrameForce.of(row), readings) for row in done)
    store.end(names, [number for number, row in enumerate(rows) if row.read])
    write_text(store.out / TABLE, table(rows))
    journal.end()
    return rows


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
    """All that a frame needs, made once: compliance, the untouched gel, and where tractions go.

    Shear is followed from the first frame of the untouched gel among the recording's references, or from
    `untouched`; without one, fx and fy stay unknown. `compliance` is the gel's where it was made before. Raises
    InputError where the sensor's gel is not described.
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


def untouched_frame(recording: Recording) -> Bytes | None:
    """The first reference picture of the untouched gel, rectified; None where the recording has none."""
    flats = read_flats(replace(recording, flats=recording.flats[:1]))
    return rectify(recording.sensor, flats[0]) if flats else None


def beside(row: FrameForce, readings: Readings) -> FrameForce:
    """The row with the F/T reading and the press of its time."""
    press = readings.press_at(row.time_s)
    if press is None:
        return replace(row, measured_N=triple(readings.at(row.time_s)))
    return replace(
        row, measured_N=triple(readings.at(row.time_s)), press=press.press, reading_clipped=readings.clipped(press)
    )


def table(rows: Sequence[FrameForce]) -> str:
    """resultants.csv: what is not known is left empty."""
    return csv_text([COLUMNS, *map(_cells, rows)])


def _cells(row: FrameForce) -> tuple[str, ...]:
    numbers = (*row.resultant_N, *row.resultant_std_N, *row.moment_Nmm, row.depth_mm, *row.place_mm)
    about = (row.why or row.flags, row.press)
    return (row.frame, table_cell(row.time_s), *map(_cell, numbers), *about, *map(_cell, row.measured_N))


def _untouched(recording: Recording) -> Untouched | None:
    frame = untouched_frame(recording)
    sensor = recording.sensor
    return None if frame is None else read_untouched(frame, sensor.mm_per_px, markers=sensor.has_markers or None)


def _what_decides(job: ForceJob) -> tuple[object, ...]:
    """Whatever would give a frame another force."""
    field, material = job.field, job.field.material
    covariance = None if material.covariance is None else material.covariance.tolist()
    follows = job.untouched is not None and job.untouched.shows
    return (material.youngs_modulus_MPa, material.poisson_ratio, covariance, field.settings, field.gel, follows,
            job.anchor.depth_scale, job.reconstructor.taught)  # fmt: skip


def _cell(value: float) -> str:
    return f"{value:.7g}" if np.isfinite(value) else ""
