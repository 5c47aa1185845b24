"""The frozen record of a recording, and the check for data that a step needs."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError, RecordingError, one_line
from tactilevision.recording import layout
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.display import Displayed, Summary
from tactilevision.records.measured import Curve, Floats, ForceSeries, Pair
from tactilevision.records.ranges import Ranged
from tactilevision.records.rig import Indenter, Press, Sensor


@dataclass(frozen=True, slots=True)
class BallPress(Ranged):
    """A ball pressed into the gel for photometric calibration.

    `centre_px` (x, y) and `contact_radius_px` are in the rectified frame; None: not recorded. `frame` is its name
    in ball.csv, if that is not the file's name alone.
    """

    path: Path
    ball_radius_mm: float
    centre_px: Pair | None = None
    contact_radius_px: float | None = None
    frame: str = ""

    @property
    def name(self) -> str:
        """Name in ball.csv."""
        return self.frame or self.path.name


@dataclass(frozen=True, slots=True)
class BadFrame:
    """A listed picture that is missing or damaged: `name`, `time_s` as listed, and `why`."""

    name: str
    time_s: float
    why: str


@dataclass(frozen=True, slots=True)
class StageSeries(Ranged):
    """Place of the motion stage, `z_mm` (T,) growing into the gel, at `time_s` (T,) on the F/T sensor's clock."""

    time_s: Floats
    z_mm: Floats


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording(Displayed):
    """One calibration run of one sensor.

    `frame_names` and `frame_times_s` (N,) list the pictures in `frames_path` (a folder, one video or None) on the
    camera's clock, NaN where the time is unknown; `frame_size_px` (width, height) is their size on disk, None if
    none could be read. `forces` and `force_std_N` are in the rectified frame's axes. `clock_offset_s` is F/T clock
    minus camera clock, None if it has to be estimated. `white_level` is the number of full white in the files,
    None for the largest of their bit depth. `flats` are pictures of the untouched gel; without any, `flat_frames`
    are the frames taken for it. `extra` holds the columns without a field here, by table and column; `settings` is
    recording.toml as written; `warnings` are for a person to read.
    """

    path: Path
    name: str
    sensor: Sensor
    date: datetime.date | None = None
    force_std_N: tuple[float, float, float] | None = None
    force_rate_Hz: float | None = None
    depth_source: Literal["vision", "stage", "gauge"] = "vision"
    depth_std_mm: float | None = None
    clock_offset_s: float | None = None
    indenters: Mapping[str, Indenter] = field(default_factory=dict)
    presses: tuple[Press, ...] = ()
    frames_path: Path | None = None
    frame_names: tuple[str, ...] = ()
    frame_times_s: Floats = field(default_factory=lambda: np.zeros(0))
    frame_size_px: tuple[int, int] | None = None
    forces: ForceSeries | None = None
    stage: StageSeries | None = None
    curves: tuple[Curve, ...] = ()
    points: tuple[CertifiedPoint, ...] = ()
    flats: tuple[Path, ...] = ()
    flat_frames: tuple[int, ...] = ()
    balls: tuple[BallPress, ...] = ()
    white_level: float | None = None
    extra: Mapping[str, Mapping[str, npt.NDArray[Any]]] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "warnings", tuple(map(one_line, self.warnings)))

    def summary(self) -> Summary:
        """Return the sensor, its gel, and how much of each kind there is."""
        gel, readings = self.sensor.gel, () if self.forces is None else self.forces.time_s
        names = ("frames", "presses", "force readings", "curves", "points", "ball presses", "flats")
        held = (self.frame_names, self.presses, readings, self.curves, self.points, self.balls, self.flats)
        punches = (f"{name} ({one.shape}, {one.radius_mm:g} mm)" for name, one in self.indenters.items())
        values = {
            "sensor": f"{self.sensor.kind} {self.sensor.serial}".rstrip(),
            "gel": "not described" if gel is None else f"{gel.thickness_mm:g} mm thick, {gel.shape}",
            "date": str(self.date or ""),
            "holds": ", ".join(f"{len(one)} {name}" for name, one in zip(names, held, strict=True) if len(one)),
            "indenters": ", ".join(punches),
        }
        return Summary(f"Recording {self.name}", values, self.warnings)


Need = Literal[
    "frames", "frame_times", "forces", "presses", "stage", "curves", "points", "flats", "balls", "gel", "indenters"
]


def _table(columns: layout.Columns) -> str:
    return f"Add the table: columns {', '.join(columns.required)}."


_SETTINGS_GEL = f"{layout.SETTINGS} [sensor.gel]"

_PLACES: dict[Need, tuple[str, str, str]] = {  # name, place, remedy
    "frames": ("pictures", layout.FRAMES, "Put the images there, or one video next to it."),
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
    """Return whether the pictures came without a recording.toml."""
    return not (recording.path / layout.SETTINGS).is_file()


@contextmanager
def faults_of_flats(recording: Recording) -> Iterator[None]:
    """Make errors of pictures of the untouched gel name where they are and, of a bare folder, --reference."""
    folder = recording.path / layout.FLATS
    own = {flat.parent for flat in recording.flats} <= {folder} and not is_bare(recording)
    with faults_of_reference(folder if own else place_of_flats(recording), option=not own):
        yield


@contextmanager
def faults_of_reference(where: Path | None, *, option: bool = True) -> Iterator[None]:
    """Make errors of pictures of the untouched gel name `where` they are (None: unchanged), and --reference."""
    try:
        yield
    except InputError as fault:
        if where is None or fault.where != layout.FLATS:
            raise
        other = " Name a picture of the untouched gel with --reference." if option else ""
        remedy = f"{fault.remedy}{other}".lstrip()
        raise InputError(fault.what, where=where, value=fault.value, remedy=remedy) from None


def place_of_flats(recording: Recording) -> Path:
    """Return the path of the picture of the untouched gel, or the folder of several.

    The recording if there is none.
    """
    names, frames = recording.frame_names, recording.frames_path
    flats = [*recording.flats, *(frames / names[k] for k in recording.flat_frames if frames is not None)]
    return flats[0] if len(flats) == 1 else flats[0].parent if flats else recording.path


def require(recording: Recording, *needs: Need, step: str) -> None:
    """Raise RecordingError for the first of `needs` that the recording lacks, naming the step and the file."""
    for need in needs:
        if not _has(recording, need):
            what, place, remedy = _PLACES[need]
            raise RecordingError(f"{step} needs {what}", where=recording.path / place, remedy=remedy)


def require_all(recording: Recording) -> None:
    """Raise RecordingError for what a certificate needs and the recording lacks, before any work is done."""
    require(recording, "frames", "frame_times", "forces", "presses", "indenters", step="certifying the presses")


def _has(recording: Recording, need: Need) -> bool:
    match need:
        case "frames":
            return bool(recording.frame_names)
        case "frame_times":
            return bool(recording.frame_names) and not np.isnan(recording.frame_times_s).any()
        case "flats":
            return bool(recording.flats or recording.flat_frames)
        case "gel":
            return recording.sensor.gel is not None
        case _:
            return bool(getattr(recording, need))
