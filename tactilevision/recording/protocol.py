"""Tables of presses: the protocol, certified points, curves."""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.recording import layout
from tactilevision.recording.names import nearest
from tactilevision.recording.point_columns import split_columns
from tactilevision.recording.series import check_time
from tactilevision.recording.tables import Table, read_table
from tactilevision.records import CertifiedPoint, Curve, Indenter, Press

_WORDS_OF_TRUTH = {"true": True, "1": True, "yes": True, "": True, "false": False, "0": False, "no": False}


def read_presses(path: Path, indenters: Mapping[str, Indenter]) -> tuple[tuple[Press, ...], Table]:
    """presses.csv in the order of time: each label once, each indenter described, none overlapping another."""
    table = read_table(path, layout.PRESS_COLUMNS)
    check_indenters(table, indenters)
    _check_labels(table)
    for row, date in enumerate(table.words.get("date", ())):
        _check_date(table, row, date)
    for row, flag in enumerate(table.optional("lubricated")):
        if flag not in (0, 1) and not np.isnan(flag):
            raise table.fault(row, "lubricated is 0 or 1", value=float(flag))
    start, end = table.numbers["start_s"], table.numbers["end_s"]
    for row in np.flatnonzero(end <= start).tolist():
        raise table.fault(
            row,
            "the press does not end after it starts",
            value=(float(start[row]), float(end[row])),
            remedy="start_s and end_s are on the camera's clock.",
        )
    order = np.argsort(start, kind="stable")
    for before, after in pairwise(order.tolist()):
        if end[before] > start[after] + 1e-6:  # below any clock's step
            raise table.fault(
                after,
                f"press {table.words['press'][after]} starts at {start[after]:.12g} s, before press "
                f"{table.words['press'][before]} of line {table.lines[before]} ends at {end[before]:.12g} s",
                remedy="One press at a time: correct start_s or end_s.",
            )
    return tuple(_press(table, row) for row in order.tolist()), table


def read_points(path: Path, indenters: Mapping[str, Indenter]) -> tuple[tuple[CertifiedPoint, ...], Table]:
    """points.csv; depth and force may be empty only where `accepted` is false."""
    table = read_table(path, layout.POINT_COLUMNS)
    check_indenters(table, indenters)
    for name in ("depth_std_mm", "fz_std_N"):
        for row in np.flatnonzero(table.optional(name) < 0).tolist():
            raise table.fault(row, f"{name} must be at least 0", value=float(table.numbers[name][row]))
    return tuple(_point(table, row) for row in range(len(table.lines))), table


def read_curves(path: Path) -> tuple[tuple[Curve, ...], Table]:
    """curves.csv: one Curve for each label, in the order in which they first stand there."""
    table = read_table(path, layout.CURVE_COLUMNS, least_rows=2)
    phases = np.array(table.words.get("phase", [""] * len(table.lines)))
    for row in np.flatnonzero(~np.isin(phases, ("", *layout.PHASES))).tolist():
        raise table.fault(row, f"phase is one of {', '.join(layout.PHASES)}, or empty", value=str(phases[row]))
    rows_of: dict[str, list[int]] = {}
    for place, label in enumerate(table.words["press"]):
        rows_of.setdefault(label, []).append(place)
    forces = np.column_stack([table.numbers[name] for name in ("fx_N", "fy_N", "fz_N")])
    curves = []
    for label, listed in rows_of.items():
        rows = np.array(listed)
        check_time(table, table.numbers["time_s"][rows], rows=rows)
        z_mm = table.numbers["z_mm"][rows] if "z_mm" in table.numbers else None
        extra = {name: column[rows] for name, column in table.extra.items()}
        curves.append(
            Curve(
                label,
                table.numbers["time_s"][rows],
                table.numbers["depth_mm"][rows],
                forces[rows],
                phases[rows],
                z_mm,
                extra,
            )
        )
    return tuple(curves), table


def check_indenters(table: Table, indenters: Mapping[str, Indenter]) -> None:
    """Raise for the first row whose indenter recording.toml does not describe."""
    for row, name in enumerate(table.words["indenter"]):
        if name not in indenters:
            near = nearest(name, indenters)
            described = f"Described are: {', '.join(indenters)}." if indenters else "None is described."
            raise table.fault(
                row,
                f"indenter {name} is not described in {layout.SETTINGS}",
                remedy=f"Did you mean {near}?"
                if near
                else f"Add a table [indenter.{_key(name)}] there. {described}",
            )


def _key(name: str) -> str:
    """A name as a key of TOML: in quotes where a dot or a space would part it."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _check_labels(table: Table) -> None:
    first: dict[str, int] = {}
    for row, label in enumerate(table.words["press"]):
        if label in first:
            raise table.fault(
                row,
                f"press {label} stands in line {table.lines[first[label]]} already",
                remedy="Give every press a label of its own.",
            )
        first[label] = row


def _check_date(table: Table, row: int, date: str) -> None:
    try:
        datetime.date.fromisoformat(date or "2000-01-01")
    except ValueError:
        raise table.fault(row, "date is written like 2026-11-21", value=date) from None


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
            raise table.fault(
                row, f"column {name} holds no number", remedy="Remove the row, or set accepted to false."
            )
    return CertifiedPoint(
        table.words["press"][row],
        table.words["indenter"][row],
        **numbers,
        accepted=accepted,
        reason=reason,
        **split_columns(_extra(table, row)),
    )


def _extra(table: Table, row: int) -> dict[str, Any]:
    return {name: column[row].item() for name, column in table.extra.items()}
