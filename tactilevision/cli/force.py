"""`tactilevision force PATH --calibration calibration.json`: where the force goes, frame by frame."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from tactilevision.cli import console, source

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
    calibration: Annotated[Path, typer.Option(help="calibration.json, with E and nu.")],
    out: console.OutOption = Path("force_out"),
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    form: Annotated[Form, typer.Option("--format", help="How tractions are stored.")] = Form.NPZ,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one a core if left out.")] = None,
    cluster: console.ClusterOption = None,
    pictures: Annotated[int, typer.Option(min=0, help="How many of the strongest frames to draw.")] = 3,
    json: console.JsonOption = None,
) -> None:
    """Turn frames into maps of traction on the gel (MPa) and resultants (N), with figures."""
    from dataclasses import replace

    from tactilevision.force.calibrated import check_gel, read_clock_offset, read_material
    from tactilevision.force.folder import force_folder, force_job
    from tactilevision.force.recorded_comparison import write_comparison

    material = read_material(calibration)
    offset = read_clock_offset(calibration)
    recording = source.open_source(path, sensor, reference=reference)
    if recording.sensor.gel is not None:
        check_gel(calibration, recording.sensor.gel)
    with console.progress_bar("calibrating the light"):
        reconstructor = source.open_reconstructor(recording, method)
    console.warn([*recording.warnings, *reconstructor.warnings])
    anchor = source.open_face_correction(recording, reconstructor, calibration=calibration)
    job = replace(force_job(recording, reconstructor, material=material, out=out, form=form.value), anchor=anchor)
    with console.progress_bar("frames") as progress:
        rows = force_folder(
            recording, job, clock_offset_s=offset, workers=workers, cluster=cluster, progress=progress
        )
    read = [row for row in rows if row.read]
    console.say(f"{len(read)} of {len(rows)} frames: {job.store.path}, {out / 'resultants.csv'}")
    console.say_first([f"  {row.frame}: {row.why}" for row in rows if not row.read], out / "resultants.csv")
    content = {"frames": len(rows), "read": len(read), "material": _material(material)}
    content |= {"faces_certified": anchor.depth_scale is not None}
    content |= {"warnings": list(reconstructor.warnings)}
    content |= {"shear": _shear(read), "measured": _beside(rows)}
    beside = write_comparison(recording, rows, folder=out / "beside")
    if beside is not None:
        console.say(f"  `tactilevision diagnose {beside}` finds what separates depth and force")
    content |= {"sensitivity": _figures(recording, job, rows, out / "figures", most=pictures)}
    console.hand_over(content, json)


def _material(material: Material) -> dict[str, Any]:
    from tactilevision.records import Estimate

    found = {}
    values = (material.youngs_modulus_MPa, material.poisson_ratio)
    for k, (name, unit, value) in enumerate(
        zip(("youngs_modulus_MPa", "poisson_ratio"), ("MPa", "1"), values, strict=True)
    ):
        std = None if material.covariance is None else float(np.sqrt(material.covariance[k, k]))
        interval = None if std is None else (value - 1.96 * std, value + 1.96 * std)
        found[name] = Estimate(value, std, interval, unit).as_json()
    return found


def _shear(read: list[FrameForce]) -> dict[str, Any]:
    """In how many of the touched frames the tangential force is known, and the usual reason where it is not."""
    from collections import Counter

    from tactilevision.force.frame import nothing_touches

    touched = [row for row in read if not nothing_touches(row)]
    known = [row for row in touched if np.isfinite(row.resultant_N[0])]
    why = Counter(words for row in touched if row not in known for words in row.flags.split("; "))
    reason = next((words for words, _ in why.most_common() if "follow" in words or "shear" in words), "")
    if touched and not known:
        console.say(f"  fx and fy are not known: {reason}")
    return {"touched": len(touched), "known": len(known), "why": reason if len(known) < len(touched) else ""}


def _beside(rows: tuple[FrameForce, ...]) -> dict[str, Any] | None:
    from tactilevision.force.compare import summary

    found = _left(rows)
    if found is None:
        return None
    said = summary(found)
    for axis, numbers in said.items():
        if numbers["frames"]:
            console.say(
                f"  f{axis} less the force sensor's: rms {numbers['rms_N']:.3f} N over {numbers['frames']} frames "
                f"that touch, {100 * (numbers['inside_interval95'] or 0):.0f} % inside the 95 % interval"
            )
    ratio = said["z"]["ratio"]
    if ratio is not None and not 0.5 < ratio < 2:
        console.warn([f"fz is {ratio:.2g} of the F/T reading: is this the calibration of another sensor?"])
    return said


def _left(rows: tuple[FrameForce, ...]) -> Residuals | None:
    """What is left beside the F/T sensor; contacts that the border cuts count only where there are no others."""
    from tactilevision.force.compare import residuals
    from tactilevision.force.field import CUT

    found = residuals(rows, flagged=(CUT,))
    return found if found is None or found.usable.any() else residuals(rows)


def _strength(rows: tuple[FrameForce, ...]) -> list[float]:
    """fz of each frame, NaN for none; of contacts that the border cuts only where there are no others."""
    from tactilevision.force.field import CUT

    whole = [row.resultant_N[2] if row.read and CUT not in row.flags else float("nan") for row in rows]
    if any(force > 0 for force in whole):
        return whole
    return [row.resultant_N[2] if row.read else float("nan") for row in rows]


def _figures(
    recording: Recording, job: ForceJob, rows: tuple[FrameForce, ...], folder: Path, *, most: int
) -> list[dict[str, Any]]:
    """Draw the strongest frames, the course of the resultant, what E and nu do to it, and what is left."""
    from tactilevision.cli import moments
    from tactilevision.plots import force as draw
    from tactilevision.plots import resultants, style
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
    found = _left(rows)
    if found is not None:
        style.save_figure(resultants.draw_residuals(found), folder / "residuals.png")
    console.say(f"figures are in {folder}")
    return said


def _sensitivity(
    job: ForceJob, found: TractionMap, ranges: tuple[Sensitivity, ...], folder: Path
) -> list[dict[str, Any]]:
    from tactilevision.plots import force as draw
    from tactilevision.plots import style

    if not ranges:
        return []
    style.save_figure(draw.draw_sensitivity(found, ranges), folder / "sensitivity.png")
    said = [entry.as_json(found) for entry in ranges]
    for entry in said:
        low, high = entry["change_percent"]
        over = "over their joint" if entry["parameter"] == "both together" else "over its own"
        console.say(f"  {entry['parameter']} {over} 95 % interval moves fz by {low:+.1f} to {high:+.1f} %")
    return said
