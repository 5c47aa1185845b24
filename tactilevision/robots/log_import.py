"""Import of a robot's log as a recording: frames, forces and the [sensor] table."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tactilevision.errors import InputError
from tactilevision.files.writing import make_folder, staged, write_bytes, write_text
from tactilevision.profile.storage import SUFFIX, read_profile
from tactilevision.recording import layout
from tactilevision.recording.folder import guess_scale
from tactilevision.recording.pictures import first_look
from tactilevision.recording.read_tables import turns
from tactilevision.recording.settings import SensorSettings
from tactilevision.recording.write import MAPS, sensor_table, write_forces, write_frame_table
from tactilevision.records.measured import Floats, ForceSeries
from tactilevision.records.rig import Sensor
from tactilevision.robots.logs import Topics, ros2_name
from tactilevision.robots.messages import (
    COMPRESSED,
    IMAGE,
    TRANSFORMS,
    WRENCH,
    Clock,
    Picture,
    Stamp,
    WrenchReading,
    check_clocks,
    first_ns,
    fixed_rotation,
    read_log,
    times_s,
)
from tactilevision.sensors import SENSORS
from tactilevision.sensors.rectification import save_rectification


def _sensor_table(named: str | None, mm_per_px: float | None) -> tuple[dict[str, Any], Sensor | None]:
    """Return [sensor] of a kind's name, or of a profile with its sensor. Raises InputError for another name."""
    stated: dict[str, Any] = {} if mm_per_px is None else {"mm_per_px": mm_per_px}
    if named is None:
        return stated, None
    if named.lower().endswith(SUFFIX):
        sensor = read_profile(named).sensor
        return sensor_table(sensor) | stated, sensor
    if named not in SENSORS:
        known = f"a profile (FILE{SUFFIX}), or one of {', '.join(SENSORS)}"
        raise InputError("there is no such sensor", where="--sensor", value=named, remedy=f"Name {known}.")
    return {"kind": named} | stated, None


