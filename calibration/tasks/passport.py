"""The passport of a gel: what each recording says of it, what that rests on, and how the gel ages."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from calibration.fit.identifiability import main_radius
from calibration.inputs.observations import Measured
from calibration.laws import FLAT, shape_of
from calibration.result.result import CalibrationResult, versions
from calibration.tasks.ageing import FIRST, Ageing, ageing
from calibration.tasks.calibrate import own_stiffness
from tactilevision.errors import InputError
from tactilevision.files.opening import number
from tactilevision.recording.model import Recording
from tactilevision.records.constants import Z95
from tactilevision.records.measured import Curve, Estimate

FORMAT = 1  # version of passport.json
SAME = 1e-6  # of a thickness or a radius: less is the same number
TAIL = 0.1  # of a hold, at its beginning and at its end: forces are averaged over it
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


@dataclass(frozen=True, slots=True)
class Entry(Source):
    """One recording in a passport; `content` is what is stored of it.

    `own_c` is the stiffness of punches of `radius_mm` in N/mm (E in MPa for other shapes) with its own noise
    alone, `own_c_std` and `own_c_dof`; NaN where the presses determine none.
    """

    radius_mm: float
    own_c: float
    own_c_std: float
    own_c_dof: float
    content: Mapping[str, Any]

    @classmethod
    def of(cls, content: Mapping[str, Any], *, where: object) -> Entry:
        """Return the entry of stored content. Raises InputError where a key is missing or holds something else."""
        found = zip(NUMBERS, _numbers(content, NUMBERS, where=where), strict=True)
        numbers: dict[str, Any] = {name: math.nan if one is None else one for name, one in found}
        for name in (*WORDS, *ESTIMATES):
            if not isinstance(content.get(name), str if name in WORDS else Mapping):
                raise InputError("an entry of a passport lacks a key", where=where, value=name)
        sensor, date, recording, sha256 = (str(content[name]) for name in WORDS)
        try:
            day = datetime.date.fromisoformat(date)
        except ValueError as fault:
            raise InputError("a date is year-month-day", where=where, value=date) from fault
        return cls(sensor, day, recording, sha256, int(content.get("files", 0)), content=content, **numbers)

    def estimate(self, name: str) -> Estimate:
        """Return one of ESTIMATES."""
        told = self.content[name]
        value, std = _numbers(told, ("value", "std"), where=self.recording)
        low, high = (*(told.get("interval95") or ()), None, None)[:2]
        interval = None if low is None or high is None else (float(low), float(high))
        return Estimate(value, std, interval, str(told.get("unit", "")), str(told.get("why", "")))


def _numbers(content: Mapping[str, Any], names: Sequence[str], *, where: object) -> list[float | None]:
    return [number(content.get(name), what=name, where=where) for name in names]


WORDS = ("sensor", "date", "recording", "sha256")
NUMBERS = ("thickness_mm", "thickness_std_mm", "radius_mm", "own_c", "own_c_std", "own_c_dof")
ESTIMATES = {
    "youngs_modulus_MPa": "Young's modulus E",
    "poisson_ratio": "Poisson's ratio ν",
    "c_N_per_mm": "stiffness c",
    "thickness": "thickness",
    "friction": "friction at the face",
    "relaxation": "relaxation",
    "temperature": "temperature",
}


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
    recording, own = measured.recording, dict.fromkeys(NUMBERS[2:])
    if result is not None:
        radii, main = result.fitted.data.presses.radius_mm, main_radius(result.fitted)
        at_mm = radius_mm if radius_mm is not None and (abs(radii - radius_mm) < SAME).any() else main
        flat = shape_of(result.fitted.model.law) == FLAT
        c, dof = own_stiffness(result.fitted, at_mm if flat else None)
        own = dict(zip(own, (at_mm, c.value, c.std, min(dof, 1 / SAME)), strict=True))
    told = {
        **asdict(source),
        "date": str(source.date),
        **{name: content[name] for name in KEPT},
        "thickness": _thickness(source).as_json(),
        "friction": _friction(recording).as_json(),
        "relaxation": relaxation(curves).as_json(),
        "temperature": _temperature(recording).as_json(),
        **own,
    }
    return Entry.of(told, where=recording.name)


KEPT = (
    *("youngs_modulus_MPa", "poisson_ratio", "c_N_per_mm", "poisson_ratio_source", "presses_accepted"),
    *("presses_rejected", "assumptions", "warnings", "flags", "versions"),
)  # keys of calibration.json that an entry keeps


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
        found, line = self.ageing, self.ageing.line
        by = found.recalibrate_by
        return {
            "format": FORMAT,
            "sensor": self.sensor,
            "change": found.change.as_json(),
            "change_per_week": found.rate.as_json(),
            "change_reported": None if found.reported is None else str(found.reported),
            "scatter_between_recordings": None if line is None else line.scatter,
            "scatter_p": None if line is None else line.p_scatter,
            "tolerance": self.tolerance,
            "recalibrate_by": {"date": None if by is None else str(by), "why": found.why},
            "entries": [dict(one.content) for one in self.entries],
            "warnings": list(self.warnings),
            "versions": versions(),
        }


def passport_of(entries: Sequence[Entry], *, tolerance: float) -> Passport:
    """Return the passport of these entries. Raises InputError as `check_sources` does."""
    check_sources(entries)
    radius_mm = next((one.radius_mm for one in entries if math.isfinite(one.own_c)), math.nan)
    used = [one for one in entries if one.own_c > 0 and not abs(one.radius_mm - radius_mm) > SAME]
    found = (
        ageing(
            [one.date for one in used],
            [math.log(one.own_c) for one in used],
            [one.own_c_std / one.own_c for one in used],
            [one.own_c_dof for one in used],
            tolerance=tolerance,
        )
        if used
        else _nothing()
    )
    return Passport(tuple(entries), found, tolerance, tuple(_warnings(entries, used, found)))


def _nothing() -> Ageing:
    why = "no recording determines a stiffness"
    return Ageing(Estimate(None, None, None, "1", why), Estimate(None, None, None, "1/week", why), None, None, why)


def _warnings(entries: Sequence[Entry], used: Sequence[Entry], found: Ageing) -> Iterator[str]:
    for one in entries:
        if one not in used:
            other = (
                f"it pressed with another radius, {one.radius_mm:g} mm" if one.own_c > 0 else "it has no stiffness"
            )
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
    first = entries[0]
    for before, one in pairwise(entries):
        if one.sensor != first.sensor:
            raise InputError(
                f"a passport is of one sensor, and {first.recording} is of {first.sensor}",
                where=one.recording,
                value=one.sensor,
                remedy="Make one passport a sensor; they may share a ledger.",
            )
        apart = abs(one.thickness_mm - first.thickness_mm)
        if apart > Z95 * math.hypot(one.thickness_std_mm, first.thickness_std_mm) + SAME:
            raise InputError(
                f"a passport is of one gel, and that of {first.recording} is {first.thickness_mm:g} mm thick",
                where=one.recording,
                value=f"{one.thickness_mm:g} mm",
                remedy="Correct thickness_mm, or begin another passport with another serial.",
            )
        if one.date < before.date:
            raise InputError(
                f"dates run backwards: {before.recording} is of {before.date}",
                where=one.recording,
                value=str(one.date),
                remedy="Name recordings in order of time, or correct date in recording.toml.",
            )
        if one.sha256 in {other.sha256 for other in entries if other is not one}:
            raise InputError("a recording is named twice", where=one.recording, value=one.sha256[:12])
