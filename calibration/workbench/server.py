"""The server of the workbench's page: its files, its requests by name, and its actions.

It imports no model: until `show` the page has the presses and frames as they were recorded.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from calibration.workbench.recorded import Frames, title_of, uncertified
from tactilevision.errors import InputError, library
from tactilevision.local_page import POLICY, Answer, LocalPage, page_files
from tactilevision.recording.model import Recording
from tactilevision.records.measured import Bytes

if TYPE_CHECKING:
    from calibration.workbench.bench import Bench

PATIENCE_S = 10  # s that a request for news waits
BROWSER_S = 2.0  # s that the work waits for a browser to open the page
QUALITY = 85  # of a JPEG for display
AS_RECORDED = -1  # version of the state before there is a bench, which counts from 1
PLOTLY = "plotly.js"
REPORT = "report.html"  # as it was exported
REPORTS = {"Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:"}
KEPT = {"Cache-Control": "private, max-age=86400"}  # for plotly, which is large
PLOTLYS_POLICY = POLICY.replace("style-src 'self'", "style-src 'self' 'unsafe-inline'").replace(
    "img-src 'self'", "img-src 'self' data: blob:"
)  # plotly writes styles and makes pictures in the browser

Asked = Mapping[str, str]
Answers = Mapping[str, Callable[[Asked], Answer | dict[str, Any]]]


class Server(LocalPage):
    """The page while it is open; `frames` of the recordings that have pictures."""

    def __init__(
        self,
        recordings: Sequence[Recording],
        frames: Sequence[Frames | None],
        *,
        port: int = 0,
        framed: bool = False,
        token: str = "",
    ) -> None:
        self._recordings, self._frames = recordings, frames
        self._bench: Bench | None = None
        self._answers: Answers = {"state": self._as_recorded, **_pictures(lambda: self._frames)}
        self._turn, self._seen = threading.Condition(), threading.Event()
        script = Answer("text/javascript; charset=utf-8", plotly(), KEPT)
        files = page_files(Path(__file__).parent / "page") | {PLOTLY: script}
        headers = {"Content-Security-Policy": PLOTLYS_POLICY}
        super().__init__(files, port=port, headers=headers, framed=framed, token=token)

    def __exit__(self, *fault: object) -> None:
        if self._bench is not None:
            self._bench.end()
        super().__exit__(*fault)

    def wait_for_page(self) -> None:
        """Wait until a browser has asked for the presses, which else wait for imports; at most BROWSER_S."""
        self._seen.wait(BROWSER_S)

    def show(self, bench: Bench) -> None:
        """Show this bench from now on."""
        answers = _of_bench(bench)
        with self._turn:
            self._bench, self._answers = bench, answers
            self._turn.notify_all()

    def get(self, name: str, asked: Asked) -> Answer | dict[str, Any] | None:
        if name == REPORT and self._bench is not None and self._bench.shown.saved:
            return Answer("text/html; charset=utf-8", Path(self._bench.shown.saved).read_bytes(), REPORTS)
        return self._answers[name](asked) if name in self._answers else None

    def post(self, name: str, content: dict[str, Any]) -> dict[str, Any] | None:
        if name != "act":
            return None
        action, value, version = content["action"], content.get("value", ""), content["version"]
        if not (isinstance(action, str) and isinstance(value, str)) or type(version) is not int:
            raise ValueError("an action has a name, a value and a version")
        if self._bench is None:
            raise InputError("the workbench is still starting", where="workbench", value=action)
        self._bench.act(action, value, version=version)
        return {}

    def _as_recorded(self, asked: Asked) -> Answer | dict[str, Any]:
        """Return the presses as recorded; a page that has them waits for the bench."""
        if int(asked.get("since", "0")) == AS_RECORDED:
            with self._turn:
                self._turn.wait_for(lambda: self._bench is not None, PATIENCE_S)
        if self._bench is not None:
            return self._answers["state"](asked)
        self._seen.set()
        presses = list(uncertified(self._recordings, "being certified"))
        return {"version": AS_RECORDED, "title": title_of(self._recordings), "presses": presses}


def _of_bench(bench: Bench) -> Answers:
    """Return the answers to the page of a bench."""
    from calibration.workbench.curve_views import certificate_view, curve_view, tried_view
    from calibration.workbench.views import state_view

    pictures = _pictures(lambda: bench.opened.frames)

    def state(asked: Asked) -> dict[str, Any]:
        bench.wait(int(asked.get("since", "0")), PATIENCE_S)
        return state_view(bench)

    def frames(asked: Asked) -> Answer | dict[str, Any]:
        found = pictures["frames"](asked)
        certified = certificate_view(bench.shown, int(asked["recording"]), asked["press"])
        return found | certified if isinstance(found, dict) and found["frames"] else found

    return {
        **pictures,
        "state": state,
        "frames": frames,
        "curves": lambda _asked: curve_view(bench.shown),
        "tried": lambda asked: tried_view(bench.shown, asked["name"], float(asked["value"])),
    }


def _pictures(every: Callable[[], Sequence[Frames | None]]) -> Answers:
    """Return the answers on frames of the recordings; `every` gives them as they are at the time."""

    def frames(asked: Asked) -> dict[str, Any]:
        found = _frames_of(every(), asked)
        return {"frames": [], "times": []} if found is None else found.view(asked["press"])

    def of_recording(asked: Asked) -> Frames:
        found = _frames_of(every(), asked)
        if found is None:
            raise InputError("this recording has no frames", where="workbench")
        return found

    return {
        "frames": frames,
        "picture": lambda asked: _jpeg(of_recording(asked).picture(int(asked["number"]))),
        "small": lambda asked: _jpeg(of_recording(asked).small(int(asked["number"]))),
        "height": lambda asked: _height(of_recording(asked), int(asked["number"])),
    }


def _frames_of(every: Sequence[Frames | None], asked: Asked) -> Frames | None:
    number = int(asked["recording"])
    if not 0 <= number < len(every):
        raise InputError("there is no such recording", where="workbench", value=number)
    return every[number]


def _jpeg(rgb: Bytes) -> Answer:
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    return Answer("image/jpeg", cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())


def _height(frames: Frames, number: int) -> Answer:
    """Return the height map row by row as 4-byte floats, mm; NaN where not valid."""
    height = frames.see(number).height
    depth = np.where(height.valid, height.depth_mm, np.nan).astype("<f4")
    rows, columns = depth.shape
    about = {"X-Rows": str(rows), "X-Columns": str(columns), "X-Mm-Per-Px": f"{height.mm_per_px[0]:.6g}"}
    return Answer("application/octet-stream", depth.tobytes(), about)


def plotly() -> bytes:
    """Return plotly's script from the installed package. Raises InputError where it is missing."""
    package = Path(library("plotly", extra="workbench", where="workbench").__file__).parent
    return (package / "package_data" / "plotly.min.js").read_bytes()
