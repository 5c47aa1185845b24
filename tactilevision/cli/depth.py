"""`tactilevision depth PATH`: frames into height maps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactilevision.cli import console, source
from tactilevision.errors import InputError
from tactilevision.records.flags import told

if TYPE_CHECKING:
    from tactilevision.batch.folder import FrameResult
    from tactilevision.batch.tree import Branch
    from tactilevision.certificate.depth.face_depth import FaceDepthCorrection
    from tactilevision.reconstruct import Reconstructor
    from tactilevision.recording import Recording


class Form(StrEnum):
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
    form: Annotated[Form, typer.Option("--format", help="One TIFF a frame, or one Zarr store.")] = Form.TIFF,
    with_std: Annotated[
        bool, typer.Option("--std", help="Also the depths' standard deviation, in depth_std/.")
    ] = False,
    even_so: source.EvenSoOption = False,
    shadows: source.ShadowsOption = True,
    workers: console.WorkersOption = None,
    cluster: console.ClusterOption = None,
    pictures: Annotated[int, typer.Option(min=0, help="How many of the deepest frames to draw.")] = 3,
    json: console.JsonOption = None,
) -> None:
    """Turn frames into height maps: depth/NAME.tiff in mm (float32, NaN where invalid), and depth.csv."""
    from tactilevision.batch.folder import reconstruct_folder
    from tactilevision.batch.tree import reconstruct_tree

    warned: list[str] = []
    chosen = source.Choice(sensor, reference, method, mm_per_px, shadows, even_so)
    light = _teller(chosen, warned, path)
    how: dict[str, Any] = {"form": form.value, "workers": workers, "cluster": cluster, "with_std": with_std}
    maps = "depth.zarr" if form is Form.ZARR else "depth/NAME.tiff"
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
            anchor = source.open_face_correction(recording, reconstructor, calibration=calibration)
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
    from tactilevision.cli import moments
    from tactilevision.plots import style
    from tactilevision.plots.height import draw_height_and_frame
    from tactilevision.recording import read_frame

    depth = [row.peak_mm if row.status == "ok" else float("nan") for row in rows]
    for number in moments.telling(recording, depth, most=most):
        frame = read_frame(recording, number)
        height = anchor(reconstructor.height_map(frame))
        figure = draw_height_and_frame(reconstructor.rectified(frame), height)
        path = folder / f"{Path(frame.name).stem}_depth.png"
        style.save_figure(figure, path)
        console.say(f"wrote {path}")
