"""What the page can ask for, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np

from calibration.workbench.bench import Bench
from calibration.workbench.curve_view import curve_view, tried_view
from calibration.workbench.frames import Frames
from calibration.workbench.state_view import state_view
from tactilevision.errors import InputError
from tactilevision.local_page import Answer
from tactilevision.records import Bytes

PATIENCE_S = 10.0  # s that a question for news waits for some: so long a closed tab is not missed
QUALITY = 85  # of a JPEG that is looked at; nothing is measured on it


def _state(bench: Bench, asked: Mapping[str, str]) -> dict[str, Any]:
    """What stands, once it is other than the version that the page knows."""
    bench.wait(int(asked.get("since", "0")), PATIENCE_S, tab=asked.get("tab", "")[:40])
    return state_view(bench)


def _curves(bench: Bench, _asked: Mapping[str, str]) -> dict[str, Any]:
    return curve_view(bench.shown)


def _tried(bench: Bench, asked: Mapping[str, str]) -> dict[str, Any]:
    return tried_view(bench.shown, asked["name"], float(asked["value"]))


def _frames(bench: Bench, asked: Mapping[str, str]) -> dict[str, Any]:
    """The frames of a press, and what its certificate says of them."""
    frames = _frames_of(bench, asked)
    return {"frames": [], "times": []} if frames is None else frames.view(asked["press"])


def _picture(bench: Bench, asked: Mapping[str, str]) -> Answer:
    return _jpeg(_of_recording(bench, asked).see(int(asked["number"])).rgb)


def _small(bench: Bench, asked: Mapping[str, str]) -> Answer:
    return _jpeg(_of_recording(bench, asked).small(int(asked["number"])))


def _jpeg(rgb: Bytes) -> Answer:
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    return Answer("image/jpeg", cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())


def _height(bench: Bench, asked: Mapping[str, str]) -> Answer:
    """The height map row by row as 4-byte numbers, mm; NaN where nothing is known."""
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
    "curves": _curves,
    "tried": _tried,
    "frames": _frames,
    "picture": _picture,
    "small": _small,
    "height": _height,
}
