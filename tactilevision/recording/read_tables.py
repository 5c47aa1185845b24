"""Read the tables of a recording: frames, forces, stage, presses, points and curves."""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.errors import RecordingError, found_in
from tactilevision.recording import layout
from tactilevision.recording.layout import nearest
from tactilevision.recording.model import StageSeries
from tactilevision.recording.tables import Table, read_table
from tactilevision.records.certified import CertificationDetails, CertifiedPoint, EdgeDrop, EdgeProfile
from tactilevision.records.constants import MICRO
from tactilevision.records.measured import Curve, Floats, ForceSeries
from tactilevision.records.rig import Indenter, Press
from tactilevision.robust import MAD_TO_STD

if TYPE_CHECKING:
    from tactilevision.recording.settings import ForceSettings


def read_frame_table(path: Path) -> Table:
    """Read frames.csv: every name once, time never going backwards."""
    table = read_table(path, layout.FRAME_COLUMNS)
    check_time(table, table.numbers["time_s"])
    _check_once(table, "frame", remedy="Each picture has one time: remove the copy.")
    return table


def _check_once(table: Table, column: str, *, remedy: str) -> None:
    first: dict[str, int] = {}
    for row, name in enumerate(table.words[column]):
        if (before := first.setdefault(name, row)) != row:
            what = f"the {column} is listed twice, first in line {table.lines[before]}"
            raise table.fault(row, what, value=name, remedy=remedy)


def read_forces(path: Path, settings: ForceSettings, *, toml: Path) -> tuple[ForceSeries, Table]:
    """Read forces.csv, turned into the rectified frame's axes.

    force = R reading, with R of [force] rotation. Torque turns with det(R) R, since it is an axial vector; the
    noise of independent readings becomes sqrt(R^2 std^2), element by element. Without std_N the noise is
    estimated from successive readings (`step_noise`).
    """
    table = read_table(path, layout.FORCE_COLUMNS, least_rows=2)
    time_s = table.numbers["time_s"]
    check_time(table, time_s)
    turn = rotation(settings, toml)
    readings = np.column_stack([table.numbers[name] for name in ("fx_N", "fy_N", "fz_N")])
    std = np.array(settings.std_N) if settings.std_N else step_noise(readings)
    torque = None
    if all(name in table.numbers for name in ("tx_Nm", "ty_Nm", "tz_Nm")):
        torque = np.column_stack([table.numbers[name] for name in ("tx_Nm", "ty_Nm", "tz_Nm")])
    if turn is not None:
        readings = readings @ turn.T
        std = np.sqrt(turn**2 @ std**2)
        torque = None if torque is None else torque @ (np.linalg.det(turn) * turn).T
    return ForceSeries(time_s, readings, as_three(std.tolist()), torque, table.numbers.get("temperature_C")), table


def read_stage(path: Path) -> tuple[StageSeries, Table]:
    """Read stage.csv: place of the motion stage on the F/T sensor's clock."""
    table = read_table(path, layout.STAGE_COLUMNS, least_rows=2)
    check_time(table, table.numbers["time_s"])
    return StageSeries(table.numbers["time_s"], table.numbers["z_mm"]), table


def check_time(table: Table, time_s: Floats, *, rows: Floats | None = None) -> None:
    """Raise RecordingError if time (n,), in s, goes backwards from one row to the next.

    `rows` (n,) are its rows in the table.
    """
    back = np.flatnonzero(np.diff(time_s) < 0)
    if back.size:
        after = int(back[0]) + 1
        row = after if rows is None else int(rows[after])
        what = f"time_s goes backwards, from {time_s[after - 1]:.12g} to {time_s[after]:.12g}"
        raise table.fault(row, what, remedy="Rows are in the order of time, which never restarts, also over days.")


def as_three(values: Sequence[float]) -> tuple[float, float, float]:
    """Return a list of three as (x, y, z)."""
    x, y, z = values
    return x, y, z


def rotation(settings: ForceSettings, toml: Path) -> Floats | None:
    """Return [force] rotation (3, 3), None if it is absent. Left-handed axes are legal (det -1)."""
    if settings.rotation is None:
        return None
    turn = np.array(settings.rotation, dtype=float)
    if not turns(turn):
        raise RecordingError(
            "[force] rotation must be orthogonal: rows of length 1, at right angles",
            where=toml,
            value=settings.rotation,
            remedy="Its rows are the frame's x (right), y (down) and z (into the gel) in the F/T sensor's axes.",
        )
    return turn


def turns(rotation: Floats) -> bool:
    """Return whether a matrix (3, 3), dimensionless, is orthogonal."""
    return bool(np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3))


