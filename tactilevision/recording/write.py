"""Write a recording: settings, maps, pictures and tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import tomli_w

from tactilevision.errors import InputError
from tactilevision.files.documents import csv_text
from tactilevision.files.writing import replacing, write_text
from tactilevision.recording import layout
from tactilevision.recording.model import BallPress, Recording
from tactilevision.recording.read_tables import point_columns
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Bytes, Curve, Floats, ForceSeries
from tactilevision.records.rig import Gel, Press, Sensor
from tactilevision.sensors.rectification import save_rectification

# Tables. Each function takes the folder. Numbers have 12 digits, large ones (times in s since 1970) all, NaN is an
# empty cell; empty optional columns are omitted. Files are written atomically.

_Columns = Mapping[str, Sequence[Any] | npt.NDArray[Any]]
_NOTHING: _Columns = MappingProxyType({})
LARGE = 10**7  # beyond it 12 digits resolve a time in s to 10 microseconds at best
_JOINED = ("details", "edge_profile", "extra")  # fields that are written as columns of their own


def write_table(path: Path | str, columns: _Columns) -> None:
    """Write any table: columns of equal length, in the order given."""
    rows = zip(*(map(table_cell, column) for column in columns.values()), strict=True)
    write_text(path, csv_text(chain([tuple(columns)], rows)))


def write_frame_table(
    folder: Path | str, names: Sequence[str], *, times_s: Floats, extra: _Columns = _NOTHING
) -> None:
    """Write frames.csv of times (n,) in s; `extra`, here and below: further columns of the same length."""
    write_table(Path(folder) / layout.FRAME_TABLE, {"frame": names, "time_s": times_s, **extra})


def write_forces(folder: Path | str, forces: ForceSeries, *, extra: _Columns = _NOTHING) -> None:
    """Write forces.csv, in the rectified frame's axes, without [force] rotation."""
    columns: dict[str, Any] = dict(
        zip(layout.FORCE_COLUMNS.numbers, (forces.time_s, *forces.force_N.T), strict=True)
    )
    if forces.torque_Nm is not None:
        columns |= zip(layout.FORCE_COLUMNS.maybe_numbers, forces.torque_Nm.T, strict=False)
    if forces.temperature_C is not None:
        columns["temperature_C"] = forces.temperature_C
    write_table(Path(folder) / layout.FORCES, columns | dict(extra))


def write_points(folder: Path | str, points: Sequence[CertifiedPoint]) -> None:
    """Write points.csv; `accepted` and `reason` are always written, to mark rejected points."""
    always = (*layout.POINT_COLUMNS.required, "accepted", "reason")
    further = [point_columns(point) for point in points]
    write_table(Path(folder) / layout.POINTS, _record_columns(points, further, always, CertifiedPoint))


def write_curves(folder: Path | str, curves: Sequence[Curve]) -> None:
    """Write curves.csv, one curve after the other."""
    counts = [len(curve.time_s) for curve in curves]
    columns: dict[str, Any] = {
        "press": [curve.press for curve, count in zip(curves, counts, strict=True) for _ in range(count)],
        "time_s": _joined(curve.time_s for curve in curves),
        "depth_mm": _joined(curve.depth_mm for curve in curves),
    }
    for axis, name in enumerate(("fx_N", "fy_N", "fz_N")):
        columns[name] = _joined(curve.force_N[:, axis] for curve in curves)
    columns["phase"] = _joined(curve.phase for curve in curves)
    columns["z_mm"] = _joined(
        [None] * n if c.z_mm is None else c.z_mm for c, n in zip(curves, counts, strict=True)
    )
    extra = dict.fromkeys(name for curve in curves for name in curve.extra)
    for name in extra:
        columns[name] = _joined(c.extra.get(name, [""] * n) for c, n in zip(curves, counts, strict=True))
    write_table(Path(folder) / layout.CURVES, _without_empty(columns, (*layout.CURVE_COLUMNS.required, *extra)))


def write_balls(folder: Path | str, balls: Sequence[BallPress]) -> None:
    """Write reference/ball.csv; the pictures go into reference/ball."""
    columns: dict[str, Any] = {
        "frame": [ball.name for ball in balls],
        "ball_radius_mm": [ball.ball_radius_mm for ball in balls],
        "centre_x_px": [(ball.centre_px or (None, None))[0] for ball in balls],
        "centre_y_px": [(ball.centre_px or (None, None))[1] for ball in balls],
        "contact_radius_px": [ball.contact_radius_px for ball in balls],
    }
    write_table(Path(folder) / layout.BALL_TABLE, _without_empty(columns, layout.BALL_COLUMNS.required))


def _record_columns(
    records: Sequence[Press] | Sequence[CertifiedPoint],
    further: Sequence[Mapping[str, Any]],
    always: Sequence[str],
    kind: type = Press,
) -> _Columns:
    """Return the columns of the records' plain fields in their order, then of their `further` cells."""
    names = [field.name for field in fields(kind) if field.name not in _JOINED]
    columns: dict[str, list[Any]] = {name: [getattr(record, name) for record in records] for name in names}
    for name in dict.fromkeys(name for cells in further for name in cells):
        columns[name] = [cells.get(name, "") for cells in further]
    return _without_empty(columns, always)


