"""What a recording is, once read: one frozen record, its pictures still on disk."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tactilevision.records import CertifiedPoint, Curve, Floats, ForceSeries, Indenter, Pair, Press, Sensor


@dataclass(frozen=True, slots=True)
class BallPress:
    """A ball pressed into the gel for photometric calibration.

    `centre_px` (x, y) and `contact_radius_px` are in the rectified frame; None where they were not recorded.
    `frame` is its name in ball.csv, where that is not the file's name alone.
    """

    path: Path
    ball_radius_mm: float
    centre_px: Pair | None = None
    contact_radius_px: float | None = None
    frame: str = ""

    @property
    def name(self) -> str:
        """As it stands in ball.csv."""
        return self.frame or self.path.name


@dataclass(frozen=True, slots=True)
class BadFrame:
    """A picture that is listed but absent, or cannot be read whole: `name`, `time_s` as listed, and `why`."""

    name: str
    time_s: float
    why: str


@dataclass(frozen=True, slots=True)
class StageSeries:
    """Place of the motion stage, `z_mm` (T,) growing into the gel, at `time_s` (T,) on the F/T sensor's clock."""

    time_s: Floats
    z_mm: Floats


def _no_times() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One calibration run of one sensor.

    `frame_names` and `frame_times_s` (N,) list the pictures in `frames_path` (a folder, or one video; None
    where there is none) on the camera's clock, NaN where no time is known; `frame_size_px` (width, height) is
    theirs as they are on disk, None where none could be read. `forces` and `force_std_N` are in
    the rectified frame's axes: `force_rotation` (3, 3) has been applied already. `clock_offset_s` is F/T clock
    minus camera clock, None where it has to be estimated. `white_level` is the number that full white has
    in the files, None for the largest their bit depth holds. `flats` are pictures of the untouched gel; where
    there are none, `flat_frames` are the frames that are taken for it. `extra` keeps the columns that have no
    field here, by table and column; `settings` is recording.toml as written; `warnings` what a person should see.
    """

    path: Path
    name: str
    sensor: Sensor
    date: datetime.date | None = None
    force_std_N: tuple[float, float, float] | None = None
    force_rate_Hz: float | None = None
    force_rotation: Floats | None = None
    depth_source: Literal["vision", "stage", "gauge"] = "vision"
    depth_std_mm: float | None = None
    clock_offset_s: float | None = None
    indenters: Mapping[str, Indenter] = field(default_factory=dict)
    presses: tuple[Press, ...] = ()
    frames_path: Path | None = None
    frame_names: tuple[str, ...] = ()
    frame_times_s: Floats = field(default_factory=_no_times)
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
