"""A live stream on a local page, in Foxglove, or in an MCAP file."""

from __future__ import annotations

import base64
import json
import math
import re
import struct
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np

from tactilevision.errors import OutputError, library
from tactilevision.files.documents import parse_json
from tactilevision.files.writing import replacing
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.local_page import TEXT, Answer, Link, LocalPage
from tactilevision.records.constants import MILLI
from tactilevision.records.measured import Bytes, Floats, Pair
from tactilevision.records.wrench import PATCH_COLUMNS
from tactilevision.robots.live import LiveResult
from tactilevision.sensors.rectification import rectify

# A page whose picture is drawn in the server's threads on request.

DEEPEST_MM = 1.0  # mm at the top of the colours; deeper places have the same colour
TEXT_PX = 22  # px of a line of text
QUALITY = 85  # of the JPEGs
INK = (32, 32, 32)  # grey levels of the text
PAPER = (250, 250, 250)  # grey levels below the text
WAIT_S = 10  # s that a request waits for the first frame
EVERY_S = 0.05  # s between two drawings, however many look on: the camera has priority
UNKNOWN = (150, 150, 150)  # grey levels where no depth is known
FILES = {
    "": Answer(
        "text/html; charset=utf-8",
        b"""<!doctype html><html lang="en"><meta charset="utf-8"><title>tactilevision live</title>
<link rel="stylesheet" href="page.css"><h1>Live</h1>
<img alt="picture and depth"><script src="page.js"></script>""",
    ),
    "page.css": Answer("text/css", b"body{margin:1em;background:#fafafa;font:16px sans-serif}img{max-width:100%}"),
    "page.js": Answer(
        "text/javascript",
        b"""const picture = document.querySelector("img");
let asked = 0;
const next = () => { picture.src = `frame.jpg?${asked++}`; };
picture.onload = () => setTimeout(next, 100);
picture.onerror = () => setTimeout(next, 1000);
next();
""",
    ),
}


def draw(rgb_rectified: Bytes, result: LiveResult, *, rate_Hz: float) -> Bytes:
    """Draw picture and depth side by side over lines of text, blue first: (h, w, 3) grey levels."""
    height = result.moment.height
    depth = np.where(height.valid, height.depth_mm, 0.0)
    level = np.asarray(np.clip(255 * depth / DEEPEST_MM, 0, 255), np.uint8)
    coloured = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)
    coloured[~height.valid] = UNKNOWN
    pair = np.hstack([cv2.cvtColor(rgb_rectified, cv2.COLOR_RGB2BGR), coloured])
    lines = [
        *words(result, rate_Hz=rate_Hz),
        f"right: depth, from 0 (dark) to {DEEPEST_MM:g} mm (bright); grey: unknown",
    ]
    below = np.full((TEXT_PX * len(lines) + 8, pair.shape[1], 3), PAPER, np.uint8)
    for number, line in enumerate(lines, start=1):
        place = (6, TEXT_PX * number - 4)
        cv2.putText(below, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, INK, 1, cv2.LINE_AA)
    return np.asarray(np.vstack([pair, below]), np.uint8)


def words(result: LiveResult, *, rate_Hz: float) -> tuple[str, ...]:
    """Return the lines below the pictures."""
    moment, wrench = result.moment, result.moment.wrench
    touch = f"contact, {moment.peak_mm:.3f} mm deep" if moment.contact else "nothing touches"
    pushed = wrench is not None and (moment.contact or np.any(np.nan_to_num(wrench.force_N)))
    hidden_N = math.nan if moment.tractions is None else moment.tractions.could_hide_N
    limit = f" above {hidden_N:.3f} N" if math.isfinite(hidden_N) else ""
    lines = [f"{result.shot.name}: {touch}" + (f", no force{limit}" if wrench is not None and not pushed else "")]
    if wrench is not None and pushed:
        forces = zip("xyz", wrench.force_N, strict=True)
        known = [f"f{axis} {force:+.3f} N" for axis, force in forces if math.isfinite(force)]
        lines.append(", ".join(known) + f" (fz +- {wrench.force_std_N[2]:.3f})")
    lines.append(f"{rate_Hz:.0f} frames a second, {result.age_ms:.0f} ms old")
    return (*lines, *(f"flag: {flag}" for flag in moment.height.flags))