def _without_empty(columns: Mapping[str, Any], always: Sequence[str]) -> _Columns:
    return {name: column for name, column in columns.items() if name in always or any(map(table_cell, column))}


def _joined(parts: Iterable[Any]) -> list[Any]:
    return [value for part in parts for value in (part.tolist() if isinstance(part, np.ndarray) else part)]


def table_cell(value: Any) -> str:
    """Format one cell: 12 digits, all of them if large, "" for unknown, true or false."""
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, float | np.floating):
        number = float(value)
        return "" if math.isnan(number) else f"{number:.12g}" if abs(number) < LARGE else repr(number)
    return "" if value is None else str(value)


MAPS = "maps.npz"


def write_recording(recording: Recording) -> None:
    """Write everything but the pictures into `recording.path`.

    recording.toml is written last, so that an unfinished folder is not a recording. Forces are in the rectified
    frame's axes, so no [force] rotation is written.
    """
    folder = recording.path
    if recording.frame_names:
        write_frame_table(
            folder,
            recording.frame_names,
            times_s=recording.frame_times_s,
            extra=_extra(recording, layout.FRAME_TABLE),
        )
    if recording.forces is not None:
        write_forces(folder, recording.forces, extra=_extra(recording, layout.FORCES))
    if recording.stage is not None:
        stage = {"time_s": recording.stage.time_s, "z_mm": recording.stage.z_mm}
        write_table(folder / layout.STAGE, stage | dict(_extra(recording, layout.STAGE)))
    if recording.presses:
        further = [press.extra for press in recording.presses]
        required = layout.PRESS_COLUMNS.required
        write_table(folder / layout.PRESSES, _record_columns(recording.presses, further, required))
    if recording.curves:
        write_curves(folder, recording.curves)
    if recording.points:
        write_points(folder, recording.points)
    if recording.balls:
        write_balls(folder, recording.balls)
    if recording.sensor.rectification is not None:
        save_rectification(recording.sensor, folder / MAPS)
    write_settings(recording)


def write_settings(recording: Recording) -> None:
    """Write recording.toml from the record; unknown values are omitted."""
    std_N = recording.forces.std_N if recording.forces is not None else recording.force_std_N
    content: dict[str, Any] = {
        "format": layout.FORMAT,
        "name": recording.name,
        "date": recording.date,
        "sensor": sensor_table(recording.sensor, white_level=recording.white_level),
        "force": {
            "std_N": std_N if std_N is None or np.isfinite(std_N).all() else None,
            "rate_Hz": recording.force_rate_Hz,
        },
        "depth": {"source": recording.depth_source, "std_mm": recording.depth_std_mm},
        "clock": {"offset_s": recording.clock_offset_s},
        "indenter": {name: asdict(one) | {"name": None} for name, one in recording.indenters.items()},
    }
    write_text(recording.path / layout.SETTINGS, tomli_w.dumps(_known(content)))


def write_image(path: Path | str, rgb: Bytes, *, jpeg_quality: int = 95) -> None:
    """Write a picture (H, W, 3) uint8, red, green, blue, in the format of the name's ending.

    JPEG keeps the colours at full resolution, since slopes are read from them.
    """
    path = Path(path)
    if path.suffix.lower() == ".npy":
        with replacing(path) as temporary:
            np.save(temporary, rgb, allow_pickle=False)
        return
    if path.suffix.lower() not in layout.IMAGE_SUFFIXES:
        raise InputError("pictures are written as " + ", ".join(layout.IMAGE_SUFFIXES), where=path)
    options = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]  # smallest for noisy pictures
    if path.suffix.lower() in (".jpg", ".jpeg"):
        full = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
        options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality, *full]
    _, data = cv2.imencode(path.suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


def _extra(recording: Recording, table: str) -> Mapping[str, Any]:
    return recording.extra.get(table, {})


def sensor_table(sensor: Sensor, *, white_level: float | None = None) -> dict[str, Any]:
    """Return the keys of [sensor]; unknown values are omitted."""
    custom = sensor.kind == "custom" and sensor.width_px > 0
    content = {
        "kind": sensor.kind,
        "serial": sensor.serial or None,
        "mm_per_px": None if np.isnan(sensor.mm_per_px[0]) else list(sensor.mm_per_px),
        "width_px": sensor.width_px if custom else None,
        "height_px": sensor.height_px if custom else None,
        "rectification": None if sensor.rectification is None else MAPS,
        "has_markers": sensor.has_markers or None,
        "white_level": white_level,
        "gel": None if sensor.gel is None else _gel_table(sensor.gel),
    }
    return _known(content)


def _gel_table(gel: Gel) -> dict[str, Any]:
    """Return what a gel states: keys of other shapes stand at their defaults, and are omitted."""
    always = ("thickness_mm", "thickness_std_mm", "shape")
    usual = {one.name: one.default for one in fields(gel)}
    return {key: value for key, value in asdict(gel).items() if key in always or value != usual[key]}


def _known(content: Mapping[str, Any]) -> dict[str, Any]:
    """Remove None and NaN, which TOML lacks or which say nothing, and tables left empty."""
    kept = {}
    for key, value in content.items():
        inner = _known(value) if isinstance(value, dict) else list(value) if isinstance(value, tuple) else value
        if inner not in (None, {}) and inner == inner:
            kept[key] = inner
    return kept
