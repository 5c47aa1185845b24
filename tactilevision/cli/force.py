"""`tactilevision force PATH --calibration calibration.json`: where the force goes, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from tactilevision.cli import console, source
from tactilevision.errors import InputError

if TYPE_CHECKING:
    from tactilevision.force.calibrated import Sensitivity
    from tactilevision.force.compare import Residuals
    from tactilevision.force.frame import ForceJob, FrameForce
    from tactilevision.recording import Recording
    from tactilevision.records import Material, TractionMap


class Form(StrEnum):
    """How tractions are stored."""

    NPZ = "npz"
    ZARR = "zarr"


def force(
    path: Annotated[Path, typer.Argument(help="A recording, a video, or a folder of frames.")],
    calibration: Annotated[
        Path | None, typer.Option(help="calibration.json, with E and nu; of a profile its own if left out.")
    ] = None,
    out: console.OutOption = Path("force_out"),
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    even_so: source.EvenSoOption = False,
    mm_per_px: source.ScaleOption = None,
    form: Annotated[Form, typer.Option("--format", help="How tractions are stored.")] = Form.NPZ,
    shadows: source.ShadowsOption = True,
    workers: console.WorkersOption = None,
    cluster: console.ClusterOption = None,
    pictures: Annotated[int, typer.Option(min=0, help="How many of the strongest frames to draw.")] = 3,
    json: console.JsonOption = None,
) -> None:
    """Turn frames into maps of traction on the gel (MPa) and resultants (N), with figures."""
    from tactilevision.force.folder import force_folder
    from tactilevision.force.recorded_comparison import write_comparison

    chosen = source.Choice(sensor, reference, method, mm_per_px, shadows, even_so)
    known = _known_material(chosen, calibration)
    recording, material, offset = _with_gel(chosen.open(path), known), known.material, known.clock_offset_s
    with console.progress_bar("calibrating the light"):
        job = _job(recording, chosen, known, out, form)
    reconstructor, anchor = job.reconstructor, job.anchor
    console.warn([*recording.warnings, *reconstructor.warnings])
    with console.progress_bar("frames") as progress:
        rows = force_folder(
            recording, job, clock_offset_s=offset, workers=workers, cluster=cluster, progress=progress
        )
    read = [row for row in rows if row.read]
    console.say(f"{len(read)} of {len(rows)} frames: {job.store.path}, {out / 'resultants.csv'}")
    console.say_first([f"  {row.frame}: {row.why}" for row in rows if not row.read], out / "resultants.csv")
    content = {"frames": len(rows), "read": len(read), "material": material.as_json()}
    content |= {"faces_certified": anchor.depth_scale is not None}
    content |= {"warnings": list(reconstructor.warnings)}
    left = _left(rows, recording.force_std_N)
    content |= {"shear": _shear(read), "measured": _beside(left, zero_left=not recording.presses)}
    beside = write_comparison(recording, rows, folder=out / "beside")
    if beside is not None:
        console.say(f"  `tactilevision diagnose {beside}` finds what separates depth and force")
    content |= {"sensitivity": _figures(recording, job, rows, out / "figures", left=left, most=pictures)}
    console.hand_over(content, json)


@dataclass(frozen=True, slots=True)
class _Known:
    """E and nu; the clock's offset and the gel's thickness beside them, where they are said; and where from."""

    material: Material
    clock_offset_s: float | None
    thickness_mm: float | None
    path: Path | None


def _known_material(chosen: source.Choice, calibration: Path | None) -> _Known:
    """Of the calibration.json that was named, else of the profile. Raises InputError where there is neither."""
    from tactilevision.force.calibrated import read_clock_offset, read_material, read_thickness_mm

    if calibration is not None:
        offset, thickness_mm = read_clock_offset(calibration), read_thickness_mm(calibration)
        return _Known(read_material(calibration), offset, thickness_mm, calibration)
    profile = chosen.profile
    if profile is None:
        raise InputError(
            "E and nu of the gel are not known",
            where="force",
            remedy="Name what `calibrate` wrote with --calibration, or a profile with --sensor.",
        )
    if profile.material is None:
        raise InputError(
            "the profile holds no E and nu of its gel",
            where=profile.path,
            remedy="Name a calibration.json with --calibration, or make the profile with one.",
        )
    return _Known(profile.material, None, None, None)


def _with_gel(recording: Recording, known: _Known) -> Recording:
    """The recording; where its gel is not described, with a gel as thick as the calibration's, which is said."""
    from tactilevision.force.calibrated import check_gel
    from tactilevision.records import Gel

    gel = recording.sensor.gel
    if gel is not None:
        if known.path is not None:
            check_gel(known.path, gel)
        return recording
    if known.thickness_mm is None:
        return recording
    said = f"guessed: the gel is {known.thickness_mm:g} mm thick, as the calibration's, and has no sides nearby"
    sensor = replace(recording.sensor, gel=Gel(known.thickness_mm))
    return replace(recording, sensor=sensor, warnings=(*recording.warnings, said))


