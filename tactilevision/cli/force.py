"""Command `force`: tractions and resultants of frames, with figures and a diagnosis."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np

from tactilevision.batch.selection import strongest_frames
from tactilevision.cli import console, options, source
from tactilevision.errors import InputError
from tactilevision.files.cache import VARIABLE, kept
from tactilevision.files.ledger import folder_digest
from tactilevision.files.opening import inside, real_path
from tactilevision.files.writing import as_json, remove, staged, write_bytes
from tactilevision.force import comparison
from tactilevision.force.calibrated import (
    TOGETHER,
    Sensitivity,
    material_of,
    material_sensitivity,
    modulus_of,
    read_clock_offset,
    read_material,
)
from tactilevision.force.frame import ForceJob, FrameForce, force_folder, force_job, with_gel
from tactilevision.force.mesh_compliance import MeshCompliance, equivalent_thickness_mm
from tactilevision.plots import force as draw, style
from tactilevision.profile.sensor import stated_material
from tactilevision.recording import layout
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import content_of, read_frame
from tactilevision.records.constants import Z95
from tactilevision.records.maps import TractionMap
from tactilevision.records.measured import Material
from tactilevision.sensors import usual_gel

MOST_S = 60  # s, the longest diagnosis within `force`
TOLD = "told.json"  # among the files kept of a diagnosis: its content, its warnings, and what is printed


def force(given: options.Force) -> None:
    """Turn frames into maps of traction on the gel (MPa) and resultants (N), with figures."""
    chosen = source.Choice(given.sensor, given.reference, given.method, given.mm_per_px, given.even_so)
    recording = with_gel(chosen.open(given.path), given.calibration)
    recording, material = _material(chosen, given.calibration, recording)
    with console.progress_bar("calibrating the light:") as progress:
        profiled, light = chosen.calibrated(recording), chosen.light(recording, progress)
        reconstructor, anchor = source.open_face_correction(recording, light, calibration=given.calibration)
        job = force_job(
            recording,
            reconstructor,
            material=material,
            out=given.out,
            form=given.form,
            untouched=profiled.untouched if profiled else None,
            compliance=profiled.profile.compliance if profiled and given.calibration is None else None,
        )
        job = replace(job, anchor=anchor)
    console.warn([*recording.warnings, *job.reconstructor.warnings])
    with console.progress_bar("frames") as progress:
        offset_s = None if given.calibration is None else read_clock_offset(given.calibration)
        how: dict[str, Any] = {"clock_offset_s": offset_s, "workers": given.workers, "cluster": given.cluster}
        rows = force_folder(recording, job, progress=progress, **how)
    content, written = _say_forces(recording, job, rows, given.out, way=chosen.way, most=given.pictures)
    if written is not None and given.diagnosis:
        content["diagnosis"] = _diagnose(written, given.out / "diagnosis")
    console.hand_over(content | {"material": material.as_json()}, given.json)


def _say_forces(
    recording: Recording, job: ForceJob, rows: tuple[FrameForce, ...], out: Path, *, way: str, most: int
) -> tuple[dict[str, Any], Path | None]:
    """Print, draw and return the summary of the forces, and the recording of the comparison with measured ones.

    `way` is what determines a frame's map besides the recording.
    """
    read = [row for row in rows if row.read]
    console.say(f"{len(read)} of {len(rows)} frames: {job.store.path}, {out / 'resultants.csv'}")
    console.say_first([f"  {row.frame}: {row.why}" for row in rows if not row.read], out / "resultants.csv")
    shear, compared = comparison.shear_summary(read), comparison.residuals(rows, recording.force_std_N)
    _say_shear(shear)
    measured = _say_residuals(compared, has_offset=not recording.presses)
    sensitivity = _figures(recording, job, rows, out / "figures", compared=compared, most=most)
    written, solid = None, _say_mesh(job, rows)
    if compared is not None and solid is None:
        written = _against_sensor(recording, job, rows, out, sensitivity, way=way)
    content = {
        "frames": len(rows),
        "read": len(read),
        "faces_certified": job.anchor.depth_scale is not None,
        "warnings": list(job.reconstructor.warnings),
        "shear": shear,
        "measured": measured,
        "mesh": solid,
        "sensitivity": sensitivity,
        "diagnosis": None,
    }
    return content, written


def _say_mesh(job: ForceJob, rows: tuple[FrameForce, ...]) -> dict[str, Any] | None:
    """Print and return the equivalent thickness of a gel's mesh, and E by the force sensor; None of a flat gel."""
    made = job.field.compliance
    if not isinstance(made, MeshCompliance):
        return None
    here, least, most = equivalent_thickness_mm(made)
    console.say(f"  {made.gel.shape}: as stiff as a flat layer of {here:.2f} mm at the picture's centre, and of")
    console.say(f"  {least:.2f} to {most:.2f} mm over the view: one flat layer does not replace the mesh")
    content: dict[str, Any] = {"equivalent_thickness_mm": here, "over_the_view_mm": [least, most]}
    own, other = (np.array([getattr(row, name) for row in rows]) for name in ("resultant_N", "measured_N"))
    with suppress(InputError):
        modulus, std = modulus_of(own, job.field.material.youngs_modulus_MPa, other)
        console.say(f"  E by the force sensor on this mesh: {modulus:.4g} MPa, std {std:.2g}")
        content |= {"youngs_modulus_MPa": modulus, "youngs_modulus_std_MPa": std}
    return content