def _scaled(table: dict[str, Any], frames: Path, names: Sequence[str]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the table with the scale guessed from the size of the pictures, and the guesses.

    The scale is only guessed where the sensor's kind alone is named and its pictures have another size. Raises
    RecordingError for pictures of another shape than the kind's.
    """
    usual = SENSORS.get(table.get("kind", ""))
    if usual is None or "mm_per_px" in table:
        return table, ()
    size_px, _ = first_look(frames, names)
    if size_px == (usual.width_px, usual.height_px):
        return table, ()
    settings, notes = guess_scale(SensorSettings(kind=usual.kind), size_px)
    return table | {"mm_per_px": settings.mm_per_px}, notes


# A log to a recording folder: frames as files, the wrench as forces.csv.

MAX_USUAL_N = 200  # N: pads of tactile sensors are pressed with some tens
MAX_LISTED = 40  # topics named in a message; robots log hundreds
OPTIONS = {IMAGE: "--frames", COMPRESSED: "--frames", WRENCH: "--wrench"}  # that take a topic of a type
Rotation = tuple[tuple[float, float, float], ...]


def parse_rotation(text: str) -> Rotation:
    """Parse nine numbers, row by row, separated by commas. Raises InputError where they are not a rotation."""
    try:
        a, b, c, d, e, f, g, h, i = (float(part) for part in text.split(","))
    except ValueError as fault:
        raise InputError("nine numbers with commas between are needed", where="--rotation", value=text) from fault
    rows = (a, b, c), (d, e, f), (g, h, i)
    if not turns(np.array(rows)):
        remedy = "Rows are orthogonal and of length 1: the picture's x, y and z in the wrench's axes."
        raise InputError("these nine numbers are not a rotation", where="--rotation", value=text, remedy=remedy)
    return rows


@dataclass(frozen=True, slots=True)
class ImportSettings:
    """Topics, clock, sensor, scale and rotation of the wrench of an import.

    `sensor` is a kind's name or a sensor profile (.tvs), which gives the scale where none is stated. The rows of
    `rotation` (3, 3) are the picture's x, y and z (into the gel) in the wrench's axes; None takes it from the
    log's fixed transforms where frames and wrench have two frames of reference.
    """

    frames: str
    wrench: str | None = None
    clock: Clock = Clock.HEADER
    sensor: str | None = None
    mm_per_px: float | None = None
    rotation: Rotation | None = None


@dataclass(frozen=True, slots=True)
class Imported:
    """Result of an import: counts, seconds, frames of reference, largest force, guesses, topics not taken."""

    frames: int
    readings: int
    seconds: float
    frame_id: str
    wrench_frame_id: str | None
    largest_N: float = 0.0
    guessed: tuple[str, ...] = ()
    not_taken: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return the guesses, and a warning of implausible forces."""
        if self.largest_N <= MAX_USUAL_N:
            return self.guessed
        return (
            *self.guessed,
            f"the wrench reaches {self.largest_N:.4g} N, too much for a gel: is its topic in newtons?",
        )


def import_log(path: Path | str, out: Path | str, settings: ImportSettings) -> Imported:
    """Write the recording `out` atomically from the log `path`.

    Raises InputError for a log without the topics (with those it has), with two clocks, with a wrench in another
    frame of reference, or damaged; OutputError where `out` holds frames already.
    """
    if settings.frames == settings.wrench:
        raise InputError("is the topic of the frames, too", where="--wrench", value=settings.wrench)
    log, topics, (table, sensor) = Path(path), Topics(), _sensor_table(settings.sensor, settings.mm_per_px)
    with staged(out, last=layout.FRAMES) as folder:
        names, stamps, readings = _messages(log, topics, folder, settings)
        wrench = [one.stamp for one in readings]
        settings = _with_axes(stamps, wrench, log, settings)
        if settings.clock is Clock.HEADER:
            clocks = {settings.frames: stamps} | ({settings.wrench: wrench} if settings.wrench else {})
            check_clocks(clocks, log)
        origin_ns = first_ns([*stamps, *wrench], settings.clock)
        frame_s = times_s(stamps, settings.clock, origin_ns=origin_ns)
        order = np.argsort(frame_s, kind="stable")
        write_frame_table(folder, [names[k] for k in order], times_s=frame_s[order])
        if readings:
            _write_forces(folder, readings, settings, origin_ns)
        table, guessed = _scaled(table, folder / layout.FRAMES, names)
        if sensor is not None and sensor.rectification is not None:
            save_rectification(sensor, folder / MAPS)
        _write_settings(folder, log, settings, sensor=table, origin_ns=origin_ns)
    turned = readings[0].stamp.frame_id if readings else None
    largest_N = max((float(np.abs(one.force_N).max()) for one in readings), default=0.0)
    seconds, not_taken = float(np.ptp(frame_s)), _not_taken(topics, {settings.frames, settings.wrench})
    return Imported(len(names), len(readings), seconds, stamps[0].frame_id, turned, largest_N, guessed, not_taken)


def the_picture_topic(path: Path | str) -> str:
    """Return the only topic of pictures in a log. Raises InputError with the topics where it is not one."""
    topics: Topics = {}
    list(read_log(Path(path), topics))
    shown = sorted(name for name, kind in topics.items() if OPTIONS.get(ros2_name(kind)) == "--frames")
    if len(shown) == 1:
        return shown[0]
    if shown:
        remedy = f"Name one with --frames: {', '.join(shown)}."
        raise InputError("the log has several topics of pictures", where=path, remedy=remedy)
    raise InputError("the log has no topic of pictures", where=path, remedy=f"It has: {_listed(topics)}.")


def _messages(
    log: Path, topics: Topics, folder: Path, settings: ImportSettings
) -> tuple[list[str], list[Stamp], list[WrenchReading]]:
    """Write the frames to disk, and return their names and stamps, and the readings of force."""
    names: list[str] = []
    stamps: list[Stamp] = []
    readings: list[WrenchReading] = []
    make_folder(folder / layout.FRAMES)
    for _, one in read_log(log, topics, picture=settings.frames, wrench=settings.wrench):
        if isinstance(one, Picture):
            names.append(f"{len(names):07d}{one.suffix}")
            stamps.append(one.stamp)
            write_bytes(folder / layout.FRAMES / names[-1], one.data)
        else:
            readings.append(one)
    for topic, count in ((settings.frames, len(stamps)), (settings.wrench, len(readings))):
        if topic is not None and count < 2:
            said = "the topic has fewer than two messages" if topic in topics else "the log has no such topic"
            raise InputError(said, where=log, value=topic, remedy=f"It has: {_listed(topics)}.")
    return names, stamps, readings


def _listed(topics: Topics) -> str:
    """Return the names of topics with their types."""
    listed = [f"{name} ({kind})" for name, kind in sorted(topics.items())[:MAX_LISTED]]
    more = f" and {len(topics) - MAX_LISTED} more" if len(topics) > MAX_LISTED else ""
    return (", ".join(listed) or "no topic at all") + more


def _not_taken(topics: Topics, taken: set[str | None]) -> tuple[str, ...]:
    """Return sentences of the topics that were not taken: those that an option takes, by option, and the rest."""
    by_option: dict[str, Topics] = {option: {} for option in (*OPTIONS.values(), "no option")}
    for name, kind in topics.items():
        if name not in taken and ros2_name(kind) != TRANSFORMS:
            by_option[OPTIONS.get(ros2_name(kind), "no option")][name] = ros2_name(kind)
    said = []
    for option, some in by_option.items():
        which = "these" if option == "no option" else "it" if len(some) == 1 else "one"
        said += [f"the log also has {_listed(some)}; {option} takes {which}"] if some else []
    return tuple(said)


def _with_axes(frames: list[Stamp], wrench: list[Stamp], log: Path, settings: ImportSettings) -> ImportSettings:
    """Return the settings with the rotation by the log's fixed transforms where one is needed and not stated."""
    ids = sorted({one.frame_id for one in wrench})
    where = f"{log}, {settings.wrench}"
    if len(ids) > 1:
        raise InputError("the wrench changes its frame of reference", where=where, value=", ".join(ids)[:120])
    if settings.rotation is not None or not ids or ids[0] == frames[0].frame_id:
        return settings
    rotation = fixed_rotation(log, ids[0], frames[0].frame_id)
    if rotation is None:
        raise InputError(
            f"the wrench is in another frame of reference than the pictures ({frames[0].frame_id!r}), and the log "
            "has no fixed transform between them",
            where=where,
            value=ids[0],
            remedy="State --rotation: nine numbers, rows x, y, z (into the gel) of the picture in its axes; "
            "1,0,0,0,1,0,0,0,1 where they agree.",
        )
    x, y, z = (tuple(float(one) for one in row) for row in rotation)
    return replace(settings, rotation=(x, y, z))  # type: ignore[arg-type]


def _write_forces(folder: Path, readings: list[WrenchReading], settings: ImportSettings, origin_ns: int) -> None:
    time_s = times_s([one.stamp for one in readings], settings.clock, origin_ns=origin_ns)
    order = np.argsort(time_s, kind="stable")
    force: Floats = np.array([one.force_N for one in readings])[order]
    torque: Floats = np.array([one.torque_Nm for one in readings])[order]
    unknown = (float("nan"),) * 3
    write_forces(folder, ForceSeries(time_s[order], force, unknown, torque))


def _write_settings(
    folder: Path, source: Path, settings: ImportSettings, *, sensor: Mapping[str, Any], origin_ns: int
) -> None:
    """Write recording.toml; [log] states the source and the start of time_s."""
    content: dict[str, Any] = {"format": layout.FORMAT, "name": source.stem}
    if settings.clock is Clock.LOG or origin_ns > 10**18:  # 2001: earlier is no time of day
        content["date"] = datetime.datetime.fromtimestamp(origin_ns / 10**9, datetime.UTC).date()
    content |= {"sensor": dict(sensor)} if sensor else {}
    if settings.rotation is not None:
        content["force"] = {"rotation": [list(row) for row in settings.rotation]}
    content["log"] = {"source": source.name, "frames": settings.frames, "clock": settings.clock.value}
    content["log"] |= {"origin_ns": origin_ns} | ({"wrench": settings.wrench} if settings.wrench else {})
    write_text(folder / layout.SETTINGS, tomli_w.dumps(content))
