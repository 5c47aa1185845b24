"""Command `live`: depth, contact and force of frames as they come."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from tactilevision.cli import console, options, source
from tactilevision.errors import InputError
from tactilevision.files.runs import output_lock
from tactilevision.files.writing import append_text, write_text
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.scene_faults import scene_faults
from tactilevision.profile.sensor import CalibratedSensor
from tactilevision.recording.folder import list_references
from tactilevision.recording.images import read_image
from tactilevision.recording.model import faults_of_reference
from tactilevision.records.maps import LIGHT, Frame, flag_messages
from tactilevision.robots import camera as cameras
from tactilevision.robots.camera import FRAMES, Audit, Newest, Played, Shot, Source, audit
from tactilevision.robots.live import COLUMNS, OF_PATCHES, Counts, LiveResult, Stream, run
from tactilevision.robots.preview import Foxglove, Preview, check_installed, words

EVERY_S = 1  # s between two lines on the terminal
TABLE, PATCHES = "live.csv", "patches.csv"


def live(given: options.Live) -> None:
    """Read frames live: depth, contact and wrench, rate and latency. Frames are dropped, never queued."""
    if given.foxglove or given.mcap is not None:
        check_installed()
    chosen = source.Choice(given.sensor, given.reference, given.method, given.mm_per_px, even_so=given.even_so)
    opened = _open(given.camera, chosen, given.indenter, given.form, rate=None if given.every else given.rate)
    found = audit(opened.first, timed=not opened.source.waits)
    _say_audit(opened, found)
    counts, newest = Counts(), Newest(opened.source, every=given.every)
    try:
        with ExitStack() as stack:
            shows = _shows(stack, opened.stream, given.preview, foxglove=given.foxglove, mcap=given.mcap)
            table = _table(stack, given.out)
            reporter = _Reporter(counts, opened.stream, shows, table, given.frames, given.seconds)
            run(stack.enter_context(newest), opened.stream, counts=counts, report=reporter)
    finally:  # also where the camera has gone, or after Ctrl-C
        _say_end(counts, newest.came, newest.dropped)
        console.hand_over(counts.as_json() | {"dropped": newest.dropped, "audit": found.as_json()}, given.json)
    if not counts.read:
        raise InputError("no frame could be read", where="live", value=counts.why or f"{newest.came} frames came")


@dataclass(frozen=True, slots=True)
class _Opened:
    """A source, its first shots for the audit, its stream and its warnings."""

    source: Source
    first: list[Any]
    stream: Stream
    doubts: tuple[str, ...]


def _open(
    camera: str, chosen: source.Choice, indenter: str | None, form: str | None, *, rate: float | None
) -> _Opened:
    numbered = re.fullmatch(r"(?:/dev/video)?(\d+)", camera)
    if numbered:
        device = cameras.open_camera(int(numbered[1]), form=form)
        first = list(islice(device.shots(), FRAMES))
        return _Opened(device, first, Stream(_calibrated(chosen, indenter), even_so=chosen.even_so), device.doubts)
    if form is not None:
        raise InputError("only a camera has a format of frames", where="--format", value=form, remedy="Omit it.")
    if "://" in camera:
        remedy = "Name a camera's number, a video or a folder of pictures; in code, pass frames to Stream."
        raise InputError("network streams are not supported", where="--camera", value=camera, remedy=remedy)
    recording = chosen.open(Path(camera))
    plain = chosen.profile is None
    stream = Stream(chosen.light(recording) if plain else _calibrated(chosen, indenter), even_so=chosen.even_so)
    first = list(islice(Played(recording, rate_Hz=None).shots(), FRAMES))
    return _Opened(Played(recording, rate_Hz=rate), first, stream, recording.warnings)


def _calibrated(chosen: source.Choice, indenter: str | None) -> Any:
    if chosen.profile is None:
        remedy = "Make one with `tactilevision calibrate-sensor`, and name it with --sensor FILE.tvs."
        raise InputError("a camera needs a calibrated sensor", where="live", remedy=remedy)
    sensor = CalibratedSensor(chosen.profile, indenter=indenter)
    flats = list_references(chosen.reference)
    if not flats:
        return sensor
    with faults_of_reference(chosen.reference):
        return sensor.with_reference([read_image(path) for path in flats])


def _say_audit(opened: _Opened, found: Audit) -> None:
    """Print the audit of the camera, and warnings of the reference and the sensor, by the first frames."""
    reader = opened.stream.reconstructor
    pictures = [reader.rectified(Frame(shot.rgb)) for shot in opened.first[:: max(1, len(opened.first) // 5)]]
    before, said = reader.warnings, opened.stream.look(pictures)
    timed = "" if opened.source.waits else f"{found.rate_Hz:.1f} frames a second, {found.lost} lost, "
    console.say(f"{opened.source.name}: {timed}{found.repeated} of {found.frames} frames repeat the one before")
    console.warn([*before, *opened.doubts, *found.warnings, *said])


def _shows(
    stack: ExitStack, stream: Stream, preview: int | None, *, foxglove: bool, mcap: Path | None
) -> list[Callable[[LiveResult, float], None]]:
    """Open the page, Foxglove and its file until the stack ends; return the functions that take each result."""
    found: list[Callable[[LiveResult, float], None]] = []
    if preview is not None:
        page = stack.enter_context(Preview(stream.reconstructor, preview))
        console.say(f"preview: {page.address}")
        found.append(page.show)
    if foxglove or mcap is not None:
        if mcap is not None:
            stack.enter_context(output_lock(mcap, file=True))
        outlet = stack.enter_context(Foxglove(stream.reconstructor, serve=foxglove, mcap=mcap))
        if outlet.page is not None:
            console.say(f"foxglove: {outlet.page.address}")
        found.append(outlet.show)
    return found


def _table(stack: ExitStack, out: Path | None) -> Path | None:
    """Begin live.csv and patches.csv in a folder that is locked until the stack ends; None without --out."""
    if out is None:
        return None
    stack.enter_context(output_lock(out))
    for name, columns in ((TABLE, COLUMNS), (PATCHES, OF_PATCHES)):
        write_text(out / name, ",".join(columns) + "\n")
    return out / TABLE


@dataclass
class _Reporter:
    """Report each result to the views, the table, and every second the terminal; return False at the end."""

    counts: Counts
    stream: Stream
    shows: list[Callable[[LiveResult, float], None]]
    table: Path | None
    frames: int | None
    seconds: float | None
    printed_s: float = 0.0
    named: bool = False

    def __call__(self, result: LiveResult) -> bool:
        if LIGHT in result.moment.height.flags and not self.named:
            self.named = True  # once, as it takes longer than a frame
            console.warn(_faults(self.stream.reconstructor, result.shot))
        for show in self.shows:
            show(result, self.counts.rate_Hz)
        if self.table is not None:
            append_text(self.table, result.as_row())
            append_text(self.table.with_name(PATCHES), result.patch_rows())
        now_s = time.monotonic()
        if now_s - self.printed_s >= EVERY_S:
            self.printed_s = now_s
            console.say("; ".join(words(result, rate_Hz=self.counts.rate_Hz)))
        enough = self.frames is not None and self.counts.read >= self.frames
        return not (enough or (self.seconds is not None and now_s - self.counts.began_s >= self.seconds))


def _faults(reader: Reconstructor, shot: Shot) -> list[str]:
    """Return the changes of the scene between the reference and a shot."""
    if reader.referenced is None:
        return []
    found = scene_faults(reader.referenced.reference.rgb, [reader.rectified(Frame(shot.rgb))])
    return [f"{shot.name}: {fault.sentence}" for fault in found]


def _say_end(counts: Counts, came: int, dropped: int) -> None:
    if counts.read:
        console.say(
            f"{counts.read} frames read of {came} that came, {dropped} dropped, {counts.rate_Hz:.1f} a second; "
            f"95 % had a result within {counts.age95_ms:.1f} ms of arrival",
            *counts.lines(),
        )
        console.warn(flag_messages(counts.flags, counts.read))
    if counts.refused:
        console.warn([f"{counts.refused} frames were refused, the last because {counts.why}"])
