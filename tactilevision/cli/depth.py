"""Command `depth`: height maps of frames."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.batch.folder import FrameResult, reconstruct_folder, summary
from tactilevision.batch.selection import strongest_frames
from tactilevision.batch.tree import Light, reconstruct_tree
from tactilevision.cli import console, options, source
from tactilevision.errors import InputError
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.protocols import Progress, silent
from tactilevision.plots import style
from tactilevision.plots.height import draw_height
from tactilevision.press.certified_faces import FaceDepthCorrection
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.maps import flag_messages


def depth(given: options.Depth) -> None:
    """Turn frames into height maps: depth/NAME.tiff in mm (float32, NaN where invalid), and depth.csv."""
    chosen = source.Choice(given.sensor, given.reference, given.method, given.mm_per_px, given.even_so)
    if given.device is not None and given.cluster is None:
        from tactilevision.heightmap.device import find_device  # takes seconds to load

        find_device(given.device)
    how: dict[str, Any] = {"form": given.form, "workers": given.workers, "cluster": given.cluster} | {
        "with_std": given.with_std,
        "device": given.device,
    }
    maps, warned = "depth.zarr" if given.form == "zarr" else "depth/NAME.tiff", list[str]()
    light, last = _light(chosen, warned, given.path), list[str]()
    if source.is_tree(given.path):
        rows, content = _of_tree(given.path, given.out, chosen, light, given.calibration, how)
        maps = f"SOURCE/{maps}"
    else:
        recording = chosen.open(given.path)
        rows, content = _of_recording(recording, given.out, light, given.calibration, how, most=given.pictures)
        last = how_to_keep_light(chosen, recording)
    _say(rows, given.out, maps)
    console.say(*last)
    console.hand_over(summary(rows) | content | {"warnings": warned}, given.json)
    if all(row.status != "ok" for row in rows):
        table, remedy = given.out / "depth.csv", "Its column `status` has the reasons."
        raise InputError("no frame became a height map", where=table, remedy=remedy)


def how_to_keep_light(chosen: source.Choice, recording: Recording) -> list[str]:
    """Return a line with the command that keeps a light of the recording's own balls; none for another light."""
    own = chosen.method is None and chosen.profile is None and recording.balls
    return [f"to keep this light for --sensor: tactilevision calibrate-sensor {recording.path}"] if own else []


def _light(chosen: source.Choice, warned: list[str], root: Path) -> Light:
    """Return the function that calibrates the light of a recording below `root`, and collects its warnings."""

    def warn(recording: Recording, lines: tuple[str, ...]) -> None:
        below = recording.path != root and recording.path.is_relative_to(root)
        name = recording.path.relative_to(root).as_posix() if below else recording.name
        words = [f"{name}: {line}" for line in lines]
        console.warn(words)
        warned.extend(words)

    def light(recording: Recording, progress: Progress = silent) -> Reconstructor:
        warn(recording, recording.warnings)
        reconstructor = chosen.light(recording, progress)
        warn(recording, reconstructor.warnings)
        return reconstructor

    return light


def _of_tree(
    path: Path, out: Path, chosen: source.Choice, light: Light, calibration: Path | None, how: dict[str, Any]
) -> tuple[tuple[FrameResult, ...], dict[str, Any]]:
    """Return the rows of all sources in a tree, with frames by their path, and why others were skipped."""
    if calibration is not None:
        raise InputError(
            "a calibration belongs to one recording, not to a tree of recordings",
            where=path,
            remedy="Name the recording, or omit --calibration.",
        )
    with console.progress_bar("frames") as progress:
        branches = reconstruct_tree(
            path, out, read=chosen.open_branch, light=light, method=chosen.way, progress=progress, **how
        )
    for branch in branches:
        console.say(f"{branch.name}: " + (f"passed over: {branch.why}" if branch.why else _counted(branch.rows)))
    rows = tuple(replace(row, frame=branch.path_of(row)) for branch in branches for row in branch.rows)
    refused = {branch.name: branch.why for branch in branches if branch.why}
    return rows, {"passed_over": refused, "faces_certified": False}


def _of_recording(
    recording: Recording, out: Path, light: Any, calibration: Path | None, how: dict[str, Any], *, most: int
) -> tuple[tuple[FrameResult, ...], dict[str, Any]]:
    """Return the rows of a recording, whose `most` deepest frames are drawn."""
    with console.progress_bar("calibrating the light:") as progress:
        made = light(recording, progress)
        reconstructor, anchor = source.open_face_correction(recording, made, calibration=calibration)
    with console.progress_bar("frames") as progress:
        rows = reconstruct_folder(recording, reconstructor, out, anchor=anchor, progress=progress, **how)
    _draw(recording, reconstructor, rows, out / "figures", most=most, anchor=anchor)
    return rows, {"passed_over": {}, "faces_certified": anchor.depth_scale is not None}


def _counted(rows: tuple[FrameResult, ...]) -> str:
    good = sum(row.status == "ok" for row in rows)
    return f"{good} of {len(rows)} frames became height maps"


def _say(rows: tuple[FrameResult, ...], out: Path, maps: str) -> None:
    console.say(f"{_counted(rows)}: {out}/{maps}, {out / 'depth.csv'}")
    bad = [row for row in rows if row.status != "ok"]
    console.say_first([f"  {row.frame}: {row.status}" for row in bad], out / "depth.csv")
    best = max((row for row in rows if row.trusted), key=lambda row: row.peak_mm, default=None)
    flagged = Counter(flag for row in rows for flag in row.flags)
    console.warn(flag_messages(flagged, len(rows) - len(bad)))
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
    """Draw the deepest frame of each of the deepest presses, or of parts of the frames where there are none.

    Frames whose maps can be trusted come first.
    """
    trusted = any(row.trusted for row in rows)
    depth = [row.peak_mm if row.trusted or (row.status == "ok" and not trusted) else np.nan for row in rows]
    for number in strongest_frames(recording, depth, most=most):
        frame = read_frame(recording, number)
        height = anchor(reconstructor.height_map(frame))
        figure = draw_height(height, reconstructor.rectified(frame))
        path = folder / f"{Path(frame.name).stem}_depth.png"
        style.save_figure(figure, path)
        console.say(f"wrote {path}")