def step_noise(readings: Floats) -> Floats:
    """Estimate the standard deviation (3,) of one reading from the differences of successive ones (T, 3).

    1.4826 median |d - median d| / sqrt(2), which slow changes of force do not affect; at least the rounding's,
    step / sqrt(12). Too low where neighbouring readings were filtered together.
    """
    steps = np.diff(readings, axis=0)
    spread = MAD_TO_STD * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0) / np.sqrt(2)
    sizes = np.where(steps == 0, np.inf, np.abs(steps)).min(axis=0)
    rounding = np.where(np.isfinite(sizes), sizes, 0.0) / np.sqrt(12)
    return np.asarray(np.maximum(spread, rounding), dtype=float)


# Columns of points.csv with details of the certification, and the surface next to the face.

_RENAMED = {  # field of CertificationDetails: its column
    "pile_up_ratio": "rise_ratio",
    "pile_up_ratio_std": "rise_ratio_std",
    "tilt_std_mm": "lean_std_mm",
    "contact_std_s": "touch_std_s",
    "contact_shared_std_mm": "touch_shared_std_mm",
    "contact_sigmas": "touch_sigmas",
    "contact_channel": "touch_channel",
    "travel_scale_std": "ruler_std",
    "contact_delay_mm": "touches_late_mm",
    "contact_delay_std_mm": "touches_late_std_mm",
}
_KINDS = ("float", "str", "int | None", "bool | None")  # of its fields, in the order of their columns
_DETAILS = sorted(fields(CertificationDetails), key=lambda field: _KINDS.index(str(field.type)))
_COLUMNS = {_RENAMED.get(field.name, field.name): field for field in _DETAILS}
_PROFILE = ("slope_gain_std", "ball_slope")
_DROP = re.compile(r"fall_(\d+)_(\d+(?:\.\d+)?)_(\d+(?:\.\d+)?)_mm")


def point_columns(point: CertifiedPoint) -> dict[str, Any]:
    """Return the cells of one point by column: details, edge profile (fall_AZIMUTH_FROM_TO_mm) and extra."""
    cells: dict[str, Any] = {column: getattr(point.details, field.name) for column, field in _COLUMNS.items()}
    if cells["force_dwell"] is not None:
        cells["force_dwell"] = int(cells["force_dwell"])
    if point.edge_profile is not None:
        for drop in point.edge_profile.drops:
            cells[f"fall_{drop.azimuth_deg:.0f}_{drop.from_mm:.2f}_{drop.to_mm:.2f}_mm"] = drop.drop_mm
        cells |= {name: getattr(point.edge_profile, name) for name in _PROFILE}
    return cells | dict(point.extra)


