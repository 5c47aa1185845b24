"""Measurements given as arrays, one number a sample, as a recording of points or of curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from calibration.inputs.observations import Measured
from tactilevision.errors import InputError
from tactilevision.recording.model import Recording
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Curve, Floats
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

NAME = "arrays"  # of the recording that they make
ARRAYS = ("depth_mm", "force_N", "time_s")  # of samples: one number does not stand for all of them
Table = Mapping[str, Floats]


def samples_of(**given: npt.ArrayLike | None) -> Table:
    """Return each quantity that is not None as (N,), N the number of depths; one number stands for all samples.

    Raises InputError for other shapes, for what is no number, and for one that is not finite.
    """
    table: dict[str, Floats] = {}
    for name, values in given.items():
        if values is None:
            continue
        try:
            column = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError) as fault:
            raise InputError("numbers are needed", where=f"fit: {name}", value=str(values)[:80]) from fault
        count = next(iter(table.values()), column.ravel()).size
        if not count or (column.shape != (count,) and (column.ndim or name in ARRAYS)):
            what = "an array (N,) is needed" + ("" if name in ARRAYS else ", or one number for all samples")
            raise InputError(what, where=f"fit: {name}", value=f"shape {column.shape} and {count} depths")
        table[name] = np.broadcast_to(column, (count,))
        if wrong := np.flatnonzero(~np.isfinite(table[name])).tolist():
            raise InputError("a number is not finite", where=f"fit: {name}[{wrong[0]}]", remedy="Omit the sample.")
    return table


def measured_of(table: Table, press: Sequence[object] | None = None) -> Measured:
    """Return the samples, (N,) each, as points or, where they have times, as curves of the presses labelled (N,).

    Raises InputError for labels of another number or without times, and where the gel, or the punch of a press, is
    not one.
    """
    radius, nu = table["radius_mm"], _only("nu", table["nu"]) if "nu" in table else None
    gel = Gel(_only("thickness_mm", table["thickness_mm"]), poisson_ratio=nu)
    named = {f"a = {a:g} mm": Indenter(f"a = {a:g} mm", radius_mm=a) for a in np.unique(radius).tolist()}
    sensor = Sensor("custom", 0, 0, (float("nan"),) * 2, gel)
    made = Recording(Path(NAME), NAME, sensor, indenters=named)
    if "time_s" in table:
        return _of_curves(made, table, np.array(["1"] * radius.size if press is None else list(map(str, press))))
    if press is not None:
        raise InputError("samples of one press need their times", where="fit: press", remedy="Give time_s.")
    rows = np.column_stack([radius, table["depth_mm"], table["force_N"]]).tolist()
    points = (CertifiedPoint(f"{k}", f"a = {a:g} mm", w, P) for k, (a, w, P) in enumerate(rows, start=1))
    return Measured(made, tuple(points))


def _of_curves(made: Recording, table: Table, labels: npt.NDArray[np.str_]) -> Measured:
    """Return the samples, (N,) each, as one curve a label."""
    depth, force, time = (table[name] for name in ARRAYS)
    if labels.size != depth.size:
        value = f"{labels.size} labels and {depth.size} depths"
        raise InputError("one label a sample is needed", where="fit: press", value=value)
    curves, presses = [], []
    for label in dict.fromkeys(labels.tolist()):
        rows = np.flatnonzero(labels == label)
        a = _only(f"radius_mm of press {label}", table["radius_mm"][rows])
        push = np.column_stack([np.zeros((rows.size, 2)), force[rows]])
        curves.append(Curve(label, time[rows], depth[rows], push, np.full(rows.size, "")))
        presses.append(Press(label, f"a = {a:g} mm", float(time[rows[0]]), float(time[rows[-1]])))
    return Measured(replace(made, presses=tuple(presses)), curves=tuple(curves))


def _only(name: str, values: Floats) -> float:
    """Return the one value of (n,) samples. Raises InputError where there are several."""
    if np.ptp(values) != 0:
        value = f"{values.min():g} to {values.max():g}"
        raise InputError("all samples need the same number", where=f"fit: {name}", value=value)
    return float(values[0])