def _against_sensor(
    recording: Recording,
    job: ForceJob,
    rows: tuple[FrameForce, ...],
    out: Path,
    sensitivity: Sequence[dict[str, Any]],
    *,
    way: str,
) -> Path | None:
    """Write the forces next to the readings as a recording; return None where no press has enough of both."""
    joint = next((one["change_percent"] for one in sensitivity if one["parameter"] == TOGETHER), (0.0, 0.0))
    std = (joint[1] - joint[0]) / (2 * Z95 * 100)
    return comparison.write_comparison(
        recording,
        rows,
        job.field,
        folder=out / "beside",
        maps=lambda number: job.maps(read_frame(recording, number))[:2],
        depends_on=(content_of(recording), way, job.decides()),
        material_std=std,
    )


def _diagnose(written: Path, out: Path) -> dict[str, Any] | None:
    """Diagnose the difference from the force sensor into `out`, print what it lacks, and return it."""
    key = str(written), real_path(written), real_path(out), folder_digest(written)
    began = time.monotonic()
    try:
        files = kept(
            "diagnosis",
            key,
            make=lambda: _diagnosed(written, out),
            whole=lambda: time.monotonic() < began + MOST_S,
        )
    except InputError as fault:
        console.say(f"  the difference from the force sensor is not diagnosed: {fault}")
        return None
    told = json.loads(files.pop(TOLD))
    with staged(out) as stage:
        for name, content in files.items():
            write_bytes(inside(stage, name, where=VARIABLE), content)
    remove(out / layout.FOUND)
    console.warn(told["warnings"])
    console.say(*told["lines"])
    found: dict[str, Any] = told["content"]
    return found


def _diagnosed(written: Path, out: Path) -> dict[str, bytes]:
    """Return the files of a diagnosis, which will be in `out`, and what is told of it."""
    from calibration.inputs.deadline import Deadline
    from calibration.report.diagnosis_report import resultant_sentences
    from calibration.tasks.session import HISTORY, History, load_history
    from tactilevision import result_folders as folders

    warnings = list[str]()
    heard: Any = SimpleNamespace(progress_bar=console.progress_bar, warn=warnings.extend)
    asked, how = History((str(written),)), folders.Search(deadline=Deadline.after(MOST_S))
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        try:
            found, content, commands = folders.diagnose_as(asked, how, out=folder, listener=heard)
        except InputError:
            console.warn(warnings)
            raise
        folders.write_history(load_history(folder / HISTORY), folder, out)
        made = (path for path in sorted(folder.rglob("*")) if path.is_file())
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in made}
    words = "to add it" if found.effects else "to try"
    lines = [*resultant_sentences(found), *(f"{words}: {text}" for text in commands)]
    lines += [f"its figures are in {out / 'report.html'}; to look further: tactilevision workbench {written}"]
    told = {"content": content, "warnings": warnings, "lines": [f"  {line}" for line in lines]}
    return files | {TOLD: as_json(told).encode()}


