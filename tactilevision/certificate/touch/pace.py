"""How much deeper a face went in some frames, where its wall is read now one way, now another."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactilevision.certificate.force.phases import Phases
from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.records import Floats

_MAX_PACE = 3.0  # times the ramp's median pace, that a face moves at between two frames
_BOTH_WAYS = 4  # frames, at least, within which a wall that is read two ways is read either way
_BOTH_WAYS_S = 0.25  # s, likewise: most of a hold of half a second is left
_MOVING = 0.2  # of the pace of all but the fastest tenth of a ramp: slower frames are stops, and tell no pace


def moved_mm(track: PressTrack, after: int, *, until: int, phases: Phases) -> float:
    """The most that the face went deeper from frame `after` to `until`.

    A face moves at its rig's pace: what jumps is a wall that is read now one way, now the other. Both ways grow
    with the face, so the shallower one, of the frames that follow, tells as much. A
    single frame that reads shallower than both its neighbours is no start to count from.
    """
    seconds = np.diff(track.time_s)
    paces = (np.abs(np.diff(of_three(track.depth_mm))) / seconds)[phases.onset : phases.hold]
    paces = paces[np.isfinite(paces)]
    moving = paces[paces > _MOVING * np.quantile(paces, 0.9)] if paces.size else paces
    pace = float(np.median(moving)) if moving.size else np.inf  # no ramp in view tells none
    moved = []
    for depth_mm in (track.depth_mm, of_three(track.depth_mm)):
        with np.errstate(invalid="ignore"):  # where no frame in a row is read
            steps = np.diff(_shallower(depth_mm, float(np.median(seconds))))
        jumps = np.abs(steps) > _MAX_PACE * pace * seconds + 5 * phases.noise
        moves = np.where(jumps | ~np.isfinite(steps), 0.0, steps)[after : until - 1]
        moved.append(float(np.cumsum(moves).max(initial=0.0)))
    return min(moved)


def of_three(depth_mm: Floats) -> Floats:
    """Each depth (T,), mm, and its neighbours' median: one frame may read a wall that those beside it do not."""
    if depth_mm.size < 3:
        return depth_mm
    inner = np.median([depth_mm[:-2], depth_mm[1:-1], depth_mm[2:]], axis=0)
    return np.concatenate([depth_mm[:1], inner, depth_mm[-1:]])


def _shallower(depth_mm: Floats, interval_s: float) -> Floats:
    """The least of each depth (T,), mm, and of those that follow it for _BOTH_WAYS_S."""
    count = max(_BOTH_WAYS, int(np.ceil(_BOTH_WAYS_S / interval_s)))
    padded = np.concatenate([np.nan_to_num(depth_mm, nan=np.inf), np.full(count - 1, np.inf)])
    return np.asarray(sliding_window_view(padded, count).min(axis=1))
