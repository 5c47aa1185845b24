"""The one message for what a step needs and a recording lacks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np

from tactilevision.errors import InputError, RecordingError
from tactilevision.recording import layout
from tactilevision.recording.model import Recording

Need = Literal[
    "frames", "frame_times", "forces", "presses", "stage", "curves", "points", "flats", "balls", "gel", "indenters"
]


def _table(columns: layout.Columns) -> str:
    return f"Add the table: columns {', '.join(columns.required)}."


_SETTINGS_GEL = f"{layout.SETTINGS} [sensor.gel]"

# what it is called, where it belongs, what to put there
_PLACES: dict[Need, tuple[str, str, str]] = {
    "frames": ("pictures", layout.FRAMES, "Put the images there, or one video beside it."),
    "frame_times": ("the times of the frames", layout.FRAME_TABLE, _table(layout.FRAME_COLUMNS)),
    "forces": ("force readings", layout.FORCES, _table(layout.FORCE_COLUMNS)),
    "presses": ("the protocol of presses", layout.PRESSES, _table(layout.PRESS_COLUMNS)),
    "stage": ("the place of the motion stage", layout.STAGE, _table(layout.STAGE_COLUMNS)),
    "curves": ("curves of depth and force", layout.CURVES, _table(layout.CURVE_COLUMNS)),
    "points": ("certified points", layout.POINTS, _table(layout.POINT_COLUMNS)),
    "flats": ("a picture of the untouched gel", layout.FLATS, "Put one or more frames of it there."),
    "balls": ("ball presses", layout.BALL_TABLE, _table(layout.BALL_COLUMNS)),
    "gel": ("the thickness of the gel", _SETTINGS_GEL, "Add thickness_mm = ... there."),
    "indenters": ("the indenters", layout.SETTINGS, "Describe each one in a table [indenter.NAME]."),
}


def is_bare(recording: Recording) -> bool:
    """Whether its pictures came without a recording.toml."""
    return not (recording.path / layout.SETTINGS).is_file()


@contextmanager
def faults_of_flats(recording: Recording) -> Iterator[None]:
    """A fault of pictures of the untouched gel names where they are; of a bare folder, the option for others."""
    folder = recording.path / layout.FLATS
    own = {flat.parent for flat in recording.flats} <= {folder} and not is_bare(recording)
    with faults_of_reference(folder if own else place_of_flats(recording), option=not own):
        yield


@contextmanager
def faults_of_reference(where: Path | None, *, option: bool = True) -> Iterator[None]:
    """A fault of the pictures of the untouched gel names `where` they are (None: as it is), and --reference."""
    try:
        yield
    except InputError as fault:
        if where is None or fault.where != layout.FLATS:
            raise
        other = " Name a picture of the untouched gel with --reference." if option else ""
        remedy = f"{fault.remedy}{other}".lstrip()
        raise InputError(fault.what, where=where, value=fault.value, remedy=remedy) from None


def place_of_flats(recording: Recording) -> Path:
    """The picture of the untouched gel, or the folder of several; the recording where there is none."""
    names, frames = recording.frame_names, recording.frames_path
    flats = [*recording.flats, *(frames / names[k] for k in recording.flat_frames if frames is not None)]
    return flats[0] if len(flats) == 1 else flats[0].parent if flats else recording.path


def require(recording: Recording, *needs: Need, step: str) -> None:
    """Raise RecordingError for the first of `needs` that the recording lacks, naming the step and the file."""
    for need in needs:
        if not _has(recording, need):
            what, place, remedy = _PLACES[need]
            raise RecordingError(f"{step} needs {what}", where=recording.path / place, remedy=remedy)


def _has(recording: Recording, need: Need) -> bool:
    match need:
        case "frames":
            return bool(recording.frame_names)
        case "frame_times":
            return bool(recording.frame_names) and not np.isnan(recording.frame_times_s).any()
        case "forces":
            return recording.forces is not None
        case "stage":
            return recording.stage is not None
        case "flats":
            return bool(recording.flats or recording.flat_frames)
        case "gel":
            return recording.sensor.gel is not None
        case _:
            return bool(getattr(recording, need))