def split_columns(cells: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments `details`, `edge_profile` and `extra` of CertifiedPoint from the further cells of one
    row.
    """
    details = {field.name: _detail(cells, column, str(field.type)) for column, field in _COLUMNS.items()}
    drops = []
    for name in cells:
        place, drop_mm = _DROP.fullmatch(name), _number(cells, name)
        if place and np.isfinite(drop_mm):
            azimuth_deg, from_mm, to_mm = (float(text) for text in place.groups())
            drops.append(EdgeDrop(azimuth_deg, from_mm, to_mm, drop_mm))
    profile = EdgeProfile(tuple(drops), *(_number(cells, name) for name in _PROFILE)) if drops else None
    known = {*_COLUMNS, *_PROFILE}
    extra = {name: cell for name, cell in cells.items() if name not in known and not _DROP.fullmatch(name)}
    return {"details": CertificationDetails(**details), "edge_profile": profile, "extra": extra}


def _detail(cells: Mapping[str, Any], column: str, kind: str) -> Any:
    """Return the value of a cell for a field of this kind."""
    if kind == "str":
        return _word(cells, column)
    number = _number(cells, column)
    if kind == "float":
        return number
    return None if not np.isfinite(number) else bool(number) if kind.startswith("bool") else int(number)


def _number(cells: Mapping[str, Any], name: str) -> float:
    """Return the number of a cell; NaN if it holds none, since these columns are for information."""
    try:
        return float(cells.get(name, np.nan))
    except (TypeError, ValueError):
        return float("nan")


def _word(cells: Mapping[str, Any], name: str) -> str:
    cell = cells.get(name, "")
    return cell if isinstance(cell, str) else "" if np.isnan(cell) else f"{cell:g}"


_WORDS_OF_TRUTH = {"true": True, "1": True, "yes": True, "": True, "false": False, "0": False, "no": False}


def read_presses(path: Path, indenters: Mapping[str, Indenter]) -> tuple[tuple[Press, ...], Table]:
    """Read presses.csv in the order of time: each label once, each indenter described, no overlaps."""
    table = read_table(path, layout.PRESS_COLUMNS)
    check_indenters(table, indenters)
    _check_once(table, "press", remedy="Give every press its own label.")
    for row, date in enumerate(table.words.get("date", ())):
        try:
            datetime.date.fromisoformat(date or "2000-01-01")
        except ValueError:
            raise table.fault(row, "date is written like 2026-11-21", value=date) from None
    for row, flag in enumerate(table.optional("lubricated")):
        if flag not in (0, 1) and not np.isnan(flag):
            raise table.fault(row, "lubricated is 0 or 1", value=float(flag))
    start, end = table.numbers["start_s"], table.numbers["end_s"]
    for row in np.flatnonzero(end <= start).tolist():
        times, remedy = (float(start[row]), float(end[row])), "start_s and end_s are on the camera's clock."
        raise table.fault(row, "the press does not end after it starts", value=times, remedy=remedy)
    order = np.argsort(start, kind="stable")
    for before, after in pairwise(order.tolist()):
        if end[before] > start[after] + MICRO:  # below any clock's step
            raise table.fault(
                after,
                f"press {table.words['press'][after]} starts at {start[after]:.12g} s, before press "
                f"{table.words['press'][before]} of line {table.lines[before]} ends at {end[before]:.12g} s",
                remedy="One press at a time: correct start_s or end_s.",
            )
    return tuple(_press(table, row) for row in order.tolist()), table


def read_points(path: Path, indenters: Mapping[str, Indenter]) -> tuple[tuple[CertifiedPoint, ...], Table]:
    """Read points.csv; depth and force may be empty only where `accepted` is false."""
    table = read_table(path, layout.POINT_COLUMNS)
    check_indenters(table, indenters)
    return tuple(_point(table, row) for row in range(len(table.lines))), table


def read_curves(path: Path) -> tuple[tuple[Curve, ...], Table]:
    """Read curves.csv: one Curve for each label, in the order of their first rows."""
    table = read_table(path, layout.CURVE_COLUMNS, least_rows=2)
    words = table.words.get("phase", [""] * len(table.lines))
    for row in (row for row, word in enumerate(words) if word not in ("", *layout.PHASES)):
        raise table.fault(row, f"phase is one of {', '.join(layout.PHASES)}, or empty", value=words[row])
    phases = np.array(words)
    rows_of: dict[str, list[int]] = {}
    for place, label in enumerate(table.words["press"]):
        rows_of.setdefault(label, []).append(place)
    forces = np.column_stack([table.numbers[name] for name in ("fx_N", "fy_N", "fz_N")])
    curves = []
    for label, listed in rows_of.items():
        rows = np.array(listed)
        time_s, depth_mm = table.numbers["time_s"][rows], table.numbers["depth_mm"][rows]
        check_time(table, time_s, rows=rows)
        z_mm = table.numbers["z_mm"][rows] if "z_mm" in table.numbers else None
        extra = {name: column[rows] for name, column in table.extra.items()}
        curves.append(Curve(label, time_s, depth_mm, forces[rows], phases[rows], z_mm, extra))
    return tuple(curves), table


def check_indenters(table: Table, indenters: Mapping[str, Indenter]) -> None:
    """Raise RecordingError for the first row whose indenter recording.toml does not describe."""
    for row, name in enumerate(table.words["indenter"]):
        if name not in indenters:
            near = nearest(name, indenters)
            described = f"Described are: {', '.join(indenters)}." if indenters else "None is described."
            added = f"Add a table [indenter.{_key(name)}] there. {described}"
            remedy = f"Did you mean {near}?" if near else added
            raise table.fault(row, f"indenter {name} is not described in {layout.SETTINGS}", remedy=remedy)


def _key(name: str) -> str:
    """Return a name as a key of TOML, quoted if it holds a dot or a space."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _press(table: Table, row: int) -> Press:
    found: dict[str, Any] = {name: column[row] for name, column in table.words.items()}
    found |= {name: float(column[row]) for name, column in table.numbers.items()}
    return Press(**found, extra=_extra(table, row))


def _point(table: Table, row: int) -> CertifiedPoint:
    said = table.words["accepted"][row] if "accepted" in table.words else ""
    reason = table.words["reason"][row] if "reason" in table.words else ""
    if said.lower() not in _WORDS_OF_TRUTH:
        raise table.fault(row, "accepted is true or false", value=said)
    accepted = _WORDS_OF_TRUTH[said.lower()] and not (reason and not said)
    numbers: dict[str, Any] = {name: float(column[row]) for name, column in table.numbers.items()}
    for name in layout.POINT_COLUMNS.gap_numbers:
        if accepted and np.isnan(numbers[name]):
            remedy = "Remove the row, or set accepted to false."
            raise table.fault(row, f"column {name} holds no number", remedy=remedy)
    press, indenter = table.words["press"][row], table.words["indenter"][row]
    with found_in(f"{table.path}, line {table.lines[row]}"):
        further = split_columns(_extra(table, row))
        return CertifiedPoint(press, indenter, **numbers, accepted=accepted, reason=reason, **further)


def _extra(table: Table, row: int) -> dict[str, Any]:
    return {name: column[row : row + 1].tolist()[0] for name, column in table.extra.items()}
