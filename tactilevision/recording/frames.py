"""The pictures of a recording, one after another or by number; never more than a few of them in memory."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from pathlib import Path

import numpy as np

from tactilevision.errors import InputError, RecordingError
from tactilevision.recording.images import TornImageError, read_image
from tactilevision.recording.model import BadFrame, Recording
from tactilevision.recording.need import require
from tactilevision.recording.pictures import check_size
from tactilevision.recording.video import iter_video
from tactilevision.records import Bytes, Frame

_AHEAD = 4  # frames read ahead of their use


def iter_frames(
    recording: Recording, start_s: float = -math.inf, *, end_s: float = math.inf
) -> Iterator[Frame | BadFrame]:
    """Stream the frames with start_s <= time <= end_s, in order, as they are on disk (not rectified).

    A frame of unknown time is part of every stream. A picture that is absent or torn comes as a BadFrame. Raises
    RecordingError where the recording has no frames, where a picture is of another kind (grey, floating
    point beyond its range), or of another size than the ones before.
    """
    require(recording, "frames", step="reading frames")
    times = recording.frame_times_s
    wanted = np.flatnonzero(~((times < start_s) | (times > end_s))).tolist()
    return _checked(recording, _frames(recording, wanted))


def read_frame(recording: Recording, index: int) -> Frame:
    """Read one frame by its place in `recording.frame_names`; negative ones count from the end.

    Raises RecordingError where the picture is absent or torn, InputError where there is no such frame.
    """
    require(recording, "frames", step="reading frames")
    count = len(recording.frame_names)
    if not -count <= index < count:
        raise InputError(f"the recording has {count} frames", where=recording.path, value=index)
    frame = next(_checked(recording, _frames(recording, [index % count])))
    if isinstance(frame, BadFrame):
        raise RecordingError(frame.why, where=f"{recording.frames_path}, frame {frame.name}")
    return frame


def read_flats(recording: Recording) -> list[Bytes]:
    """The raw pictures (H, W, 3), grey levels, of the untouched gel: those of their own, or frames taken for one.

    Raises RecordingError for one that cannot be read.
    """
    if recording.flats:
        return [read_reference(recording, path) for path in recording.flats]
    return [read_frame(recording, number).rgb for number in recording.flat_frames]


def read_reference(recording: Recording, path: Path) -> Bytes:
    """The raw picture (H, W, 3), grey levels, of the untouched gel or a ball press at `path`.

    Raises RecordingError where it cannot be read, or has another size than the frames.
    """
    rgb = read_image(path, white_level=recording.white_level)
    if recording.frame_size_px is not None:
        check_size((rgb.shape[1], rgb.shape[0]), recording.frame_size_px, path)
    return rgb


def _frames(recording: Recording, wanted: list[int]) -> Iterator[Frame | BadFrame]:
    folder = recording.frames_path
    if folder is not None and folder.is_dir():
        return _read_ahead(recording, wanted)
    return _from_video(recording, wanted)


def _from_video(recording: Recording, wanted: list[int]) -> Iterator[Frame | BadFrame]:
    assert recording.frames_path is not None
    indices = [int(recording.frame_names[row]) for row in wanted]
    for row, (_, rgb) in zip(wanted, iter_video(recording.frames_path, indices), strict=True):
        name, time_s = recording.frame_names[row], float(recording.frame_times_s[row])
        if rgb is None:
            yield BadFrame(name, time_s, "the video ends before this frame, or is damaged there")
        else:
            yield Frame(rgb, time_s, name)


def _read_ahead(recording: Recording, wanted: Iterable[int]) -> Iterator[Frame | BadFrame]:
    """Decode a few pictures ahead in a second thread, while the caller works on the one before."""
    rows = iter(wanted)
    with ThreadPoolExecutor(1, thread_name_prefix="frames") as reader:
        pending: deque[Future[Frame | BadFrame]] = deque(
            reader.submit(_from_file, recording, row) for row in islice(rows, _AHEAD)
        )
        while pending:
            ready = pending.popleft().result()
            pending.extend(reader.submit(_from_file, recording, row) for row in islice(rows, 1))
            yield ready


def _from_file(recording: Recording, row: int) -> Frame | BadFrame:
    assert recording.frames_path is not None
    name, time_s = recording.frame_names[row], float(recording.frame_times_s[row])
    path = recording.frames_path / name
    try:
        rgb: Bytes = read_image(path, white_level=recording.white_level)
    except TornImageError as fault:
        return BadFrame(name, time_s, fault.what)
    return Frame(rgb, time_s, name)


def _checked(recording: Recording, frames: Iterator[Frame | BadFrame]) -> Iterator[Frame | BadFrame]:
    expected = recording.frame_size_px
    for frame in frames:
        if isinstance(frame, Frame):
            size = (frame.rgb.shape[1], frame.rgb.shape[0])
            expected = expected or size
            if size != expected:
                raise RecordingError(
                    f"the pictures are of two sizes: {frame.name} is {size[0]} x {size[1]}, "
                    f"those before {expected[0]} x {expected[1]}",
                    where=recording.frames_path or recording.path,
                    remedy="One recording is one camera with one setting: put the others into another folder.",
                )
        yield frame
