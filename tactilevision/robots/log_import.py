"""Import of a robot's log as a recording: frames, forces and the [sensor] table."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tactilevision.errors import InputError, OutputError
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
from tactilevision.robots.logs import Log, ros2_name
from tactilevision.robots.messages import (
    COMPRESSED,
    IMAGE,
    Clock,
    Stamp,
    WrenchReading,
    check_clocks,
    decode_picture,
    decode_wrench,
    first_ns,
    fixed_rotation,
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
    """Result of an import: counts, seconds, frames of reference, largest force, guesses."""

    frames: int
    readings: int
    seconds: float
    frame_id: str
    wrench_frame_id: str | None
    largest_N: float = 0.0
    guessed: tuple[str, ...] = ()

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
    if (Path(out) / layout.FRAMES).exists():
        raise OutputError("holds frames already", where=out, remedy="Choose an empty folder with --out.")
    if settings.frames == settings.wrench:
        raise InputError("is the topic of the frames, too", where="--wrench", value=settings.wrench)
    log, (table, sensor) = Log(Path(path)), _sensor_table(settings.sensor, settings.mm_per_px)
    with staged(out) as folder:
        names, stamps, readings = _messages(log, folder, settings)
        wrench = [one.stamp for one in readings]
        settings = _with_axes(stamps, wrench, log, settings)
        if settings.clock is Clock.HEADER:
            topics = {settings.frames: stamps} | ({settings.wrench: wrench} if settings.wrench else {})
            check_clocks(topics, log.path)
        origin_ns = first_ns([*stamps, *wrench], settings.clock)
        frame_s = times_s(stamps, settings.clock, origin_ns=origin_ns)
        order = np.argsort(frame_s, kind="stable")
        write_frame_table(folder, [names[k] for k in order], times_s=frame_s[order])
        if readings:
            _write_forces(folder, readings, settings, origin_ns)
        table, guessed = _scaled(table, folder / layout.FRAMES, names)
        if sensor is not None and sensor.rectification is not None:
            save_rectification(sensor, folder / MAPS)
        _write_settings(folder, log.path, settings, sensor=table, origin_ns=origin_ns)
    turned = readings[0].stamp.frame_id if readings else None
    largest_N = max((float(np.abs(one.force_N).max()) for one in readings), default=0.0)
    return Imported(
        len(names), len(readings), float(np.ptp(frame_s)), stamps[0].frame_id, turned, largest_N, guessed
    )


def the_picture_topic(path: Path | str) -> str:
    """Return the only topic of pictures in a log. Raises InputError with the topics where it is not one."""
    log = Log(Path(path))
    for _ in log.messages(()):  # fills in the topics
        pass
    shown = sorted(name for name, kind in log.topics.items() if ros2_name(kind) in (IMAGE, COMPRESSED))
    if len(shown) == 1:
        return shown[0]
    if shown:
        remedy = f"Name one with --frames: {', '.join(shown)}."
        raise InputError("the log has several topics of pictures", where=log.path, remedy=remedy)
    raise InputError("the log has no topic of pictures", where=log.path, remedy=_topics(log))


def _messages(
    log: Log, folder: Path, settings: ImportSettings
) -> tuple[list[str], list[Stamp], list[WrenchReading]]:
    """Write the frames to disk, and return their names and stamps, and the readings of force."""
    names: list[str] = []
    stamps: list[Stamp] = []
    readings: list[WrenchReading] = []
    make_folder(folder / layout.FRAMES)
    wanted = {settings.frames, settings.wrench} - {None}
    for message in log.messages({str(one) for one in wanted}):
        if message.topic == settings.frames:
            picture = decode_picture(message, log.path)
            names.append(f"{len(names):07d}{picture.suffix}")
            stamps.append(picture.stamp)
            write_bytes(folder / layout.FRAMES / names[-1], picture.data)
        else:
            readings.append(decode_wrench(message, log.path))
    _check_topic(log, settings.frames, len(stamps))
    if settings.wrench is not None:
        _check_topic(log, settings.wrench, len(readings))
    return names, stamps, readings


def _check_topic(log: Log, topic: str, count: int) -> None:
    """Raise InputError with the topics of the log where this one has fewer than two messages."""
    if count >= 2:
        return
    said = "the topic has fewer than two messages" if topic in log.topics else "the log has no such topic"
    raise InputError(said, where=log.path, value=topic, remedy=_topics(log))


def _topics(log: Log) -> str:
    """Return a sentence that lists the topics of a log."""
    has = [f"{name} ({kind})" for name, kind in sorted(log.topics.items())[:MAX_LISTED]]
    return f"It has: {', '.join(has) or 'no topic at all'}."


def _with_axes(frames: list[Stamp], wrench: list[Stamp], log: Log, settings: ImportSettings) -> ImportSettings:
    """Return the settings with the rotation by the log's fixed transforms where one is needed and not stated."""
    ids = sorted({one.frame_id for one in wrench})
    where = f"{log.path}, {settings.wrench}"
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
