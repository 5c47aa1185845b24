"""The server of the workbench's page: its files, its requests by name, and its actions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.workbench.bench import Bench
from calibration.workbench.curve_views import certificate_view, curve_view, tried_view
from calibration.workbench.opened import Frames
from calibration.workbench.views import state_view
from tactilevision.errors import InputError, library
from tactilevision.local_page import POLICY, Answer, LocalPage, page_files
from tactilevision.records.measured import Bytes

PATIENCE_S = 10  # s that a request for news waits
QUALITY = 85  # of a JPEG for display


def _state(bench: Bench, asked: Mapping[str, str]) -> dict[str, Any]:
    """Return the state once it differs from the version that the page has."""
    bench.wait(int(asked.get("since", "0")), PATIENCE_S)
    return state_view(bench)


def _frames(bench: Bench, asked: Mapping[str, str]) -> dict[str, Any]:
    """Return the frames of a press with its certificate's data."""
    frames, press = _frames_of(bench, asked), asked["press"]
    if frames is None:
        return {"frames": [], "times": []}
    return frames.view(press) | certificate_view(bench.shown, int(asked["recording"]), press)


def _jpeg(rgb: Bytes) -> Answer:
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    return Answer("image/jpeg", cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())


def _height(bench: Bench, asked: Mapping[str, str]) -> Answer:
    """Return the height map row by row as 4-byte floats, mm; NaN where not valid."""
    height = _of_recording(bench, asked).see(int(asked["number"])).height
    depth = np.where(height.valid, height.depth_mm, np.nan).astype("<f4")
    rows, columns = depth.shape
    about = {"X-Rows": str(rows), "X-Columns": str(columns), "X-Mm-Per-Px": f"{height.mm_per_px[0]:.6g}"}
    return Answer("application/octet-stream", depth.tobytes(), about)


def _of_recording(bench: Bench, asked: Mapping[str, str]) -> Frames:
    frames = _frames_of(bench, asked)
    if frames is None:
        raise InputError("this recording has no frames", where="workbench")
    return frames


def _frames_of(bench: Bench, asked: Mapping[str, str]) -> Frames | None:
    number, every = int(asked["recording"]), bench.opened.frames
    if not 0 <= number < len(bench.opened.measured):
        raise InputError("there is no such recording", where="workbench", value=number)
    return every[number] if number < len(every) else None


ANSWERS: Mapping[str, Callable[[Bench, Mapping[str, str]], Answer | dict[str, Any]]] = {
    "state": _state,
    "curves": lambda bench, _asked: curve_view(bench.shown),
    "tried": lambda bench, asked: tried_view(bench.shown, asked["name"], float(asked["value"])),
    "frames": _frames,
    "picture": lambda bench, asked: _jpeg(_of_recording(bench, asked).picture(int(asked["number"]))),
    "small": lambda bench, asked: _jpeg(_of_recording(bench, asked).small(int(asked["number"]))),
    "height": _height,
}


PLOTLY = "plotly.js"
REPORT = "report.html"  # as it was exported
REPORTS = {"Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:"}
KEPT = {"Cache-Control": "private, max-age=86400"}  # for plotly, which is large
PLOTLYS_POLICY = POLICY.replace("style-src 'self'", "style-src 'self' 'unsafe-inline'").replace(
    "img-src 'self'", "img-src 'self' data: blob:"
)  # plotly writes styles and makes pictures in the browser


class Server(LocalPage):
    """The page while it is open."""

    def __init__(self, bench: Bench, port: int = 0, *, framed: bool = False, token: str = "") -> None:
        self.bench = bench
        script = Answer("text/javascript; charset=utf-8", plotly(), KEPT)  # fails here where it is missing
        files = page_files(Path(__file__).parent / "page") | {PLOTLY: script}
        headers = {"Content-Security-Policy": PLOTLYS_POLICY}
        super().__init__(files, port=port, headers=headers, framed=framed, token=token)

    def __exit__(self, *fault: object) -> None:
        self.bench.end()
        super().__exit__(*fault)

    def get(self, name: str, asked: Mapping[str, str]) -> Answer | dict[str, Any] | None:
        if name == REPORT and self.bench.shown.saved:
            return Answer("text/html; charset=utf-8", Path(self.bench.shown.saved).read_bytes(), REPORTS)
        return ANSWERS[name](self.bench, asked) if name in ANSWERS else None

    def post(self, name: str, content: dict[str, Any]) -> dict[str, Any] | None:
        if name != "act":
            return None
        action, value, version = content["action"], content.get("value", ""), content["version"]
        if not (isinstance(action, str) and isinstance(value, str)) or type(version) is not int:
            raise ValueError("an action has a name, a value and a version")
        self.bench.act(action, value, version=version)
        return {}


@cache
def plotly() -> bytes:
    """Return plotly's script from the installed package. Raises InputError where it is missing."""
    offline = library("plotly.offline", extra="workbench", where="workbench")
    return str(offline.get_plotlyjs()).encode()
