"""What a stream sees, as a page on this machine: the picture, the depth beside it, and the numbers below.

The page is served on 127.0.0.1 alone, as JPEGs that follow each other (multipart/x-mixed-replace). Pictures are
drawn in the server's own threads, for those who look, so that nobody looking costs nothing.
"""

from __future__ import annotations

import math
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from tactilevision.camera.loop import Told
from tactilevision.errors import InputError
from tactilevision.reconstruct import Reconstructor
from tactilevision.records import Bytes
from tactilevision.sensors import rectify

DEEPEST_MM = 1.0  # mm at the top of the colours; deeper stays there, so that colours keep their meaning
WAIT_S = 0.1  # s between two pictures: ten a second are enough to look at
TEXT_PX = 22  # px of a line of text
QUALITY = 85  # of the JPEGs that are shown; nothing is measured on them
BOUNDARY = "frame"
INK = (32, 32, 32)  # of the text, near black
PAPER = (250, 250, 250)  # below the text, near white
UNKNOWN = (150, 150, 150)  # where no depth is known; no colour of the map is grey
PAGE = b"""<!doctype html><html lang="en"><meta charset="utf-8"><title>tactilevision live</title>
<style>body{margin:1em;background:#fafafa;font:16px sans-serif}img{max-width:100%}</style>
<h1>Live</h1><img src="/frames" alt="picture and depth"></html>"""


def draw(rgb_rectified: Bytes, told: Told, *, rate_Hz: float) -> Bytes:
    """Picture and depth side by side over lines of text, blue first: (h, w, 3) grey levels."""
    height = told.moment.height
    depth = np.where(height.valid, height.depth_mm, 0.0)
    level = np.asarray(np.clip(255 * depth / DEEPEST_MM, 0, 255), np.uint8)
    coloured = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)
    coloured[~height.valid] = UNKNOWN
    pair = np.hstack([cv2.cvtColor(rgb_rectified, cv2.COLOR_RGB2BGR), coloured])
    lines = [
        *words(told, rate_Hz=rate_Hz),
        f"right: depth, from 0 (dark) to {DEEPEST_MM:g} mm (bright); grey: unknown",
    ]
    below = np.full((TEXT_PX * len(lines) + 8, pair.shape[1], 3), PAPER, np.uint8)
    for number, line in enumerate(lines, start=1):
        place = (6, TEXT_PX * number - 4)
        cv2.putText(below, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, INK, 1, cv2.LINE_AA)
    return np.asarray(np.vstack([pair, below]), np.uint8)


def words(told: Told, *, rate_Hz: float) -> tuple[str, ...]:
    """What is written below the pictures."""
    moment, wrench = told.moment, told.moment.wrench
    touch = f"contact, {moment.peak_mm:.3f} mm deep" if moment.contact else "nothing touches"
    pushed = wrench is not None and (moment.contact or np.any(wrench.force_N))
    lines = [f"{told.shot.name}: {touch}" + (", no force" if wrench is not None and not pushed else "")]
    if wrench is not None and pushed:
        forces = zip("xyz", wrench.force_N, strict=True)
        known = [f"f{axis} {force:+.3f} N" for axis, force in forces if math.isfinite(force)]
        lines.append(", ".join(known) + f" (fz +- {wrench.force_std_N[2]:.3f})")
    lines.append(f"{rate_Hz:.0f} frames a second, {told.age_ms:.0f} ms old")
    return (*lines, *(f"flag: {flag}" for flag in moment.height.flags))


class Preview:
    """The page while it is open; `show` hands it the newest moment."""

    def __init__(self, reconstructor: Reconstructor, port: int) -> None:
        self.reconstructor = reconstructor
        self._newest: tuple[Told, float] | None = None
        self._turn = threading.Condition()
        self._ended = False
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), _handler(self))
        except (OSError, OverflowError) as fault:
            raise InputError(
                "the preview's port cannot be used", where="--preview", value=port, remedy="Name another, or 0."
            ) from fault
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, name="preview", daemon=True)

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._turn:
            self._ended = True
            self._turn.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def show(self, told: Told, rate_Hz: float) -> None:
        """Put the newest moment up."""
        with self._turn:
            self._newest = told, rate_Hz
            self._turn.notify_all()

    def next(self, last: int) -> tuple[int, bytes] | None:
        """The number of a frame other than `last`, and it as JPEG; None when there are no more."""
        with self._turn:
            self._turn.wait_for(lambda: self._ended or (self._newest and self._newest[0].shot.number != last))
            if self._ended or self._newest is None:
                return None
            told, rate_Hz = self._newest
        picture = draw(rectify(self.reconstructor.sensor, told.shot.rgb), told, rate_Hz=rate_Hz)
        encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
        return told.shot.number, encoded.tobytes()


def _handler(preview: Preview) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path == "/frames":
                self._frames()
            elif self.path == "/":
                self._whole(PAGE)
            else:
                self.send_error(404)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 -- the base class names it so
            """The terminal is for the numbers."""

        def _whole(self, page: bytes) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(page)))
            self.end_headers()
            self.wfile.write(page)

        def _frames(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
            self.end_headers()
            last, pause = -1, threading.Event()
            while (found := preview.next(last)) is not None:
                last, jpeg = found
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                try:
                    self.wfile.write(head.encode() + jpeg + b"\r\n")
                except OSError:  # the browser has gone
                    return
                pause.wait(WAIT_S)

    return Handler
