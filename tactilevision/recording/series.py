"""Tables that run along a clock: frames, forces, the motion stage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import RecordingError
from tactilevision.recording import layout
from tactilevision.recording.model import StageSeries
from tactilevision.recording.tables import Table, read_table
from tactilevision.records import Floats, ForceSeries
from tactilevision.robust import MAD_TO_STD

if TYPE_CHECKING:
    from tactilevision.recording.settings import ForceSettings


def read_frame_table(path: Path) -> Table:
    """frames.csv: every name once, time never going backwards."""
    table = read_table(path, layout.FRAME_COLUMNS)
    check_time(table, table.numbers["time_s"])
    first: dict[str, int] = {}
    for row, name in enumerate(table.words["frame"]):
        if name in first:
            raise table.fault(
                row,
                f"the frame is listed twice, first in line {table.lines[first[name]]}",
                value=name,
                remedy="Each picture has one time: remove the copy.",
            )
        first[name] = row
    return table


MAX_FORCE_N = 1e6  # N: a hundred tonnes on a pad of some cm2; more is another unit, or a broken file


def read_forces(path: Path, settings: ForceSettings, *, toml: Path) -> tuple[ForceSeries, Table]:
    """forces.csv turned into the rectified frame's axes.

    force = R reading, with R of [force] rotation. Torque turns with det(R) R, since it is an axial vector;
    the noise of independent readings becomes sqrt(R^2 std^2), element by element. Where std_N is left out, the
    noise is estimated from successive readings (`step_noise`).
    """
    table = read_table(path, layout.FORCE_COLUMNS, least_rows=2)
    time_s = table.numbers["time_s"]
    check_time(table, time_s)
    turn = rotation(settings, toml)
    readings = np.column_stack([table.numbers[name] for name in ("fx_N", "fy_N", "fz_N")])
    for row in np.flatnonzero(np.abs(readings).max(axis=1) > MAX_FORCE_N)[:1]:
        raise table.fault(
            int(row),
            "a force that no gel bears",
            value=float(np.abs(readings[row]).max()),
            remedy="Forces are in N.",
        )
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
    """stage.csv: place of the motion stage on the F/T sensor's clock."""
    table = read_table(path, layout.STAGE_COLUMNS, least_rows=2)
    check_time(table, table.numbers["time_s"])
    return StageSeries(table.numbers["time_s"], table.numbers["z_mm"]), table


def check_time(table: Table, time_s: Floats, *, rows: Floats | None = None) -> None:
    """Raise where time (n,), in s, goes backwards from one row to the next.

    `rows` (n,) are its rows in the table.
    """
    back = np.flatnonzero(np.diff(time_s) < 0)
    if back.size:
        after = int(back[0]) + 1
        row = after if rows is None else int(rows[after])
        raise table.fault(
            row,
            f"time_s goes backwards, from {time_s[after - 1]:.12g} to {time_s[after]:.12g}",
            remedy="Rows stand in the order of time; time never restarts, also over days.",
        )


def as_three(values: Sequence[float]) -> tuple[float, float, float]:
    """x, y, z of a list that is known to hold them."""
    x, y, z = values
    return x, y, z


def rotation(settings: ForceSettings, toml: Path) -> Floats | None:
    """[force] rotation (3, 3), None where it is left out. A left-handed set of axes is legal (det -1)."""
    if settings.rotation is None:
        return None
    turn = np.array(settings.rotation, dtype=float)
    if not turns(turn):
        raise RecordingError(
            "[force] rotation must turn without stretching: rows of length 1, at right angles",
            where=toml,
            value=settings.rotation,
            remedy="Its rows are the frame's x (right), y (down) and z (into the gel) in the F/T sensor's axes.",
        )
    return turn


def turns(rotation: Floats) -> bool:
    """Whether a matrix (3, 3), dimensionless, turns without stretching."""
    return bool(np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3))


def step_noise(readings: Floats) -> Floats:
    """Standard deviation (3,) of one reading, from the differences of successive ones (T, 3).

    1.4826 median |d - median d| / sqrt(2), which slow changes of force leave alone; not below that of the
    readings' own rounding, step / sqrt(12). Too low where neighbouring readings were filtered together.
    """
    steps = np.diff(readings, axis=0)
    spread = MAD_TO_STD * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0) / np.sqrt(2)
    sizes = np.where(steps == 0, np.inf, np.abs(steps)).min(axis=0)
    rounding = np.where(np.isfinite(sizes), sizes, 0.0) / np.sqrt(12)
    return np.asarray(np.maximum(spread, rounding), dtype=float)
