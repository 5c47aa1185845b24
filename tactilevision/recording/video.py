"""Frames of one video file, by their index, exactly.

Seeking in a video is not trusted: where the frame rate varies, it lands beside the frame that was asked for.
So frames are counted from the start of the file; a reader that has stopped half-way is parked, and the next one
that starts behind it goes on from there. Windows that follow each other thus cost one pass in all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.door.limits import check
from tactilevision.door.opening import check_regular
from tactilevision.errors import RecordingError
from tactilevision.recording.images import check_coloured
from tactilevision.records import Bytes

_Key = tuple[Path, int, int]
_parked: dict[_Key, tuple[cv2.VideoCapture, int]] = {}  # one at most
_lock = Lock()


def iter_video(path: Path, indices: Sequence[int]) -> Iterator[tuple[int, Bytes | None]]:
    """Yield (index, rgb) for rising `indices`; rgb is None where the video ends before, or cannot be decoded."""
    key = _key(path)
    capture, position = _take(key, indices[0] if indices else 0)
    going = True
    try:
        for index in indices:
            while going and position <= index:
                going = capture.grab()
                position += 1
            picture = capture.retrieve()[1] if going else None
            yield index, None if picture is None else _rgb(np.asarray(picture), path)
    finally:
        if going:
            with _lock:
                _parked.clear()
                _parked[key] = (capture, position)


def count_frames(path: Path) -> int:
    """Count the frames by passing over all of them: what a container says of itself is an estimate."""
    capture, count = _open(path), 0
    while capture.grab():
        count += 1
    return count


def stated_frames(path: Path) -> int:
    """The number of frames as the container has it: often exact, at times an estimate, 0 if unsaid."""
    return max(int(_open(path).get(cv2.CAP_PROP_FRAME_COUNT)), 0)


def _key(path: Path) -> _Key:
    """The file as it is now: one that was written anew is another video."""
    about = path.stat()
    return path, about.st_mtime_ns, about.st_size


def _take(key: _Key, first: int) -> tuple[cv2.VideoCapture, int]:
    with _lock:
        parked = _parked.pop(key, None)
    if parked is not None and parked[1] <= first:
        return parked
    return _open(key[0]), 0


def _open(path: Path) -> cv2.VideoCapture:
    check_regular(path)
    capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise RecordingError(
            "the video cannot be opened",
            where=path,
            remedy="FFV1 in .mkv or .avi is read everywhere and loses nothing.",
        )
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # as the sensor has it, whatever way a phone was held
    pixels = capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
    check(pixels, "MAX_PIXELS", what="the pixels of its pictures", where=path)
    return capture


def _rgb(picture: npt.NDArray[Any], path: Path) -> Bytes:
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
        raise RecordingError(
            "the video has no colours of 8 bits", where=path, value=f"{picture.shape} {picture.dtype}"
        )
    return check_coloured(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8), path)
