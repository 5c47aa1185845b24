"""`tactilevision live --camera 0`: frames as they come into depth, contact and force."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactilevision.cli import console, source
from tactilevision.errors import InputError
from tactilevision.files.runs import output_lock

if TYPE_CHECKING:
    from tactilevision.heightmap.reconstructor import Reconstructor
    from tactilevision.robots.camera import Audit, Shot, Source
    from tactilevision.robots.live import Counts, Stream, Told

EVERY_S = 1.0  # s between two lines on the terminal
TABLE = "live.csv"


class Format(StrEnum):
    """What a camera sends: `camera.sources.FORMATS`."""

    MJPEG = "mjpeg"
    RAW = "raw"


def live(
    camera: Annotated[
        str, typer.Option(help="A camera's number, a video, or a folder of pictures.", metavar="0|VIDEO|FOLDER")
    ] = "0",
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    mm_per_px: source.ScaleOption = None,
    even_so: source.EvenSoOption = False,
    indenter: Annotated[
        str | None, typer.Option(help="Look for the face of this indenter of the profile.")
    ] = None,
    form: Annotated[Format | None, typer.Option("--format", help="What the camera is to send.")] = None,
    rate: Annotated[float, typer.Option(min=0.1, help="Frames a second of a video or folder.")] = 30.0,
    every: Annotated[
        bool, typer.Option("--every", help="Of a video or folder read every frame, however long it takes.")
    ] = False,
    frames: Annotated[int | None, typer.Option(min=1, help="Stop after so many frames.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="Stop after so long.")] = None,
    preview: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Show a page on this port of this machine; 0: a free one.")
    ] = None,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="Serve Foxglove on this machine: pictures, maps, wrench.")
    ] = False,
    mcap: Annotated[Path | None, typer.Option(help="Write the same into this MCAP file.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for live.csv; made if missing.")] = None,
    json: console.JsonOption = None,
) -> None:
    """Read frames live: depth, contact and wrench, rate and latency. Frames are dropped, never queued."""
    from tactilevision.robots.preview import check_installed

    if foxglove or mcap is not None:
        check_installed()  # before the camera is looked at
    chosen = source.Choice(sensor, reference, method, mm_per_px, even_so=even_so)
    opened = _open(camera, chosen, indenter, form, rate=None if every else rate)

    def listeners(stack: ExitStack) -> tuple[list[Callable[[Told, float], None]], Path | None]:
        return _shows(stack, opened.stream, preview, foxglove=foxglove, mcap=mcap), _table(stack, out)

    _play(opened, listeners, until=(frames, seconds), every=every, json=json)


def _play(
    opened: _Opened,
    listeners: Callable[[ExitStack], tuple[list[Callable[[Told, float], None]], Path | None]],
    *,
    until: tuple[int | None, float | None],
    every: bool,
    json: Path | None,
) -> None:
    """Audit what was opened, then read it frame by frame `until` so many frames or seconds; say both."""
    from tactilevision.robots.camera import Newest, audit
    from tactilevision.robots.live import Counts, run

    found = audit(opened.first, timed=not opened.source.waits)
    _tell_audit(opened, found)
    counts, newest = Counts(), Newest(opened.source, every=every)
    try:
        with ExitStack() as stack:
            teller = _Teller(counts, opened.stream, *listeners(stack), *until)
            run(stack.enter_context(newest), opened.stream, counts=counts, tell=teller)
    finally:  # also where the camera went, or Ctrl-C was typed
        _tell_end(counts, newest.came, newest.dropped)
        console.hand_over(_as_json(counts, found, newest.dropped), json)
    if not counts.read:
        raise InputError("no frame could be read", where="live", value=counts.why or f"{newest.came} frames came")


@dataclass(frozen=True, slots=True)
class _Opened:
    """A source, its first shots for the audit, and the stream that its frames go through."""

    source: Source
    first: list[Any]
    stream: Stream
    doubts: tuple[str, ...]


def _open(
    camera: str, chosen: source.Choice, indenter: str | None, form: Format | None, *, rate: float | None
) -> _Opened:
    from tactilevision.robots.camera import FRAMES, Played, open_camera
    from tactilevision.robots.live import Stream

    numbered = re.fullmatch(r"(?:/dev/video)?(\d+)", camera)
    if numbered:
        device = open_camera(int(numbered[1]), form=None if form is None else form.value)
        first = list(islice(device.shots(), FRAMES))
        return _Opened(device, first, Stream(_calibrated(chosen, indenter), even_so=chosen.even_so), device.doubts)
    if form is not None:
        raise InputError(
            "only a camera is told what to send", where="--format", value=form.value, remedy="Leave it out."
        )
    if "://" in camera:
        raise InputError(
            "streams of a network are not read",
            where="--camera",
            value=camera,
            remedy="Name a camera's number, a video or a folder of pictures; in code, hand frames to Stream.",
        )
    recording = chosen.open(Path(camera))
    plain = chosen.profile is None
    stream = Stream(chosen.light(recording) if plain else _calibrated(chosen, indenter), even_so=chosen.even_so)
    first = list(islice(Played(recording, rate_Hz=None).shots(), FRAMES))
    return _Opened(Played(recording, rate_Hz=rate), first, stream, recording.warnings)


def _calibrated(chosen: source.Choice, indenter: str | None) -> Any:
    from tactilevision.profile.sensor import CalibratedSensor
    from tactilevision.recording.folder import list_references
    from tactilevision.recording.images import read_image
    from tactilevision.recording.model import faults_of_reference

    if chosen.profile is None:
        raise InputError(
            "a camera needs a calibrated sensor",
            where="live",
            remedy="Make one with `tactilevision calibrate-sensor`, and name it with --sensor FILE.tvs.",
        )
    sensor = CalibratedSensor(chosen.profile, indenter=indenter)
    flats = list_references(chosen.reference)
    if not flats:
        return sensor
    with faults_of_reference(chosen.reference):
        return sensor.with_reference([read_image(path) for path in flats])


def _tell_audit(opened: _Opened, found: Audit) -> None:
    """What the first frames say of the camera, of the reference, and of the sensor."""
    from tactilevision.records.maps import Frame

    reader = opened.stream.reconstructor
    pictures = [reader.rectified(Frame(shot.rgb)) for shot in opened.first[:: max(1, len(opened.first) // 5)]]
    before, said = reader.warnings, opened.stream.look(pictures)
    timed = "" if opened.source.waits else f"{found.rate_Hz:.1f} frames a second, {found.lost} lost, "
    console.say(f"{opened.source.name}: {timed}{found.repeated} of {found.frames} frames repeat the one before")
    console.warn([*before, *opened.doubts, *found.warnings, *said])


def _shows(
    stack: ExitStack, stream: Stream, preview: int | None, *, foxglove: bool, mcap: Path | None
) -> list[Callable[[Told, float], None]]:
    """What each moment is handed to: a page, Foxglove, a file; open until the stack ends."""
    found: list[Callable[[Told, float], None]] = []
    if preview is not None:
        from tactilevision.robots.preview import Preview

        page = stack.enter_context(Preview(stream.reconstructor, preview))
        console.say(f"preview: {page.address}")
        found.append(page.show)
    if foxglove or mcap is not None:
        from tactilevision.robots.preview import Foxglove

        outlet = stack.enter_context(Foxglove(stream.reconstructor, serve=foxglove, mcap=mcap))
        found.append(outlet.show)
    return found


def _table(stack: ExitStack, out: Path | None) -> Path | None:
    """live.csv with its header, in a folder that is held until the stack ends; None where none is asked for."""
    from tactilevision.files.writing import write_text
    from tactilevision.robots.live import COLUMNS

    if out is None:
        return None
    stack.enter_context(output_lock(out))
    write_text(out / TABLE, ",".join(COLUMNS) + "\n")
    return out / TABLE


@dataclass
class _Teller:
    """Hands each frame to what shows it, the table, and now and then the terminal; says when it is enough."""

    counts: Counts
    stream: Stream
    shows: list[Callable[[Told, float], None]]
    table: Path | None
    frames: int | None
    seconds: float | None
    spoken_s: float = 0.0
    named: bool = False

    def __call__(self, told: Told) -> bool:
        from tactilevision.files.writing import append_text
        from tactilevision.records.maps import LIGHT
        from tactilevision.robots.preview import words

        if LIGHT in told.moment.height.flags and not self.named:
            self.named = True  # once: it takes longer than a frame
            console.warn(_faults(self.stream.reconstructor, told.shot))
        for show in self.shows:
            show(told, self.counts.rate_Hz)
        if self.table is not None:
            append_text(self.table, told.as_row())
        now_s = time.monotonic()
        if now_s - self.spoken_s >= EVERY_S:
            self.spoken_s = now_s
            console.say("; ".join(words(told, rate_Hz=self.counts.rate_Hz)))
        enough = self.frames is not None and self.counts.read >= self.frames
        return not (enough or (self.seconds is not None and now_s - self.counts.began_s >= self.seconds))


def _faults(reader: Reconstructor, shot: Shot) -> list[str]:
    """What happened since the reference to the picture of a shot, by name."""
    from tactilevision.heightmap.scene_faults import scene_faults
    from tactilevision.records.maps import Frame

    if reader.referenced is None:
        return []
    found = scene_faults(reader.referenced.reference.rgb, [reader.rectified(Frame(shot.rgb))])
    return [f"{shot.name}: {fault.sentence}" for fault in found]


def _tell_end(counts: Counts, came: int, dropped: int) -> None:
    from tactilevision.records.maps import told

    if counts.read:
        console.say(
            f"{counts.read} frames read of {came} that came, {dropped} dropped, {counts.rate_Hz:.1f} a second; "
            f"95 of 100 were known within {counts.age95_ms:.1f} ms of coming",
            *counts.lines(),
        )
        console.warn(told(counts.flags, counts.read))
    if counts.refused:
        console.warn([f"{counts.refused} frames were refused, the last because {counts.why}"])


def _as_json(counts: Counts, found: Audit, dropped: int) -> dict[str, Any]:
    from tactilevision.robots.live import EDGES_MS

    return {
        "frames": counts.read,
        "dropped": dropped,
        "refused": counts.refused,
        "rate_Hz": counts.rate_Hz,
        "age95_ms": counts.age95_ms,
        "flags": dict(counts.flags),
        "histogram": [[float(edge), int(count)] for edge, count in zip(EDGES_MS, counts.histogram, strict=True)],
        "audit": found.as_json(),
    }