class Preview(LocalPage):
    """The page while it is open; `show` gives it the newest result."""

    def __init__(self, reconstructor: Reconstructor, port: int) -> None:
        super().__init__(FILES, port=port, option="--preview")
        self.reconstructor = reconstructor
        self._newest: tuple[LiveResult, float] | None = None
        self._came, self._drawing = threading.Event(), threading.Lock()
        self._drawn, self._drawn_s = Answer("image/jpeg", b""), -math.inf

    def show(self, result: LiveResult, rate_Hz: float) -> None:
        """Show the newest result."""
        self._newest = result, rate_Hz
        self._came.set()

    def get(self, name: str, asked: Mapping[str, str]) -> Answer | None:
        """Return the newest picture once there is one; viewers share a drawing for EVERY_S."""
        if name != "frame.jpg" or not self._came.wait(WAIT_S) or self._newest is None:
            return None
        with self._drawing:
            if time.monotonic() - self._drawn_s > EVERY_S:
                result, rate_Hz = self._newest
                picture = draw(rectify(self.reconstructor.sensor, result.shot.rgb), result, rate_Hz=rate_Hz)
                encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
                self._drawn, self._drawn_s = Answer("image/jpeg", encoded.tobytes()), time.monotonic()
            return self._drawn


# Foxglove, over its websocket on this machine and as an MCAP file (extra `foxglove`).
#
# The websocket is a local page's: it needs the token, and the Origin of Foxglove if it states one. A slow viewer
# misses frames.
# Topics: /picture the rectified frame (RawImage), /depth the map and /tractions the forces as grids (Grid; places
# on the pad from its centre, in metres; MPa), /wrench, /patches and /state as JSON. Times are this machine's,
# since 1970.

PAD = "pad"  # frame of reference of all topics
S_TO_NS = 10**9  # nanoseconds in a second
PORT = 8765  # the default port of Foxglove
MESSAGE = 1  # first byte of a message of the protocol with data
MAX_ASKED = 100  # subscriptions of one viewer; there are six topics
_NUMBERS = {"type": "array", "items": {"type": ["number", "null"]}}
_NUMBER = {"type": ["number", "null"]}
_ABOUT_WRENCH = ("force_N", "force_std_N", "moment_Nmm", "moment_std_Nmm", "covariance", "point_mm")
_WRENCH = dict.fromkeys(_ABOUT_WRENCH, _NUMBERS) | {"could_hide_N": _NUMBER}
_PATCH = {"type": "object", "properties": dict.fromkeys(PATCH_COLUMNS, _NUMBER)}
_PATCHES = {"patches": {"type": "array", "items": _PATCH}}
_STATE = {
    "contact": {"type": "boolean"},
    **{key: {"type": "number"} for key in ("peak_mm", "age_ms", "rate_Hz")},
    "flags": {"type": "array", "items": {"type": "string"}},
}


def check_installed() -> None:
    """Raise InputError where the extra is missing."""
    library("foxglove", extra="foxglove", where="--foxglove and --mcap")


