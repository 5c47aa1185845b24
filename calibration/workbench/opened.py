"""Measurements, frames and available effects of an open workbench."""

from __future__ import annotations

import re
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.effects import effects_for, get_effect
from calibration.effects.private import load_effect
from calibration.inputs.observations import Measured, Observations
from calibration.model.stages import Effect
from tactilevision.errors import InputError
from tactilevision.files.opening import real_path
from tactilevision.files.writing import remove, write_text
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.press.certificate import Evidence
from tactilevision.recording.layout import some
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.constants import NU_SILICONE
from tactilevision.records.maps import Frame, HeightMap
from tactilevision.records.measured import Bytes, Estimate, Floats, Pair
from tactilevision.sensors.rectification import rectify

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


Marks = Mapping[str, tuple[int, int]]
OWN = "own_effects"  # folder of the effects that were written in the page
KEY = re.compile(r"""^\s+key = ["'](\w{1,60})["']""", re.MULTILINE)  # of an effect, in its text
NO_FILE = (0, 0)  # mark of a folder, and of what was not there: new folders do not count


@dataclass(frozen=True, slots=True)
class Opened:
    """Recordings as `compare` reads them.

    `observed`: all accepted presses, None until they are certified; `bulge` and `bound`: knowledge of nu;
    `private`: the user's effects, with their `files` by key; `frames` of recordings with pictures; `marks` of the
    files when they were read; `listed`: the effects to test besides the private ones, None: the catalogue's.
    """

    paths: tuple[Path, ...]
    measured: tuple[Measured, ...]
    observed: Observations | None = None
    bulge: Estimate | None = None
    bound: Pair | None = NU_SILICONE
    private: tuple[Effect, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    frames: tuple[Frames | None, ...] = ()
    warnings: tuple[str, ...] = ()
    marks: Marks = field(default_factory=dict)
    listed: tuple[Effect, ...] | None = None

    @property
    def data(self) -> Observations:
        """All accepted presses. Raises InputError before they are certified."""
        if self.observed is None:
            raise InputError("the presses are not certified", where="workbench")
        return self.observed

    @property
    def title(self) -> str:
        """Names of the recordings."""
        return ", ".join(one.recording.name for one in self.measured)

    @property
    def catalogue(self) -> list[Effect]:
        """Effects to test: the listed and the private ones."""
        return [*(effects_for(self.data) if self.listed is None else self.listed), *self.private]

    def effect(self, key: str) -> Effect:
        """Return an effect by its key. Raises InputError for an unknown one."""
        own = next((one for one in self.private if one.key == key), None)
        return get_effect(key) if own is None else own

    def kind(self, key: str) -> str:
        """Return the kind of an effect in words."""
        if any(one.key == key for one in self.private):
            return "your own"
        return "effect"


def with_own(opened: Opened, text: str, folder: Path) -> tuple[Opened, str]:
    """Return the recordings with the private effect of this text, which is written into `folder`, and its key.

    It runs as the effect of a named file does. Raises InputError for a text without a key, and as `load_effect`;
    the file is then as it was before.
    """
    found = KEY.search(text)
    if found is None:
        remedy = 'Write a line like key = "my_effect" in its class.'
        raise InputError("the effect has no key", where="your effect", remedy=remedy)
    key, file = found[1], folder / OWN / f"{found[1]}.py"
    before = file.read_text(encoding="utf-8") if file.is_file() else None
    write_text(file, text)
    try:
        effect = load_effect(file)
    except InputError:
        if before is None:
            remove(file)
        else:
            write_text(file, before)
        raise
    kept = tuple(one for one in opened.private if one.key != effect.key)
    files = {**opened.files, effect.key: str(real_path(file))}
    return replace(opened, private=(*kept, effect), files=files), key


def file_marks(paths: Sequence[Path]) -> Marks:
    """Return size and time of change of each top-level file of the recordings, by name; zeros for a folder."""
    found = {}
    for path in paths:
        with suppress(OSError):  # deleted meanwhile
            for file in path.iterdir() if path.is_dir() else [path]:
                about = file.stat()
                found[str(file)] = (about.st_size, about.st_mtime_ns) if file.is_file() else NO_FILE
    return found


def what_changed(opened: Opened) -> str:
    """Return a sentence on changes of the files since they were read; empty where there are none."""
    before, now = opened.marks, file_marks(opened.paths) if opened.marks else {}
    gone = sorted(before.keys() - now.keys())
    other = sorted(name for name, mark in now.items() if mark != before.get(name, NO_FILE))
    said = [f"{_few(names)} {words}" for names, words in ((gone, "gone"), (other, "changed or new")) if names]
    keeps = "the page keeps what it read; restart the workbench with --state to read again"
    return f"{' and '.join(said)} since the recording was read: {keeps}" if said else ""


def _few(names: Sequence[str]) -> str:
    """Return the files by name, the first few of many."""
    return f"{some([Path(name).name for name in names])} {'is' if len(names) == 1 else 'are'}"
