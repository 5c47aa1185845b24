"""Writing the tables of a recording; each function takes the folder and knows the file's name.

Numbers are written to 12 digits, large ones (times in s since 1970) to all, NaN as an empty cell; optional columns
that hold nothing are left out.
Every file is whole or not there at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.door.cells import csv_text
from tactilevision.files import write_text
from tactilevision.recording import layout
from tactilevision.recording.model import BallPress, StageSeries
from tactilevision.recording.point_columns import point_columns
from tactilevision.records import CertifiedPoint, Curve, Floats, ForceSeries, Press

_Columns = Mapping[str, Sequence[Any] | npt.NDArray[Any]]
_NOTHING: _Columns = MappingProxyType({})
LARGE = 1e7  # beyond it 12 digits tell less than 10 microseconds of a time in s
_JOINED = ("details", "edge_profile", "extra")  # fields that are written as columns of their own


def write_table(path: Path | str, columns: _Columns) -> None:
    """Write any table: columns of equal length, in the order given."""
    rows = zip(*(map(table_cell, column) for column in columns.values()), strict=True)
    write_text(path, csv_text(chain([tuple(columns)], rows)))


def write_frame_table(
    folder: Path | str, names: Sequence[str], *, times_s: Floats, extra: _Columns = _NOTHING
) -> None:
    """Write frames.csv of times (n,) in s; `extra` are further columns of the same length, here as below."""
    write_table(Path(folder) / layout.FRAME_TABLE, {"frame": names, "time_s": times_s, **extra})


def write_forces(folder: Path | str, forces: ForceSeries, *, extra: _Columns = _NOTHING) -> None:
    """Write forces.csv, in the rectified frame's axes: no [force] rotation belongs to it."""
    columns: dict[str, Any] = dict(
        zip(layout.FORCE_COLUMNS.numbers, (forces.time_s, *forces.force_N.T), strict=True)
    )
    if forces.torque_Nm is not None:
        columns |= zip(layout.FORCE_COLUMNS.maybe_numbers, forces.torque_Nm.T, strict=False)
    if forces.temperature_C is not None:
        columns["temperature_C"] = forces.temperature_C
    write_table(Path(folder) / layout.FORCES, columns | dict(extra))


def write_stage(folder: Path | str, stage: StageSeries, *, extra: _Columns = _NOTHING) -> None:
    """Write stage.csv."""
    write_table(Path(folder) / layout.STAGE, {"time_s": stage.time_s, "z_mm": stage.z_mm, **extra})


def write_presses(folder: Path | str, presses: Sequence[Press]) -> None:
    """Write presses.csv."""
    further = [press.extra for press in presses]
    write_table(Path(folder) / layout.PRESSES, _record_columns(presses, further, layout.PRESS_COLUMNS.required))


def write_points(folder: Path | str, points: Sequence[CertifiedPoint]) -> None:
    """Write points.csv; `accepted` and `reason` are always there, lest a rejected one be taken for good."""
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
    if any(curve.z_mm is not None for curve in curves):
        columns["z_mm"] = _joined(np.full(len(c.time_s), np.nan) if c.z_mm is None else c.z_mm for c in curves)
    for name in dict.fromkeys(name for curve in curves for name in curve.extra):
        columns[name] = _joined(c.extra.get(name, [""] * n) for c, n in zip(curves, counts, strict=True))
    if not any(columns["phase"]):
        del columns["phase"]
    write_table(Path(folder) / layout.CURVES, columns)


def write_balls(folder: Path | str, balls: Sequence[BallPress]) -> None:
    """Write reference/ball.csv; the pictures themselves go into the folder beside it."""
    nowhere = (math.nan, math.nan)
    columns: dict[str, Any] = {
        "frame": [ball.name for ball in balls],
        "ball_radius_mm": [ball.ball_radius_mm for ball in balls],
        "centre_x_px": [(ball.centre_px or nowhere)[0] for ball in balls],
        "centre_y_px": [(ball.centre_px or nowhere)[1] for ball in balls],
        "contact_radius_px": [math.nan if b.contact_radius_px is None else b.contact_radius_px for b in balls],
    }
    write_table(Path(folder) / layout.BALL_TABLE, _without_empty(columns, layout.BALL_COLUMNS.required))


def _record_columns(
    records: Sequence[Press] | Sequence[CertifiedPoint],
    further: Sequence[Mapping[str, Any]],
    always: Sequence[str],
    kind: type = Press,
) -> _Columns:
    """Columns of the records' plain fields in their order, then of their `further` cells."""
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
    """One cell: 12 digits, all of them where large, "" for what is not known, true or false."""
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, float | np.floating):
        number = float(value)
        return "" if math.isnan(number) else f"{number:.12g}" if abs(number) < LARGE else repr(number)
    return "" if value is None else str(value)
