"""Run the commands `depth` and `force`: frames into height maps and forces."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from tactilevision.cli import console, source
from tactilevision.errors import InputError
from tactilevision.records.maps import told

if TYPE_CHECKING:
    from tactilevision.batch.folder import FrameResult
    from tactilevision.batch.tree import Branch
    from tactilevision.force.calibrated import Sensitivity
    from tactilevision.force.comparison import Residuals
    from tactilevision.force.frame import ForceJob, FrameForce
    from tactilevision.heightmap.reconstructor import Reconstructor
    from tactilevision.press.certified_faces import FaceDepthCorrection
    from tactilevision.recording.model import Recording
    from tactilevision.records.maps import TractionMap
    from tactilevision.records.measured import Material


# `tactilevision depth PATH`: frames into height maps.


class MapFormat(StrEnum):
    """How height maps are stored."""

    TIFF = "tiff"
    ZARR = "zarr"


def depth(
    path: Annotated[Path, typer.Argument(help="A recording, video, frame, folder of frames, or a tree of these.")],
    out: console.OutOption = Path("depth_out"),
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    mm_per_px: source.ScaleOption = None,
    calibration: Annotated[
        Path | None,
        typer.Option(exists=True, dir_okay=False, help="calibration.json of this recording: holds the faces."),
    ] = None,
    form: Annotated[
        MapFormat, typer.Option("--format", help="One TIFF a frame, or one Zarr store.")
    ] = MapFormat.TIFF,
    with_std: Annotated[
        bool, typer.Option("--std", help="Also the depths' standard deviation, in depth_std/.")
    ] = False,
    even_so: source.EvenSoOption = False,
    workers: console.WorkersOption = None,
    cluster: console.ClusterOption = None,
    pictures: Annotated[int, typer.Option(min=0, help="How many of the deepest frames to draw.")] = 3,
    json: console.JsonOption = None,
) -> None:
    """Turn frames into height maps: depth/NAME.tiff in mm (float32, NaN where invalid), and depth.csv."""
    from tactilevision.batch.folder import reconstruct_folder
    from tactilevision.batch.tree import reconstruct_tree

    warned: list[str] = []
    chosen = source.Choice(sensor, reference, method, mm_per_px, even_so)
    light = _teller(chosen, warned, path)
    how: dict[str, Any] = {"form": form.value, "workers": workers, "cluster": cluster, "with_std": with_std}
    maps = "depth.zarr" if form is MapFormat.ZARR else "depth/NAME.tiff"
    if source.is_tree(path):
        if calibration is not None:
            raise InputError(
                "a calibration belongs to one recording, not to a tree of them",
                where=path,
                remedy="Name the recording, or leave --calibration out.",
            )
        how |= {"read": chosen.open_branch, "light": light, "method": chosen.way}
        with console.progress_bar("frames") as progress:
            branches = reconstruct_tree(path, out, progress=progress, **how)
        rows, refused = _gathered(branches)
        content = {"passed_over": refused, "faces_certified": False}
        maps = f"SOURCE/{maps}"
    else:
        recording = chosen.open(path)
        with console.progress_bar("calibrating the light"):
            reconstructor = light(recording)
            reconstructor, anchor = source.open_face_correction(recording, reconstructor, calibration=calibration)
        with console.progress_bar("frames") as progress:
            rows = reconstruct_folder(recording, reconstructor, out, anchor=anchor, progress=progress, **how)
        content = {"passed_over": {}, "faces_certified": anchor.depth_scale is not None}
        _draw(recording, reconstructor, rows, out / "figures", most=pictures, anchor=anchor)
    _tell(rows, out, maps)
    console.hand_over(_summary(rows) | content | {"warnings": warned}, json)
    if all(row.status != "ok" for row in rows):
        raise InputError(
            "no frame became a height map", where=out / "depth.csv", remedy="Its column `status` says why."
        )


def _teller(chosen: source.Choice, warned: list[str], root: Path) -> Callable[[Recording], Reconstructor]:
    """What makes the light of a recording below `root` ready, says what it warns of, and adds that to `warned`."""

    def tell(recording: Recording, lines: tuple[str, ...]) -> None:
        below = recording.path != root and recording.path.is_relative_to(root)
        name = recording.path.relative_to(root).as_posix() if below else recording.name
        words = [f"{name}: {line}" for line in lines]
        console.warn(words)
        warned.extend(words)

    def light(recording: Recording) -> Reconstructor:
        tell(recording, recording.warnings)
        reconstructor = chosen.light(recording)
        tell(recording, reconstructor.warnings)
        return reconstructor

    return light


def _gathered(branches: tuple[Branch, ...]) -> tuple[tuple[FrameResult, ...], dict[str, str]]:
    """The rows of all sources in a tree, frames by their path in it, and why others have none; says both."""
    for branch in branches:
        console.say(f"{branch.name}: " + (f"passed over: {branch.why}" if branch.why else _counted(branch.rows)))
    rows = tuple(replace(row, frame=branch.path_of(row)) for branch in branches for row in branch.rows)
    return rows, {branch.name: branch.why for branch in branches if branch.why}


def _summary(rows: tuple[FrameResult, ...]) -> dict[str, object]:
    return {
        "frames": len(rows),
        "statuses": dict(Counter(row.status.split(":")[0] for row in rows)),
        "bad": {row.frame: row.status for row in rows if row.status != "ok"},
        "flags": dict(Counter(flag for row in rows for flag in row.flags)),
    }


def _counted(rows: tuple[FrameResult, ...]) -> str:
    good = sum(row.status == "ok" for row in rows)
    return f"{good} of {len(rows)} frames became height maps"


def _tell(rows: tuple[FrameResult, ...], out: Path, maps: str) -> None:
    console.say(f"{_counted(rows)}: {out}/{maps}, {out / 'depth.csv'}")
    bad = [row for row in rows if row.status != "ok"]
    console.say_first([f"  {row.frame}: {row.status}" for row in bad], out / "depth.csv")
    best = max((row for row in rows if row.status == "ok"), key=lambda row: row.peak_mm, default=None)
    flagged = Counter(flag for row in rows for flag in row.flags)
    console.warn(told(flagged, len(rows)))
    if best is not None:
        console.say(f"  deepest: {best.frame}, {best.peak_mm:.3f} mm over {best.contact_area_mm2:.1f} mm²")


def _draw(
    recording: Recording,
    reconstructor: Reconstructor,
    rows: tuple[FrameResult, ...],
    folder: Path,
    *,
    most: int,
    anchor: FaceDepthCorrection,
) -> None:
    """The deepest frame of each of the deepest presses, or of stretches of the frames where there are none."""
    from tactilevision.cli import source as moments
    from tactilevision.plots import style
    from tactilevision.plots.height import draw_height_and_frame
    from tactilevision.recording.pictures import read_frame

    depth = [row.peak_mm if row.status == "ok" else float("nan") for row in rows]
    for number in moments.telling(recording, depth, most=most):
        frame = read_frame(recording, number)
        height = anchor(reconstructor.height_map(frame))
        figure = draw_height_and_frame(reconstructor.rectified(frame), height)
        path = folder / f"{Path(frame.name).stem}_depth.png"
        style.save_figure(figure, path)
        console.say(f"wrote {path}")


# `tactilevision force PATH --calibration calibration.json`: where the force goes, frame by frame.


class TractionFormat(StrEnum):
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
    form: Annotated[
        TractionFormat, typer.Option("--format", help="How tractions are stored.")
    ] = TractionFormat.NPZ,
    workers: console.WorkersOption = None,
    cluster: console.ClusterOption = None,
    pictures: Annotated[int, typer.Option(min=0, help="How many of the strongest frames to draw.")] = 3,
    json: console.JsonOption = None,
) -> None:
    """Turn frames into maps of traction on the gel (MPa) and resultants (N), with figures."""
    from tactilevision.force.comparison import write_comparison
    from tactilevision.force.folder import force_folder

    chosen = source.Choice(sensor, reference, method, mm_per_px, even_so)
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
    from tactilevision.records.rig import Gel

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


def _job(recording: Recording, chosen: source.Choice, known: _Known, out: Path, form: TractionFormat) -> ForceJob:
    """What turns a frame into forces: by the profile that was named, or by the recording's own light."""
    from tactilevision.force.folder import force_job

    sensor = chosen.calibrated(recording)
    reconstructor = chosen.light(recording)
    reconstructor, anchor = source.open_face_correction(recording, reconstructor, calibration=known.path)
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
    return replace(job, anchor=anchor)


def _shear(read: list[FrameForce]) -> dict[str, Any]:
    """In how many of the touched frames the tangential force is known, and the usual reason where it is not."""
    from collections import Counter

    from tactilevision.force.comparison import touches

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
    from tactilevision.force.comparison import summary

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
    from tactilevision.force.comparison import residuals
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
    from tactilevision.cli import source as moments
    from tactilevision.plots import force as draw, force as resultants, style
    from tactilevision.recording.pictures import read_frame

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
