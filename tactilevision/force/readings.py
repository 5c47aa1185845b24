"""The F/T sensor's reading at the camera's times, its zero taken where no press is under way."""

from __future__ import annotations

import numpy as np

from tactilevision.recording import Recording
from tactilevision.records import Floats, Press

STUCK = 5  # equal readings at the extreme: a sensor at the end of its range


class Readings:
    """What the force/torque sensor says beside the camera; `clock_offset_s` (F/T minus camera) stands in where the
    recording does not state it."""

    def __init__(self, recording: Recording, clock_offset_s: float | None = None) -> None:
        stated = recording.clock_offset_s
        self.forces, self.offset = recording.forces, (stated if stated is not None else clock_offset_s) or 0.0
        self.presses = recording.presses
        self._zero = None if recording.forces is None else self._free(recording)

    def at(self, time_s: float) -> Floats:
        """Force (3,) at a camera time, NaN outside the readings."""
        if self.forces is None or not np.isfinite(time_s):
            return np.full(3, np.nan)
        now, times = time_s + self.offset, self.forces.time_s
        if len(times) == 0 or not times[0] <= now <= times[-1]:
            return np.full(3, np.nan)
        read = np.array([np.interp(now, times, self.forces.force_N[:, k]) for k in range(3)])
        if self._zero is None:
            return read
        zero = [np.interp(now, self._zero[:, 0], self._zero[:, 1 + k]) for k in range(3)]
        return np.asarray(read - np.array(zero))

    def press_at(self, time_s: float) -> Press | None:
        """The press that is under way."""
        return next((press for press in self.presses if press.start_s <= time_s <= press.end_s), None)

    def clipped(self, press: Press) -> bool:
        """Whether the F/T sensor stood at the end of its range: STUCK and more equal readings at its extreme.

        Noise never repeats the same number so often, and a sensor at rest in the air is not at its extreme.
        """
        if self.forces is None:
            return False
        times, force = self.forces.time_s, self.forces.force_N
        under_way = (times > press.start_s + self.offset) & (times < press.end_s + self.offset)
        ends = np.abs(force).max(axis=0)
        at_end = (np.abs(force[under_way]) == ends) & (ends > 0)
        return bool((at_end.sum(axis=0) >= STUCK).any())

    def _free(self, recording: Recording) -> Floats | None:
        """(G, 4) middle time and median force of every gap between presses; None where presses are not listed."""
        assert recording.forces is not None
        if not recording.presses:
            return None
        times, force = recording.forces.time_s, recording.forces.force_N
        busy = sorted((p.start_s + self.offset, p.end_s + self.offset) for p in recording.presses)
        starts, ends = [-np.inf, *(end for _, end in busy)], [*(start for start, _ in busy), np.inf]
        rows = []
        for start, end in zip(starts, ends, strict=True):
            free = (times > start) & (times < end)
            if free.any():
                rows.append([float(times[free].mean()), *np.median(force[free], axis=0)])
        return np.array(rows) if rows else None
