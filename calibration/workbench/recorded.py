"""Recordings as the page shows them at once: presses, frames, and whether a file has changed.

This file imports no model, which takes longer than to read a recording.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.maps import Frame, HeightMap
from tactilevision.records.measured import Bytes, Floats
from tactilevision.sensors.rectification import rectify

if TYPE_CHECKING:
    from tactilevision.heightmap.reconstructor import Reconstructor
    from tactilevision.press.certificate import Evidence

READINGS = 400  # of the force, at most, plotted of one press
SMALL_PX = 240  # width of the pictures while the slider moves
KEPT = 64  # cached height maps


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame (H, W, 3), grey levels, and its height map."""

    rgb: Bytes
    height: HeightMap


@dataclass(slots=True, eq=False)
class Frames:
    """Frames of one recording with height maps on request; `evidence` of its certificate by press.

    Without a reconstructor, until the light is calibrated, there are no height maps.
    """

    recording: Recording
    reconstructor: Reconstructor | None = None
    evidence: Mapping[str, Evidence] = field(default_factory=dict)
    _turn: threading.Lock = field(default_factory=threading.Lock)

    def of_press(self, press: str) -> list[int]:
        """Return the numbers of the frames during a press; none where the press has no times."""
        row = next((one for one in self.recording.presses if one.press == press), None)
        if row is None:
            return []
        times = self.recording.frame_times_s
        return [int(k) for k in np.flatnonzero((times >= row.start_s) & (times <= row.end_s))]

    def view(self, press: str) -> dict[str, Any]:
        """Return the frames of a press, their times in s from the first, and the certificate's data."""
        numbers = self.of_press(press)
        times = self.recording.frame_times_s[numbers]
        first = float(times[0]) if numbers else 0.0
        heights = self.reconstructor is not None
        found = {"frames": numbers, "times": (times - first).tolist(), "heights": heights}
        evidence = self.evidence.get(press)
        return found if evidence is None or not numbers else found | _certified(evidence, times, first)

    def small(self, number: int) -> Bytes:
        """Return a small frame (h, w, 3), grey levels, without heights. Raises InputError as `see` does."""
        rgb = self.picture(number)
        size = (SMALL_PX, max(round(SMALL_PX * rgb.shape[0] / rgb.shape[1]), 1))
        return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)

    def picture(self, number: int) -> Bytes:
        """Return a frame (H, W, 3), rectified, grey levels. Raises InputError as `see` does."""
        frame = self._read(number)
        if self.reconstructor is None:
            return rectify(self.recording.sensor, frame.rgb)
        return self.reconstructor.rectified(frame)

    def _read(self, number: int) -> Frame:
        if not 0 <= number < len(self.recording.frame_names):
            raise InputError("there is no such frame", where=self.recording.name, value=number)
        return read_frame(self.recording, number)

    def see(self, number: int) -> Seen:
        """Return one frame with its height map. Raises InputError for an unknown number or unreadable picture."""
        with self._turn:
            return self._seen(number)

    @lru_cache(maxsize=KEPT)  # noqa: B019 - the frames live as long as the page
    def _seen(self, number: int) -> Seen:
        if self.reconstructor is None:
            raise InputError("the light is still being calibrated", where=self.recording.name)
        frame = self._read(number)
        return Seen(self.reconstructor.rectified(frame), self.reconstructor.height_map(frame))


def _certified(evidence: Evidence, times: Floats, first_s: float) -> dict[str, Any]:
    """Return the certificate's data of a press: times in s after `first_s`; `event` indexes the frames' times."""
    every = slice(None, None, evidence.force_time_s.size // READINGS + 1)
    touch, depth = evidence.touch, evidence.depth_mm[np.isfinite(evidence.depth_mm)]
    return {
        "event": None if touch is None else int(np.argmin(np.abs(times - touch.time_s))),
        "event_s": None if touch is None else touch.time_s - first_s,
        "force_s": (evidence.force_time_s[every] - first_s).tolist(),
        "force_N": evidence.force_N[every, 2].tolist(),
        "depth_s": (evidence.time_s - first_s).tolist(),
        "depth_mm": evidence.depth_mm.tolist(),
        "deepest_mm": float(depth.max()) if depth.size else None,
        **_places(evidence),
    }


def _places(evidence: Evidence) -> dict[str, list[float]]:
    """Return face (x, y, half width, half height) and bevel (x, y, width, height) as shares of the picture."""
    height, face, bevel = evidence.height_map, evidence.footprint, evidence.bevel_window_mm
    if height is None or face is None:
        return {}
    rows, columns = height.depth_mm.shape
    size = np.array([columns, rows]) * height.mm_per_px
    found = {"face": [*(np.array(face.centre_mm) / size + 0.5), *(face.radius_mm / size)]}
    if bevel is not None:
        found["bevel"] = [*(np.array(bevel[0]) / size + 0.5), *((np.array(bevel[1]) - bevel[0]) / size)]
    return {name: [float(one) for one in place] for name, place in found.items()}


def title_of(recordings: Sequence[Recording]) -> str:
    """Return the names of the recordings."""
    return ", ".join(one.name for one in recordings)


def uncertified(recordings: Sequence[Recording], why: str) -> Iterator[dict[str, Any]]:
    """Yield the presses as recorded; their names are those that they have once they are certified."""
    several = len(recordings) > 1
    for number, recording in enumerate(recordings):
        for press in recording.presses:
            name = f"{recording.name}/{press.press}" if several else press.press
            of = {"name": name, "label": press.press, "recording": number, "indenter": press.indenter}
            yield {**of, "state": why, "odd": False, "rms": []}


Marks = Mapping[str, tuple[int, int]]
NO_FILE = (0, 0)  # mark of a folder, and of what was not there: new folders do not count


def file_marks(paths: Sequence[Path]) -> Marks:
    """Return size and time of change of each top-level file of the recordings, by name; zeros for a folder."""
    found = {}
    for path in paths:
        with suppress(OSError):  # deleted meanwhile
            for file in path.iterdir() if path.is_dir() else [path]:
                about = file.stat()
                found[str(file)] = (about.st_size, about.st_mtime_ns) if file.is_file() else NO_FILE
    return found