class Foxglove:
    """Foxglove's channels while they are open; `show` sends each result.

    `serve` on PORT of this machine; `mcap` is a file, renamed once it is complete, also where the stream ended by
    an error. Raises InputError where the extra is missing, OutputError where the file cannot be written.
    """

    def __init__(self, reconstructor: Reconstructor, *, serve: bool = False, mcap: Path | None = None) -> None:
        self.reconstructor, self.mcap = reconstructor, mcap
        check_installed()
        import foxglove
        from foxglove.messages import Grid, RawImage

        context = self._context = foxglove.Context()  # its channels close with it
        plain = {"/wrench": _WRENCH, "/patches": _PATCHES, "/state": _STATE}
        schemas = {topic: {"type": "object", "properties": schema} for topic, schema in plain.items()}
        kinds = {"/picture": RawImage, "/depth": Grid, "/tractions": Grid}
        schemas |= {topic: kind.get_schema() for topic, kind in kinds.items()}
        self._channels = {
            topic: foxglove.Channel(
                topic, schema=schema, message_encoding="protobuf" if topic in kinds else "json", context=context
            )
            for topic, schema in schemas.items()
        }
        self._began_ns = time.time_ns() - round(S_TO_NS * time.monotonic())
        self._writer = None
        with ExitStack() as opening:
            if mcap is not None:
                temporary = opening.enter_context(replacing(mcap))
                self._writer = foxglove.open_mcap(temporary, allow_overwrite=True, context=context)
            self.page = opening.enter_context(Streamed(self._channels)) if serve else None
            self._files = opening.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            with self._files:  # renamed also where an error ended the stream
                if self._writer is not None:
                    self._writer.close()
        except (RuntimeError, OutputError) as refused:  # its own kind of error, also for a full disk
            if kind is not None:  # the error that ended the stream, or an interrupt, is raised instead
                return
            if isinstance(refused, OutputError):
                raise
            said = f"cannot be written: {refused}"
            raise OutputError(said, where=self.mcap, remedy="Is the disk full?") from refused

    def show(self, result: LiveResult, rate_Hz: float) -> None:
        """Send one result on all topics."""
        if self._writer is None and (self.page is None or not self.page.viewers):
            return
        at_ns = self._began_ns + round(S_TO_NS * result.shot.time_s)
        messages = dict(self._messages(result, rate_Hz, _stamp(at_ns)))
        for topic, message in messages.items():
            self._channels[topic].log(message, log_time=at_ns)
        if self.page is not None:
            self.page.show(at_ns, messages)

    def _messages(self, result: LiveResult, rate_Hz: float, stamp: Any) -> Iterator[tuple[str, bytes]]:
        """Yield the encoded message of each topic."""
        from foxglove.messages import RawImage

        moment, rgb = result.moment, rectify(self.reconstructor.sensor, result.shot.rgb)
        height, width = rgb.shape[:2]
        size: dict[str, Any] = {"width": width, "height": height, "step": 3 * width}
        data = np.ascontiguousarray(rgb).tobytes()
        yield "/picture", RawImage(timestamp=stamp, frame_id=PAD, encoding="rgb8", data=data, **size).encode()
        depth = moment.height
        known = np.where(depth.valid, depth.depth_mm * MILLI, np.nan)
        yield "/depth", _grid({"elevation": known}, depth.mm_per_px, stamp=stamp)
        state = {"contact": moment.contact, "peak_mm": moment.peak_mm, "age_ms": result.age_ms, "rate_Hz": rate_Hz}
        yield "/state", _json(state | {"flags": list(depth.flags)})
        found, wrench = moment.tractions, moment.wrench
        if found is None or wrench is None:
            return
        fields = {"t_x": found.t_x, "t_y": found.t_y, "t_z": found.t_z}
        yield "/tractions", _grid(fields, found.mm_per_px, stamp=stamp, first_mm=found.first_mm)
        about = {name: _plain(np.ravel(getattr(wrench, name))) for name in _ABOUT_WRENCH}
        yield "/wrench", _json(about | {"could_hide_N": _plain((found.could_hide_N,))[0]})
        rows = [dict(zip(PATCH_COLUMNS, _plain(one.row), strict=True)) for one in found.patches]
        yield "/patches", _json({"patches": rows})