def _job(recording: Recording, chosen: source.Choice, known: _Known, out: Path, form: Form) -> ForceJob:
    """What turns a frame into forces: by the profile that was named, or by the recording's own light."""
    from tactilevision.force.folder import force_job

    sensor = chosen.calibrated(recording)
    reconstructor = chosen.light(recording)
    fits = sensor is not None and known.path is None
    job = force_job(
        recording,
        reconstructor,
        material=known.material,
        out=out,
        form=form.value,
        untouched=sensor.untouched if sensor else None,
        compliance=sensor.compliance if sensor and fits else None,
    )
    anchor = source.open_face_correction(recording, reconstructor, calibration=known.path)
    return replace(job, anchor=anchor)


def _shear(read: list[FrameForce]) -> dict[str, Any]:
    """In how many of the touched frames the tangential force is known, and the usual reason where it is not."""
    from collections import Counter

    from tactilevision.force.compare import touches

    touched = [row for row in read if touches(row)]
    known = [row for row in touched if np.isfinite(row.resultant_N[0])]
    why = Counter(words for row in touched if row not in known for words in row.flags.split("; "))
    reason = next((words for words, _ in why.most_common() if "follow" in words or "shear" in words), "")
    if touched and not known:
        console.say(f"  fx and fy are not known: {reason}")
    elif len(known) < len(touched):
        console.say(f"  fx and fy are known in {len(known)} of {len(touched)} frames that touch; else {reason}")
    return {"touched": len(touched), "known": len(known), "why": reason if len(known) < len(touched) else ""}


def _beside(found: Residuals | None, *, zero_left: bool) -> dict[str, Any] | None:
    from tactilevision.force.compare import summary

    if found is None:
        return None
    said = summary(found)
    if zero_left:
        console.say("  the force sensor's zero is in its readings: no presses.csv says when the gel was free")
    for axis, numbers in said.items():
        if numbers["frames"]:
            console.say(
                f"  f{axis} less the force sensor's: rms {numbers['rms_N']:.3f} N over {numbers['frames']} of "
                f"{found.touched} frames that touch, "
                f"{100 * (numbers['inside_interval95'] or 0):.0f} % inside the 95 % interval of both"
            )
    for why, count in found.left_out.items():
        console.say(f"  {count} frames that touch are not compared: {why}")
    ratio = said["z"]["ratio"]
    if ratio is not None and not 0.5 < ratio < 2:
        console.warn([f"fz is {ratio:.2g} of the F/T reading: is this the calibration of another sensor?"])
    return said


def _left(rows: tuple[FrameForce, ...], reading_std_N: Sequence[float] | None) -> Residuals | None:
    """What is left beside the F/T sensor; contacts that the border cuts count only where there are no others."""
    from tactilevision.force.compare import residuals
    from tactilevision.force.field import CUT

    found = residuals(rows, flagged=(CUT,), reading_std_N=reading_std_N)
    return found if found is None or found.usable.any() else residuals(rows, reading_std_N=reading_std_N)


def _strength(rows: tuple[FrameForce, ...]) -> list[float]:
    """fz of each frame, NaN for none; of contacts that the border cuts only where there are no others."""
    from tactilevision.force.field import CUT

    whole = [row.resultant_N[2] if row.read and CUT not in row.flags else float("nan") for row in rows]
    if any(force > 0 for force in whole):
        return whole
    return [row.resultant_N[2] if row.read else float("nan") for row in rows]


def _figures(
    recording: Recording,
    job: ForceJob,
    rows: tuple[FrameForce, ...],
    folder: Path,
    *,
    left: Residuals | None,
    most: int,
) -> list[dict[str, Any]]:
    """Draw the strongest frames, the course of the resultant, what E and nu do to it, and what is left."""
    from tactilevision.cli import moments
    from tactilevision.plots import force as draw, resultants, style
    from tactilevision.recording import read_frame

    said: list[dict[str, Any]] = []
    strength = _strength(rows)
    for number in moments.telling(recording, strength, most=most):
        solved = job.solve(read_frame(recording, number))
        figure = draw.draw_force(solved.found, solved.height, shear=solved.shear)
        style.save_figure(figure, folder / f"{Path(rows[number].frame).stem}_force.png")
    best = int(np.nanargmax(strength)) if np.isfinite(strength).any() else -1
    if best >= 0 and strength[best] > 0:
        solved = job.solve(read_frame(recording, best))
        said = _sensitivity(job, solved.found, job.sensitivity(solved), folder)
    style.save_figure(resultants.draw_resultants(rows, recording.presses), folder / "resultants.png")
    if left is not None:
        style.save_figure(resultants.draw_residuals(left), folder / "residuals.png")
    console.say(f"figures are in {folder}")
    return said


def _sensitivity(
    job: ForceJob, found: TractionMap, ranges: tuple[Sensitivity, ...], folder: Path
) -> list[dict[str, Any]]:
    from tactilevision.plots import force as draw, style

    if not ranges:
        return []
    style.save_figure(draw.draw_sensitivity(found, ranges), folder / "sensitivity.png")
    said = [entry.as_json(found) for entry in ranges]
    for entry in said:
        low, high = entry["change_percent"]
        over = "over their joint" if entry["parameter"] == "both together" else "over its own"
        console.say(f"  {entry['parameter']} {over} 95 % interval moves fz by {low:+.1f} to {high:+.1f} %")
    return said
