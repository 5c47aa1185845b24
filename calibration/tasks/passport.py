"""The passport of a gel: what each recording says of it, what that rests on, and how the gel ages."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import Field, TypeAdapter

from calibration.fit.identifiability import main_radius
from calibration.inputs.observations import Measured
from calibration.laws import FLAT, shape_of
from calibration.result.result import CalibrationResult, versions
from calibration.tasks.ageing import FIRST, Ageing, ageing
from calibration.tasks.calibrate import own_stiffness
from tactilevision.errors import InputError
from tactilevision.recording.model import Recording
from tactilevision.records.constants import Z95
from tactilevision.records.measured import Curve, Estimate

FORMAT = 1  # version of passport.json
SAME = 1e-6  # of a thickness or a radius: less is the same number
TAIL = 0.1  # of a hold, at its beginning and at its end: forces are averaged over it
ANOTHER_GEL = "Correct thickness_mm, or begin another passport with another serial."
IN_ORDER = "Name recordings in order of time, or correct date in recording.toml."
UNLIKELY = 1e-3  # p of the scatter of recordings below which it is told


@dataclass(frozen=True, slots=True)
class Source:
    """A recording that a passport rests on: its sensor, its gel, and the SHA-256 of its `files`."""

    sensor: str
    date: datetime.date
    recording: str
    sha256: str
    files: int
    thickness_mm: float
    thickness_std_mm: float


def source_of(recording: Recording, digest: tuple[str, int]) -> Source:
    """Return the source; `digest` of its files, and their number. Raises InputError without a date or a gel."""
    gel, sensor = recording.sensor.gel, recording.sensor
    if recording.date is None or gel is None:
        lacks = "date" if recording.date is None else "[sensor.gel] thickness_mm"
        remedy = f"Add {lacks} to recording.toml."
        raise InputError("a passport needs the date and the gel's thickness", where=recording.path, remedy=remedy)
    name = f"{sensor.kind} {sensor.serial}".rstrip()
    return Source(name, recording.date, recording.name, *digest, gel.thickness_mm, gel.thickness_std_mm)


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Own:
    """Stiffness c of punches of `radius_mm`, N/mm, by its own noise alone: `std` with `dof` degrees of freedom.

    Of other shapes, of radius 0, E in MPa.
    """

    radius_mm: float
    value: Positive
    std: Positive
    dof: Positive


@dataclass(frozen=True, slots=True)
class Entry(Source):
    """One recording in a passport: its NUMBERS, what it keeps of calibration.json, and its own stiffness.

    `own` is None where the presses determine none.
    """

    own: Own | None
    numbers: Mapping[str, Estimate]
    kept: Mapping[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Return plain words and numbers."""
        return {**asdict(self), "date": str(self.date)}

    def source(self, name: str) -> str:
        """Return what one of NUMBERS rests on, "" where it has no value."""
        own, count = self.own, len(self.kept["presses_accepted"])
        sources = {
            "youngs_modulus_MPa": f"{count} presses, the thickness, and nu",
            "poisson_ratio": str(self.kept["poisson_ratio_source"]),
            "c_N_per_mm": f"{count} presses" + ("" if own is None else f", radius {own.radius_mm:g} mm"),
            "thickness_mm": "recording.toml",
            "relaxation": f"share of the force lost in a hold {self.numbers['relaxation'].why}",
            "temperature_C": "column temperature_C: mean, scatter and range",
        }
        return "" if self.numbers[name].value is None else sources.get(name, "")


NUMBERS = {
    "youngs_modulus_MPa": "Young's modulus E",
    "poisson_ratio": "Poisson's ratio ν",
    "c_N_per_mm": "stiffness c",
    "thickness_mm": "thickness",
    "friction": "friction at the face",
    "relaxation": "relaxation",
    "temperature_C": "temperature",
}
KEPT = ("poisson_ratio_source", "presses_accepted", "presses_rejected", "assumptions", "flags", "versions")


