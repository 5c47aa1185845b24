"""Frames of a recording for a page: the picture and the height map of one frame, made when they are asked for."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np

from tactilevision.errors import InputError
from tactilevision.reconstruct import Reconstructor
from tactilevision.recording import Recording, read_frame
from tactilevision.records import Bytes, HeightMap

KEPT = 64  # height maps held: a scrub back and forth over a press costs nothing


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame (H, W, 3), grey levels, and its height map."""

    rgb: Bytes
    height: HeightMap


@dataclass(slots=True)
class Frames:
    """The frames of one recording; one is turned into heights at a time."""

    recording: Recording
    reconstructor: Reconstructor
    _kept: OrderedDict[int, Seen] = field(default_factory=OrderedDict)
    _turn: threading.Lock = field(default_factory=threading.Lock)

    def of_press(self, press: str) -> list[int]:
        """Numbers of the frames taken during a press; none where the press has no times."""
        row = next((one for one in self.recording.presses if one.press == press), None)
        if row is None:
            return []
        times = self.recording.frame_times_s
        return [int(k) for k in np.flatnonzero((times >= row.start_s) & (times <= row.end_s))]

    def see(self, number: int) -> Seen:
        """One frame. Raises InputError for a number that is not there, or a picture that cannot be read."""
        if not 0 <= number < len(self.recording.frame_names):
            raise InputError("there is no such frame", where=self.recording.name, value=number)
        with self._turn:
            if number not in self._kept:
                frame = read_frame(self.recording, number)
                self._kept[number] = Seen(
                    self.reconstructor.rectified(frame), self.reconstructor.height_map(frame)
                )
                if len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(number)
            return self._kept[number]