def _material(chosen: source.Choice, calibration: Path | None, recording: Recording) -> tuple[Recording, Material]:
    """Return the recording with its gel, and E and nu: of calibration.json, the profile, the gel, or a usual one.

    Warns where they are assumed. Raises InputError where there is none of these.
    """
    profile = chosen.profile
    if calibration is not None:
        return recording, read_material(calibration)
    if profile is not None and profile.material is not None:
        return recording, profile.material
    stated = stated_material(recording.sensor.gel)
    if stated is not None:
        console.warn(["E and nu are as stated of the gel, not measured here"])
        return recording, material_of(stated, where="[sensor.gel]")
    assumed = usual_gel(recording.sensor)
    if assumed is None:
        remedy = (
            "Give --calibration calibration.json, a profile, or youngs_modulus_MPa and poisson_ratio of the gel."
        )
        where = "force" if profile is None else profile.path
        raise InputError("E and nu of the gel are not known", where=where, remedy=remedy)
    gel, material = assumed
    console.warn([f"E and nu of a usual {recording.sensor.kind} are assumed: forces may be off by half"])
    return replace(recording, sensor=replace(recording.sensor, gel=gel)), material


def _say_shear(shear: dict[str, int | str]) -> None:
    """Print in how many frames with contact the tangential force is known, and why not in others."""
    if shear["known"] == 0 < int(shear["touched"]):
        console.say(f"  fx and fy are not known: {shear['why']}")
    elif shear["known"] != shear["touched"]:
        counted = f"{shear['known']} of {shear['touched']} frames with contact"
        console.say(f"  fx and fy are known in {counted}; else {shear['why']}")


def _say_residuals(compared: comparison.Residuals | None, *, has_offset: bool) -> dict[str, Any] | None:
    """Print and return the summary of the difference from the force sensor."""
    if compared is None:
        return None
    found = comparison.summary(compared)
    if has_offset:
        console.say("  the force sensor's zero is in its readings: no presses.csv states when the gel was free")
    for axis, numbers in found.items():
        if numbers["frames"]:
            console.say(
                f"  f{axis} less the force sensor's: rms {numbers['rms_N']:.3f} N over {numbers['frames']} of "
                f"{compared.touched} frames with contact, "
                f"{100 * (numbers['inside_interval95'] or 0):.0f} % inside the 95 % interval of both"
            )
    for why, count in compared.left_out.items():
        console.say(f"  {count} frames with contact are not compared: {why}")
    ratio = found["z"]["ratio"]
    if ratio is not None and not 0.5 < ratio < 2:
        console.warn([f"fz is {ratio:.2g} of the F/T reading: is this the calibration of another sensor?"])
    return found


def _figures(
    recording: Recording,
    job: ForceJob,
    rows: tuple[FrameForce, ...],
    folder: Path,
    *,
    compared: comparison.Residuals | None,
    most: int,
) -> list[dict[str, Any]]:
    """Draw the strongest frames, the resultant over time, its sensitivity to E and nu, and its residual."""
    sensitivity: list[dict[str, Any]] = []
    strength = comparison.strength_N(rows)
    drawn = {}
    for number in strongest_frames(recording, strength, most=most):
        solved = drawn[number] = job.solve(read_frame(recording, number))
        figure = draw.draw_force(solved.found, solved.height, shear=solved.shear)
        style.save_figure(figure, folder / f"{Path(rows[number].frame).stem}_force.png")
    best = int(np.nanargmax(strength)) if np.isfinite(strength).any() else -1
    if best >= 0 and strength[best] > 0:
        solved = drawn[best] if best in drawn else job.solve(read_frame(recording, best))
        ranges = material_sensitivity(job.field, solved.found, solved.height, solved.shear)
        sensitivity = _sensitivity(solved.found, ranges, folder)
    style.save_figure(draw.draw_resultants(rows, recording.presses), folder / "resultants.png")
    if compared is not None:
        style.save_figure(draw.draw_residuals(compared), folder / "residuals.png")
    console.say(f"figures are in {folder}")
    return sensitivity


def _sensitivity(found: TractionMap, ranges: tuple[Sensitivity, ...], folder: Path) -> list[dict[str, Any]]:
    """Draw and print the change of fz over the intervals of E and nu."""
    if not ranges:
        return []
    style.save_figure(draw.draw_sensitivity(found, ranges), folder / "sensitivity.png")
    said = [entry.as_json(found) for entry in ranges]
    for entry in said:
        low, high = entry["change_percent"]
        over = "over their joint" if entry["parameter"] == TOGETHER else "over its own"
        console.say(f"  {entry['parameter']} {over} 95 % interval moves fz by {low:+.1f} to {high:+.1f} %")
    return said