def stored_entry(content: Mapping[str, Any], *, where: object) -> Entry:
    """Return an entry of a ledger. Raises InputError for one that is damaged."""
    try:
        found: Entry = TypeAdapter(Entry).validate_python(content)
    except ValueError as fault:
        why = " ".join(str(fault).split())[:160]
        raise InputError("an entry of the ledger is damaged", where=where, value=why) from fault
    for name in {*NUMBERS, *KEPT} - {*found.numbers, *found.kept}:
        raise InputError("an entry of the ledger lacks a key", where=where, value=name)
    return found


def entry_of(
    source: Source,
    measured: Measured,
    content: Mapping[str, Any],
    result: CalibrationResult | None,
    *,
    curves: Sequence[Curve] = (),
    radius_mm: float | None = None,
) -> Entry:
    """Return the entry of a calibrated recording, of punches of `radius_mm` where it has such.

    `content` is that of calibration.json; `curves` are of whole presses.
    """
    own = None
    if result is not None:
        radii, main = result.fitted.data.presses.radius_mm, main_radius(result.fitted)
        at_mm = radius_mm if radius_mm is not None and (abs(radii - radius_mm) < SAME).any() else main
        at_mm = at_mm if shape_of(result.fitted.model.law) == FLAT else 0.0
        c, dof = own_stiffness(result.fitted, at_mm or None)
        if c.value is not None and c.value > 0:
            own = Own(at_mm, c.value, max(c.std or 0.0, SAME * c.value), min(dof, 1 / SAME))
    numbers = {
        **{name: _estimate(content[name]) for name in ("youngs_modulus_MPa", "poisson_ratio", "c_N_per_mm")},
        "thickness_mm": _thickness(source),
        "friction": _friction(measured.recording),
        "relaxation": relaxation(curves),
        "temperature_C": _temperature(measured.recording),
    }
    return Entry(**asdict(source), own=own, numbers=numbers, kept={name: content[name] for name in KEPT})


def _estimate(told: Mapping[str, Any]) -> Estimate:
    interval = told["interval95"]
    return Estimate(**{**told, "interval95": None if interval is None else (interval[0], interval[1])})


def _thickness(source: Source) -> Estimate:
    if not source.thickness_std_mm:
        return Estimate(source.thickness_mm, None, None, "mm", "as stated, without an uncertainty")
    return Estimate.normal(source.thickness_mm, source.thickness_std_mm, "mm")


def _friction(recording: Recording) -> Estimate:
    wet = {press.lubricated for press in recording.presses}
    said = "the presses were lubricated; " if wet == {1.0} else ""
    why = f"{said}presses of a punch do not determine friction: E's interval allows for what is not stated"
    return Estimate(None, None, None, "1", why)


def _temperature(recording: Recording) -> Estimate:
    """Return the mean temperature in °C, and the scatter of its readings, of presses, else of the force sensor."""
    each = np.array([press.temperature_C for press in recording.presses])
    read = None if recording.forces is None else recording.forces.temperature_C
    if read is not None and not np.isfinite(each).any():
        each = np.asarray(read)
    known = each[np.isfinite(each)]
    if not known.size:
        return Estimate(None, None, None, "°C", "none was recorded (column temperature_C)")
    return Estimate(float(known.mean()), float(known.std()), (float(known.min()), float(known.max())), "°C")


def relaxation(curves: Sequence[Curve]) -> Estimate:
    """Return the share of the normal force that was lost while presses held their depth: median, 95 % interval.

        1 - F_end / F_begin,    F the mean over the first and the last tenth of a hold

    Each press counts once. The interval is the median's by normal theory.
    """
    falls, held_s = [], []
    for curve in curves:
        hold = np.flatnonzero(curve.phase == "hold")
        few = int(TAIL * hold.size)
        if few < 1:
            continue
        begin, end = (float(curve.force_N[part, 2].mean()) for part in (hold[:few], hold[-few:]))
        if begin > 0:
            falls.append(1 - end / begin)
            held_s.append(float(np.ptp(curve.time_s[hold])))
    if len(falls) < FIRST:
        return Estimate(None, None, None, "1", f"fewer than {FIRST} presses held their depth (phase hold)")
    middle = float(np.median(falls))
    std = float(np.sqrt(np.pi / 2) * np.std(falls, ddof=1) / np.sqrt(len(falls)))
    over = f"over {np.median(held_s):.2g} s, {len(falls)} presses"
    return Estimate(middle, std, (middle - Z95 * std, middle + Z95 * std), "1", over)