class Streamed(LocalPage):
    """Foxglove's websocket while it is open; `show` gives it the newest messages.

    Source: Foxglove WebSocket protocol, version 1 (github.com/foxglove/ws-protocol).
    """

    protocols = ("foxglove.sdk.v1", "foxglove.websocket.v1")
    origins = re.compile(r"https://([a-z0-9-]+\.)*foxglove\.dev|file://")  # of its page, of its program

    def __init__(self, channels: Mapping[str, Any]) -> None:
        super().__init__({}, port=PORT, option="--foxglove")
        self._topics = dict(enumerate(channels, start=1))
        self._channels = [_advert(number, channels[topic]) for number, topic in self._topics.items()]
        self._newest: tuple[int, Mapping[str, bytes]] = (0, {})
        self.viewers: set[Link] = set()

    @property
    def address(self) -> str:
        """URL of the websocket with its token."""
        return super().address.replace("http://", "ws://")

    def show(self, at_ns: int, messages: Mapping[str, bytes]) -> None:
        """Show the newest messages by topic."""
        self._newest = at_ns, messages

    def converse(self, link: Link) -> None:
        """Name the channels, and send the newest message of those that are subscribed to."""
        link.send(_json({"op": "serverInfo", "name": "tactilevision", "capabilities": []}), TEXT)
        link.send(_json({"op": "advertise", "channels": self._channels}), TEXT)
        asked: dict[int, str] = {}
        sent_ns = 0
        self.viewers.add(link)
        try:
            while True:
                heard = link.receive()
                if heard is not None:
                    self._subscribe(asked, parse_json(heard, where="the websocket"))
                at_ns, messages = self._newest
                for number, topic in asked.items() if at_ns != sent_ns else ():
                    if topic in messages:
                        link.send(struct.pack("<BIQ", MESSAGE, number, at_ns) + messages[topic])
                sent_ns = at_ns
        finally:
            self.viewers.discard(link)

    def _subscribe(self, asked: dict[int, str], content: Mapping[str, Any]) -> None:
        """Note which channels a viewer subscribes to, by its own numbers."""
        if content.get("op") == "subscribe":
            for one in content.get("subscriptions", ()):
                number, channel = int(one["id"]), int(one["channelId"])
                if len(asked) < MAX_ASKED and 0 <= number < 1 << 32 and channel in self._topics:
                    asked[number] = self._topics[channel]
        elif content.get("op") == "unsubscribe":
            for number in content.get("subscriptionIds", ()):
                asked.pop(int(number), None)


def _advert(number: int, channel: Any) -> dict[str, Any]:
    """Return a channel in the words of the protocol."""
    schema = channel.schema()
    text = schema.data.decode() if schema.encoding == "jsonschema" else base64.b64encode(schema.data).decode()
    return {
        **{"id": number, "topic": channel.topic(), "encoding": channel.message_encoding},
        **{"schemaName": schema.name, "schema": text, "schemaEncoding": schema.encoding},
    }


def _grid(fields: dict[str, Floats], mm_per_px: Pair, *, stamp: Any, first_mm: Pair | None = None) -> bytes:
    """Encode fields (H, W) as one grid of float32, each cell centred on its pixel."""
    from foxglove import messages

    stacked = np.stack([np.asarray(field, "<f4") for field in fields.values()], axis=-1)
    rows, columns, count = stacked.shape
    sizes = zip((columns, rows), mm_per_px, strict=True)
    first = first_mm or tuple(-(n - 1) / 2 * step for n, step in sizes)
    corner = [MILLI * (place - step / 2) for place, step in zip(first, mm_per_px, strict=True)]
    origin = messages.Vector3(x=corner[0], y=corner[1], z=0.0)
    upright = messages.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    number = messages.PackedElementFieldNumericType.Float32
    grid = messages.Grid(
        timestamp=stamp,
        frame_id=PAD,
        pose=messages.Pose(position=origin, orientation=upright),
        column_count=columns,
        cell_size=messages.Vector2(x=MILLI * mm_per_px[0], y=MILLI * mm_per_px[1]),
        row_stride=4 * count * columns,
        cell_stride=4 * count,
        fields=[
            messages.PackedElementField(name=name, offset=4 * k, type=number) for k, name in enumerate(fields)
        ],
        data=np.ascontiguousarray(stacked).tobytes(),
    )
    return bytes(grid.encode())


def _json(content: dict[str, Any]) -> bytes:
    return json.dumps(content).encode()


def _stamp(at_ns: int) -> Any:
    from foxglove.messages import Timestamp

    return Timestamp(sec=at_ns // 10**9, nsec=at_ns % 10**9)


def _plain(values: Iterable[float]) -> list[float | None]:
    """Replace NaN and infinity, which JSON lacks, by None."""
    return [float(value) if math.isfinite(value) else None for value in values]
