"""Read a recording folder, except its pictures, into one checked record."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import RecordingError, found_in
from tactilevision.files.opening import real_path
from tactilevision.recording import layout, pictures
from tactilevision.recording.layout import some
from tactilevision.recording.model import BallPress, Recording, require, require_all
from tactilevision.recording.read_tables import (
    as_three,
    read_curves,
    read_forces,
    read_points,
    read_presses,
    read_stage,
)
from tactilevision.recording.sensor import build_sensor
from tactilevision.recording.tables import Table
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Curve, Floats
from tactilevision.records.rig import Indenter, Press, Sensor

if TYPE_CHECKING:
    from tactilevision.recording.settings import IndenterSettings, Settings


# Consistency between the files of one recording.

MIN_GAP_S = 2.0  # s without readings; presses last some seconds
MIN_GAP_STEPS = 20  # usual steps without readings; loggers lose a few
SAME_PAUSE = 1.5  # times the frames' longest pause; frames are taken at presses alone, and end some seconds before
ALIKE = 0.5  # of the longest gap: the median of recurring gaps; a stage takes more or less time between places
SAME_RATE = 0.1  # relative tolerance of the readings' rate
LONGER = 2.0  # times a press's length that its curve may last; free gel before and after adds little
_SPARE = 0.1  # of a press: part that the readings may miss at its end, which is free gel


def check_forces_cover(recording: Recording) -> tuple[str, ...]:
    """Raise if the force readings miss a part of the first or last press; return a warning if it is small.

    With an unknown clock offset only durations are compared.
    """
    if recording.forces is None or not recording.presses:
        return ()
    times = recording.forces.time_s
    first, last = recording.presses[0], max(recording.presses, key=lambda press: press.end_s)
    offset_s = recording.clock_offset_s
    if offset_s is None:
        lasts, needed = float(times[-1] - times[0]), last.end_s - first.start_s
        said = f"the readings end early: they last {lasts:.6g} s, the presses {needed:.6g} s"
        return _judged(recording, last, needed - lasts, said)
    start, end = first.start_s + offset_s, last.end_s + offset_s
    here = "of the same clock"
    early = f"the readings end early: at {times[-1]:.6g} s, but press {last.press} ends at {end:.6g} s {here}"
    late = f"the readings start late: at {times[0]:.6g} s, but press {first.press} starts at {start:.6g} s {here}"
    missing_s = (float(times[0]) - start, end - float(times[-1]))
    return _judged(recording, first, missing_s[0], late) + _judged(recording, last, missing_s[1], early)


def _judged(recording: Recording, press: Press, missing_s: float, said: str) -> tuple[str, ...]:
    assert recording.forces is not None
    step_s = float(np.median(np.diff(recording.forces.time_s)))
    if missing_s > max(_SPARE * (press.end_s - press.start_s), 2 * step_s):
        raise RecordingError(
            said,
            where=recording.path / layout.FORCES,
            remedy="Copy the whole file, or remove the presses without force from presses.csv"
            + (f"; or correct [clock] offset_s in {layout.SETTINGS}." if recording.clock_offset_s else "."),
        )
    # the last reading comes up to one step before the last press ends
    return (f"{layout.FORCES}: {said}",) if missing_s > 2 * step_s else ()


def doubts(recording: Recording) -> Iterator[str]:
    """Yield a sentence for each thing that is legal but unlikely."""
    yield from _doubts_of_frames(recording)
    yield from _doubts_of_forces(recording)
    yield from _doubts_of_depths(recording)
    yield from _doubts_of_repeated(recording)
    rows = Counter(point.press for point in recording.points)
    twice = [press for press, count in rows.items() if count > 1]
    if twice:
        yield f"{layout.POINTS}: more than one row each for press {some(twice)}"
    back = [after for before, after in pairwise(recording.curves) if after.time_s[0] < before.time_s[0]]
    if back:
        yield (
            f"{layout.CURVES}: time_s starts again between presses, at {some([curve.press for curve in back])}, "
            "so rest and order are unknown: is a press of another recording, or out of order?"
        )
    else:
        yield from _doubts_of_curve_times(recording)
    yield from _doubts_of_curve_rows(recording)


def _doubts_of_curve_rows(recording: Recording) -> Iterator[str]:
    copies = {curve.press: count for curve in recording.curves if (count := _repeated(curve))}
    if copies:
        yield (
            f"{layout.CURVES}: {sum(copies.values())} rows repeat the row before them, in press "
            f"{some(list(copies))}: copies hold no information and narrow the intervals. Remove them"
        )
    with_rows = {curve.press for curve in recording.curves}
    without = [press.press for press in recording.presses if press.press not in with_rows]
    if with_rows and without:
        yield f"{layout.CURVES}: no rows of press {some(without)}, which {layout.PRESSES} lists"


def _repeated(curve: Curve) -> int:
    """Count the rows of a curve that repeat the row before them."""
    readings = np.column_stack([curve.time_s, curve.depth_mm, curve.force_N])
    return int(np.count_nonzero(np.all(np.diff(readings, axis=0) == 0, axis=1)))


def _lasting(curve: Curve) -> float:
    return float(np.ptp(curve.time_s))


def _doubts_of_curve_times(recording: Recording) -> Iterator[str]:
    spans = {press.press: (press.start_s, press.end_s) for press in recording.presses}
    known = [curve for curve in recording.curves if curve.press in spans]
    long = [curve for curve in known if _lasting(curve) > LONGER * np.ptp(spans[curve.press]) + MIN_GAP_S]
    if 2 * len(long) > len(known):
        first = long[0]
        yield (
            f"{layout.CURVES}: {len(long)} of {len(known)} presses last longer than in {layout.PRESSES}, press "
            f"{first.press} {_lasting(first):.6g} s and not {np.ptp(spans[first.press]):.6g} s. time_s counts "
            "seconds: is it in milliseconds?"
        )
        return
    for curve in long:
        yield (
            f"{layout.CURVES}: press {curve.press} lasts {_lasting(curve):.6g} s, but "
            f"{np.ptp(spans[curve.press]):.6g} s in {layout.PRESSES}: did its clock jump?"
        )
    apart = [c.press for c in known if c.time_s[0] > spans[c.press][1] or c.time_s[-1] < spans[c.press][0]]
    if 2 * len(apart) > len(known):
        yield (
            f"{layout.CURVES}: time_s lies outside of start_s to end_s in {layout.PRESSES} for {some(apart)}: "
            "is it in milliseconds, or another clock's?"
        )


def _doubts_of_repeated(recording: Recording) -> Iterator[str]:
    """Yield a sentence for each column that contradicts recording.toml."""
    gel, indenters = recording.sensor.gel, recording.indenters
    for table, rows in ((layout.PRESSES, recording.presses), (layout.POINTS, recording.points)):
        for name in ("radius_mm", "thickness_mm", "poisson_ratio"):
            other: dict[tuple[Any, float], list[str]] = {}
            for row in rows:
                stated = getattr(indenters.get(row.indenter) if name == "radius_mm" else gel, name, None)
                value = dict(row.extra).get(name)
                if stated is None or not isinstance(value, int | float) or math.isnan(value):
                    continue
                if not math.isclose(value, stated):
                    other.setdefault((value, stated), []).append(row.press)
            for (value, stated), presses in other.items():
                yield (
                    f"{table}: {name} = {value:g} of press {some(presses)} contradicts {stated:g} in "
                    f"{layout.SETTINGS}, which is used: correct one of them"
                )


def _doubts_of_frames(recording: Recording) -> Iterator[str]:
    times = recording.frame_times_s
    if times.size == 0 or np.isnan(times).any():
        return
    equal = int(np.count_nonzero(np.diff(times) == 0))
    if equal:
        yield f"{layout.FRAME_TABLE}: {equal} frames have the same time as the frame before"
    blind = [p.press for p in recording.presses if p.start_s > times[-1] or p.end_s < times[0]]
    if blind:
        of_all = len(blind) == len(recording.presses)
        clock = f". Is {layout.FRAME_TABLE} in ms, or of another clock?" if of_all else ""
        yield f"{layout.PRESSES}: no frames were taken during {some(blind)}{clock}"


def _doubts_of_forces(recording: Recording) -> Iterator[str]:
    if recording.forces is None:
        return
    times, normal = recording.forces.time_s, recording.forces.force_N[:, 2]
    step_s = float(np.median(np.diff(times)))
    rate = recording.force_rate_Hz
    if rate is not None and step_s > 0 and not math.isclose(1 / step_s, rate, rel_tol=SAME_RATE):
        in_ms = ": is time_s in ms?" if math.isclose(KILO / step_s, rate, rel_tol=SAME_RATE) else ""
        yield f"{layout.FORCES}: readings come at {1 / step_s:.4g} Hz, not at rate_Hz = {rate:g}{in_ms}"
    pause_s = float(np.diff(recording.frame_times_s).max(initial=0.0))  # of both: a change of indenter
    gaps_s = np.diff(times)
    gaps = np.flatnonzero(gaps_s > max(MIN_GAP_S, MIN_GAP_STEPS * step_s, SAME_PAUSE * pause_s))
    if gaps.size and not _read_by_press(recording, times[gaps], times[gaps + 1]):
        longest = int(np.argmax(gaps_s))
        yield (
            f"{layout.FORCES}: no readings for {gaps_s[longest]:.3g} s after time_s = {times[longest]:.6g}: if "
            "the clock jumped, the times of forces after it are wrong"
        )
    if recording.presses and np.ptp(normal) == 0:
        yield f"{layout.FORCES}: fz_N is {normal[0]:g} N throughout, also where presses are: was the sensor read?"
    free = float(np.median(normal))
    if free - normal.min() > 2 * (normal.max() - free) and free - normal.min() > 20 * recording.forces.std_N[2]:
        yield f"{layout.FORCES}: fz_N mostly falls in presses, where it should grow: see [force] rotation"


def _read_by_press(recording: Recording, starts_s: Floats, ends_s: Floats) -> bool:
    """Return whether readings pause regularly between presses: gaps (n,) that hold no press's middle.

    With an unknown clock offset: whether the median gap is at least half as long as the longest.
    """
    if starts_s.size < 2:
        return False
    offset_s = recording.clock_offset_s
    if offset_s is None:
        lasts_s = ends_s - starts_s
        return float(np.median(lasts_s)) >= ALIKE * float(lasts_s.max())
    middles = np.array([0.5 * (press.start_s + press.end_s) + offset_s for press in recording.presses])
    return not np.any((starts_s[:, None] < middles) & (middles < ends_s[:, None]))


def _doubts_of_depths(recording: Recording) -> Iterator[str]:
    gel = recording.sensor.gel
    if gel is None:
        return
    in_points = max((point.depth_mm for point in recording.points if point.accepted), default=0.0)
    in_curves = max((float(curve.depth_mm.max()) for curve in recording.curves), default=0.0)
    for table, deepest in ((layout.POINTS, in_points), (layout.CURVES, in_curves)):
        if deepest > gel.thickness_mm:
            yield f"{table}: depth_mm = {deepest:g} exceeds the gel's thickness of {gel.thickness_mm:g} mm"


# Reading a recording folder, except its pictures.

Columns = Mapping[str, npt.NDArray[Any]]


def read_recording(path: Path | str, *, sensor: Mapping[str, Any] | None = None) -> Recording:
    """Read a recording folder and check all that can be checked without decoding its pictures.

    `sensor` holds keys of [sensor] that the file lacks. Raises RecordingError, with file and line or key, for the
    first fault found. `Recording.warnings` lists what is legal but unlikely.
    """
    # imported here, since pydantic is slow to import
    from tactilevision.recording.settings import check_settings, load_toml

    root = Path(path)
    toml = _find_settings(root)
    settings, content, news = check_settings(load_toml(toml), toml)
    missing = {key: value for key, value in (sensor or {}).items() if getattr(settings.sensor, key) is None}
    settings = settings.model_copy(update={"sensor": settings.sensor.model_copy(update=missing)})
    indenters = {name: _indenter(name, table, toml) for name, table in settings.indenter.items()}
    recording = Recording(
        path=root,
        name=settings.name or real_path(root).name,
        sensor=Sensor("custom", 0, 0, (float("nan"), float("nan"))),
        date=settings.date,
        force_std_N=as_three(settings.force.std_N) if settings.force.std_N else None,
        force_rate_Hz=settings.force.rate_Hz,
        depth_source=settings.depth.source,
        depth_std_mm=settings.depth.std_mm,
        clock_offset_s=settings.clock.offset_s,
        indenters=indenters,
        settings=content,
        warnings=news,
    )
    recording = _with_pictures(recording, settings, toml)
    recording = _with_tables(recording, settings, toml)
    late = check_forces_cover(recording)
    return replace(recording, warnings=recording.warnings + late + tuple(doubts(recording)))


def _find_settings(root: Path) -> Path:
    if not root.exists():
        raise RecordingError("there is no such folder", where=root)
    if not root.is_dir():
        raise RecordingError(
            "a recording is a folder, not a file",
            where=root,
            remedy=f"Name the folder that holds {layout.SETTINGS}.",
        )
    names = sorted(found.name for found in root.iterdir())
    if not names:
        raise RecordingError(
            "the folder is empty", where=root, remedy=f"A recording holds {layout.SETTINGS} and its tables."
        )
    if layout.SETTINGS not in names:
        inner = sorted(found.parent.name for found in root.glob(f"*/{layout.SETTINGS}"))
        remedy = f"It needs {layout.SETTINGS}, with format = {layout.FORMAT}."
        if inner:
            remedy = f"Did you mean {root / inner[0]}?"
        elif any(name.lower().endswith((*layout.IMAGE_SUFFIXES, *layout.VIDEO_SUFFIXES)) for name in names):
            remedy = (
                f"It holds pictures: `tactilevision depth {root} --sensor NAME` makes height maps of them; E and "
                f"nu also need {layout.SETTINGS}, {layout.PRESSES} and {layout.FORCES}."
            )
        raise RecordingError(f"is not a recording: {layout.SETTINGS} is missing", where=root, remedy=remedy)
    return root / layout.SETTINGS


def _with_pictures(recording: Recording, settings: Settings, toml: Path) -> Recording:
    """Add the list of frames, the references, and the sensor, whose size the pictures determine."""
    root = recording.path
    frames_path = pictures.find_frames(root)
    names: tuple[str, ...] = ()
    times, warnings, extra = np.zeros(0), names, dict[str, Columns]()
    if frames_path is None:
        _check_no_frames_needed(recording)
    elif _named(root, layout.FRAME_TABLE) or _is_calibration(root):
        table, warnings = pictures.list_frames(root, frames_path)
        names, times, extra = tuple(table.words["frame"]), table.numbers["time_s"], _extra(table)
        warnings += table.warnings
    else:
        names = pictures.frame_names(frames_path)
        times = np.full(len(names), np.nan)
        said = "frames are read in the order of their names, without times"
        warnings = (f"{layout.FRAME_TABLE} is missing: {said}",)
    white = settings.sensor.white_level
    flats = pictures.find_flats(root)
    balls, ball_notes = pictures.read_balls(root / layout.BALLS, root / layout.BALL_TABLE)
    looked = (frames_path, names) if frames_path else _light_alone(root, flats, balls)
    size, seen = pictures.first_look(*looked, white_level=white) if looked else (None, ())
    sensor, notes = build_sensor(settings.sensor, toml, frame_size_px=size)
    if size is not None:
        first = [*flats[:1], *(ball.path for ball in balls[:1])]
        seen += pictures.check_references(size, first, white_level=white)
        seen += pictures.doubts_of_turning(frames_path, names, [*flats, *(ball.path for ball in balls)])
    return replace(
        recording,
        sensor=sensor,
        white_level=white,
        frames_path=frames_path,
        frame_names=names,
        frame_times_s=times,
        frame_size_px=size,
        flats=flats,
        balls=balls,
        extra=extra,
        warnings=recording.warnings + warnings + seen + notes + ball_notes,
    )


def _light_alone(root: Path, flats: Sequence[Path], balls: Sequence[BallPress]) -> tuple[Path, list[str]] | None:
    """Return folder and names of the pictures that determine the size in a recording of ball presses only."""
    if not (flats and balls) or _named(root, layout.CURVES, layout.POINTS):
        return None
    return flats[0].parent, [flat.name for flat in flats]


def _check_no_frames_needed(recording: Recording) -> None:
    """Check that, without pictures, there are curves, points or ball presses, and no list of pictures."""
    root, folder = recording.path, recording.path / layout.FRAMES
    light_alone = _named(root, layout.BALL_TABLE) and not _is_calibration(root)
    listed = _named(root, layout.FRAME_TABLE)
    if listed or not (light_alone or _named(root, layout.CURVES, layout.POINTS)):
        others = sorted(path.name for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []
        if others:
            raise RecordingError(
                f"none of its {len(others)} files is a picture or a video of a supported kind",
                where=folder,
                value=others[0],
                remedy=f"Save them as one of {', '.join(layout.IMAGE_SUFFIXES)}.",
            )
        if listed:
            raise RecordingError(
                "frames are listed, but there are no pictures",
                where=folder,
                remedy=f"Put them there, or remove {layout.FRAME_TABLE}.",
            )
        # raises for ball presses without their table
        pictures.read_balls(root / layout.BALLS, root / layout.BALL_TABLE)
        raise RecordingError(
            "the recording holds neither frames nor curves nor points",
            where=root,
            remedy=f"Add {layout.FRAMES}/ with {layout.FRAME_TABLE}, or {layout.CURVES}, or {layout.POINTS}.",
        )


def _is_calibration(root: Path) -> bool:
    """Return whether times matter: then a missing frames.csv is an error."""
    return _named(root, layout.FORCES, layout.PRESSES)


def _named(root: Path, *names: str) -> bool:
    """Return whether one of these is in the folder, even a pipe or a broken link: its reader reports it."""
    return any(os.path.lexists(root / name) for name in names)


def _with_tables(recording: Recording, settings: Settings, toml: Path) -> Recording:
    """Add the tables that exist."""
    root, found, tables = recording.path, dict[str, Any](), list[Table]()
    readers: dict[str, tuple[str, Callable[[Path], tuple[Any, Table]]]] = {
        "forces": (layout.FORCES, partial(read_forces, settings=settings.force, toml=toml)),
        "presses": (layout.PRESSES, partial(read_presses, indenters=recording.indenters)),
        "stage": (layout.STAGE, read_stage),
        "curves": (layout.CURVES, read_curves),
        "points": (layout.POINTS, partial(read_points, indenters=recording.indenters)),
    }
    for field, (name, read) in readers.items():
        if _named(root, name):
            found[field], table = read(root / name)
            tables.append(table)
    if "forces" in found:
        found["force_std_N"] = found["forces"].std_N
        if not settings.force.std_N:
            found["warnings"] = (f"{toml.name}: [force] std_N is missing: it was estimated from {layout.FORCES}",)
    notes = tuple(note for table in tables for note in table.warnings) + found.pop("warnings", ())
    extra = dict(recording.extra)
    for table in tables:
        extra |= _extra(table)
    return replace(recording, **found, extra=extra, warnings=recording.warnings + notes)


def _extra(table: Table) -> dict[str, Columns]:
    return {table.path.name: table.extra} if table.extra else {}


def _indenter(name: str, settings: IndenterSettings, toml: Path) -> Indenter:
    found = settings.model_dump(include=set(Indenter.__dataclass_fields__) - {"name"}, exclude_none=True)
    with found_in(toml, f"[indenter.{name}]"):
        return Indenter(name=name, **found)


# Several recordings of one gel.

Source = str | Path | Recording


def read_recordings(given: Sequence[Source]) -> list[Recording]:
    """Return the recordings, the oldest first. Raises RecordingError where one lacks what certification needs."""
    opened = oldest_first(given)
    for recording in opened:
        if recording.frame_names:
            require_all(recording)
        elif not (recording.curves or recording.points):
            require(recording, "frames", step="certifying depths")
    return opened


def oldest_first(given: Sequence[Source]) -> list[Recording]:
    """Return the recordings, read where they are folders, in the order of their dates."""
    read = [one if isinstance(one, Recording) else read_recording(one) for one in given]
    return sorted(read, key=lambda one: str(one.date or ""))