@dataclass(frozen=True, slots=True)
class Passport:
    """The entries of one sensor's gel in order of time, its ageing, and what to know of them."""

    entries: tuple[Entry, ...]
    ageing: Ageing
    tolerance: float
    warnings: tuple[str, ...] = ()

    @property
    def sensor(self) -> str:
        """Return kind and serial number."""
        return self.entries[-1].sensor

    def as_json(self) -> dict[str, Any]:
        """Return the content of passport.json."""
        found, line, last = self.ageing, self.ageing.line, self.entries[-1]
        by = found.recalibrate_by
        dated = {
            name: one.as_json() | {"date": str(last.date), "source": last.source(name)}
            for name, one in last.numbers.items()
        }
        return {
            "format": FORMAT,
            "sensor": self.sensor,
            **dated,
            "change": found.change.as_json(),
            "change_per_week": found.rate.as_json(),
            "change_reported": None if found.reported is None else str(found.reported),
            "scatter_between_recordings": None if line is None else line.scatter,
            "scatter_p": None if line is None else line.p_scatter,
            "tolerance": self.tolerance,
            "next_calibration": {"date": None if by is None else str(by), "why": found.why},
            "history": [one.as_json() for one in self.entries],
            "warnings": list(self.warnings),
            "versions": versions(),
        }


def passport_of(entries: Sequence[Entry], *, tolerance: float) -> Passport:
    """Return the passport of these entries. Raises InputError as `check_sources` does."""
    check_sources(entries)
    known = [(one.date, one.own) for one in entries if one.own is not None]
    used = [(date, own) for date, own in known if abs(own.radius_mm - known[0][1].radius_mm) < SAME]
    log_c, std = [math.log(own.value) for _, own in used], [own.std / own.value for _, own in used]
    found = ageing([date for date, _ in used], log_c, std, [own.dof for _, own in used], tolerance=tolerance)
    return Passport(tuple(entries), found, tolerance, tuple(_warnings(entries, [own for _, own in used], found)))


def _warnings(entries: Sequence[Entry], used: Sequence[Own], found: Ageing) -> Iterator[str]:
    for one in entries:
        if one.own is None:
            yield f"{one.recording} is not compared with the others: it determines no stiffness"
        elif one.own not in used:
            other = f"its punch has another radius, {one.own.radius_mm:g} mm"
            yield f"{one.recording} is not compared with the others: {other}"
    if " " not in entries[-1].sensor:
        yield "no serial number is stated ([sensor] serial): any gel of this kind counts as this one"
    if found.line is not None and found.line.p_scatter < UNLIKELY:
        yield (
            f"the recordings scatter by {100 * found.line.scatter:.2g} % beyond what each one states (mounting, "
            "temperature, a sudden change?): the interval of the change allows for it"
        )


def check_sources(entries: Sequence[Source]) -> None:
    """Raise InputError for recordings of two sensors, of two thicknesses, given twice, or not in order of time."""
    first, seen = entries[0], [one.sha256 for one in entries]
    thick = f"that of {first.recording} is {first.thickness_mm:g} mm thick"
    for before, one in pairwise(entries):
        apart = abs(one.thickness_mm - first.thickness_mm)
        sensor = f"a passport is of one sensor, and {first.recording} is of {first.sensor}"
        backwards = f"dates run backwards: {before.recording} is of {before.date}"
        reach = Z95 * math.hypot(one.thickness_std_mm, first.thickness_std_mm) + SAME
        faults = (
            (one.sensor != first.sensor, sensor, one.sensor, "Make one a sensor; a ledger holds many."),
            (apart > reach, f"a passport is of one gel, and {thick}", f"{one.thickness_mm:g} mm", ANOTHER_GEL),
            (one.date < before.date, backwards, str(one.date), IN_ORDER),
            (seen.count(one.sha256) > 1, "a recording is named twice", one.sha256[:12], "Name it once."),
        )
        for wrong, what, value, remedy in faults:
            if wrong:
                raise InputError(what, where=one.recording, value=value, remedy=remedy)
