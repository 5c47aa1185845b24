"""Reading a recording folder: everything but the pictures, checked, in one record."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import RecordingError
from tactilevision.recording import layout, pictures
from tactilevision.recording.checks import check_forces_cover, doubts
from tactilevision.recording.model import BallPress, Recording
from tactilevision.recording.protocol import read_curves, read_points, read_presses
from tactilevision.recording.sensor import build_sensor
from tactilevision.recording.series import as_three, read_forces, read_stage, rotation
from tactilevision.recording.tables import Table
from tactilevision.recording.video import count_frames
from tactilevision.records import Indenter, Sensor

if TYPE_CHECKING:
    from tactilevision.recording.settings import IndenterSettings, Settings

Columns = Mapping[str, npt.NDArray[Any]]


def read_recording(path: Path | str, *, sensor: Mapping[str, Any] | None = None) -> Recording:
    """Read a recording folder and check all that can be checked without decoding its pictures.

    `sensor` holds keys of [sensor] for what the file leaves out. Raises RecordingError, with file and line or key,
    for the first fault found. What is legal but unlikely stands in `Recording.warnings`.
    """
    # pydantic takes a while to load, and looking at the package should cost nothing
    from tactilevision.recording.settings_file import check_settings, load_toml

    root = Path(path)
    toml = _find_settings(root)
    content = load_toml(toml)
    settings, news = check_settings(content, toml)
    settings = _completed(settings, sensor or {})
    indenters = {name: _indenter(name, table) for name, table in settings.indenter.items()}
    recording = Recording(
        path=root,
        name=settings.name or root.resolve().name,
        sensor=Sensor("custom", 0, 0, (float("nan"), float("nan"))),
        date=settings.date,
        force_std_N=as_three(settings.force.std_N) if settings.force.std_N else None,
        force_rate_Hz=settings.force.rate_Hz,
        force_rotation=rotation(settings.force, toml),
        depth_source=settings.depth.source,
        depth_std_mm=settings.depth.std_mm,
        clock_offset_s=settings.clock.offset_s,
        indenters=indenters,
        settings=content,
        warnings=news,
    )
    recording = _with_pictures(recording, settings, toml)
    recording = _with_tables(recording, settings, toml)
    late = check_forces_cover(recording)
    return replace(recording, warnings=recording.warnings + late + tuple(doubts(recording)))


def _completed(settings: Settings, sensor: Mapping[str, Any]) -> Settings:
    """With keys of [sensor] that the file leaves out."""
    left_out = {key: value for key, value in sensor.items() if getattr(settings.sensor, key) is None}
    return settings.model_copy(update={"sensor": settings.sensor.model_copy(update=left_out)})


def _find_settings(root: Path) -> Path:
    if not root.exists():
        raise RecordingError("there is no such folder", where=root)
    if not root.is_dir():
        raise RecordingError(
            "a recording is a folder, not a file",
            where=root,
            remedy=f"Name the folder that holds {layout.SETTINGS}.",
        )
    names = sorted(found.name for found in root.iterdir())
    if not names:
        raise RecordingError(
            "the folder is empty", where=root, remedy=f"A recording holds {layout.SETTINGS} and its tables."
        )
    if layout.SETTINGS not in names:
        inner = sorted(found.parent.name for found in root.glob(f"*/{layout.SETTINGS}"))
        remedy = (
            f"Did you mean {root / inner[0]}?"
            if inner
            else f"It needs {layout.SETTINGS}, with format = {layout.FORMAT}."
        )
        raise RecordingError(f"is not a recording: {layout.SETTINGS} is missing", where=root, remedy=remedy)
    return root / layout.SETTINGS


def _with_pictures(recording: Recording, settings: Settings, toml: Path) -> Recording:
    """Add the list of frames, the references, and the sensor, whose size the pictures tell."""
    root = recording.path
    frames_path = pictures.find_frames(root)
    names: tuple[str, ...] = ()
    times, warnings, extra = np.zeros(0), names, dict[str, Columns]()
    if frames_path is None:
        _check_no_frames_needed(recording)
    elif _named(root, layout.FRAME_TABLE) or _is_calibration(root):
        table, warnings = pictures.list_frames(root, frames_path)
        names, times, extra = tuple(table.words["frame"]), table.numbers["time_s"], _extra(table)
        warnings += table.warnings
    else:
        names, times, warnings = _unlisted(frames_path)
    white = settings.sensor.white_level
    flats = pictures.find_flats(root)
    balls, ball_notes = pictures.find_balls(root)
    looked = (frames_path, names) if frames_path else _light_alone(root, flats, balls)
    size, seen = pictures.first_look(*looked, white_level=white) if looked else (None, ())
    sensor, notes = build_sensor(settings.sensor, toml, frame_size_px=size)
    if size is not None:
        first = [*flats[:1], *(ball.path for ball in balls[:1])]
        seen += pictures.check_references(size, first, white_level=white)
        seen += pictures.doubts_of_turning(frames_path, names, [*flats, *(ball.path for ball in balls)])
    return replace(
        recording,
        sensor=sensor,
        white_level=white,
        frames_path=frames_path,
        frame_names=names,
        frame_times_s=times,
        frame_size_px=size,
        flats=flats,
        balls=balls,
        extra=extra,
        warnings=recording.warnings + warnings + seen + notes + ball_notes,
    )


def _light_alone(root: Path, flats: Sequence[Path], balls: Sequence[BallPress]) -> tuple[Path, list[str]] | None:
    """Folder and names of the pictures that tell the size of a recording of ball presses and nothing else."""
    if not (flats and balls) or _named(root, layout.CURVES, layout.POINTS):
        return None
    return flats[0].parent, [flat.name for flat in flats]


def _check_no_frames_needed(recording: Recording) -> None:
    """Without pictures there must be curves, points or ball presses; a list of pictures must not be there."""
    root, folder = recording.path, recording.path / layout.FRAMES
    light_alone = _named(root, layout.BALL_TABLE) and not _is_calibration(root)
    listed = _named(root, layout.FRAME_TABLE)
    if listed or not (light_alone or _named(root, layout.CURVES, layout.POINTS)):
        others = sorted(path.name for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []
        if others:
            raise RecordingError(
                f"none of its {len(others)} files is a picture or a video of a known kind",
                where=folder,
                value=others[0],
                remedy=f"Save them as one of {', '.join(layout.IMAGE_SUFFIXES)}.",
            )
        if listed:
            raise RecordingError(
                "frames are listed, but there are no pictures",
                where=folder,
                remedy=f"Put them there, or remove {layout.FRAME_TABLE}.",
            )
        pictures.find_balls(root)  # ball presses without their table are named by it
        raise RecordingError(
            "the recording holds nothing to work on: neither frames nor curves nor points",
            where=root,
            remedy=f"Add {layout.FRAMES}/ with {layout.FRAME_TABLE}, or {layout.CURVES}, or {layout.POINTS}.",
        )


def _is_calibration(root: Path) -> bool:
    """Whether times matter: then a missing frames.csv is a fault at once."""
    return _named(root, layout.FORCES, layout.PRESSES)


def _named(root: Path, *names: str) -> bool:
    """Whether one of these stands in the folder, be it a pipe or a link to nowhere: its reader says so."""
    return any(os.path.lexists(root / name) for name in names)


def _unlisted(frames_path: Path) -> tuple[tuple[str, ...], npt.NDArray[np.float64], tuple[str, ...]]:
    if frames_path.is_file():
        names = tuple(str(index) for index in range(count_frames(frames_path)))
    else:
        names = tuple(pictures.list_images(frames_path))
    warning = f"{layout.FRAME_TABLE} is missing: frames are taken in the order of their names, without times"
    return names, np.full(len(names), np.nan), (warning,)


def _with_tables(recording: Recording, settings: Settings, toml: Path) -> Recording:
    """Add whichever tables there are."""
    root, tables = recording.path, list[Table]()
    found: dict[str, Any] = {}

    def keep(name: str, read: tuple[Any, Table]) -> None:
        found[name] = read[0]
        tables.append(read[1])

    if _named(root, layout.FORCES):
        keep("forces", read_forces(root / layout.FORCES, settings.force, toml=toml))
        found["force_std_N"] = found["forces"].std_N
        if not settings.force.std_N:
            found["warnings"] = (f"{toml.name}: [force] std_N is left out: it was estimated from {layout.FORCES}",)
    if _named(root, layout.PRESSES):
        keep("presses", read_presses(root / layout.PRESSES, recording.indenters))
    if _named(root, layout.STAGE):
        keep("stage", read_stage(root / layout.STAGE))
    if _named(root, layout.CURVES):
        keep("curves", read_curves(root / layout.CURVES))
    if _named(root, layout.POINTS):
        keep("points", read_points(root / layout.POINTS, recording.indenters))
    notes = tuple(note for table in tables for note in table.warnings) + found.pop("warnings", ())
    extra = dict(recording.extra)
    for table in tables:
        extra |= _extra(table)
    return replace(recording, **found, extra=extra, warnings=recording.warnings + notes)


def _extra(table: Table) -> dict[str, Columns]:
    return {table.path.name: table.extra} if table.extra else {}


def _indenter(name: str, settings: IndenterSettings) -> Indenter:
    found = settings.model_dump(include=set(Indenter.__dataclass_fields__) - {"name"}, exclude_none=True)
    return Indenter(name=name, **found)
