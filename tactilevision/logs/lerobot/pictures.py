"""The pictures of a camera in the order of the frames; each is checked to be the one that its row means.

Rows count frames at a constant rate, and a video is matched to them by time. So a frame that is missing, or a
video of another or variable rate, would shift all that follows: it is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tactilevision.door.limits import check
from tactilevision.door.pictures import check_picture
from tactilevision.errors import InputError
from tactilevision.logs.lerobot.dataset import DataSet, Episode, Place
from tactilevision.logs.lerobot.tables import parts, told
from tactilevision.logs.library import library
from tactilevision.records import Bytes

MAX_OFF = 0.1  # of the time between two frames: a picture further from its row's time is another one
_INDEX = ("episode_index", "frame_index", "timestamp")


@dataclass(frozen=True, slots=True)
class Row:
    """One frame of the tables; `packed` holds its picture where the camera's are kept there."""

    episode: Episode
    frame: int
    time_s: float
    packed: bytes | None = None


def rows(dataset: DataSet) -> Iterator[Row]:
    """All frames in order. Raises InputError where one is missing, or not at the data set's rate."""
    episodes = iter(dataset.episodes)
    episode, due = next(episodes), 0
    for path, number, frame, time_s, packed in _cells(dataset):
        if due == episode.length:
            episode, due = next(episodes, episode), 0
        if (number, frame) != (episode.number, due):
            raise InputError(
                "frames are missing or out of order",
                where=path,
                value=f"frame {frame} of episode {number}, where frame {due} of episode {episode.number} is due",
                remedy="Download it again, or record the episode anew.",
            )
        if not abs(time_s - frame / dataset.rate_Hz) < MAX_OFF / dataset.rate_Hz:
            raise InputError(
                f"a frame is not at the stated rate of {dataset.rate_Hz:g} a second",
                where=f"{path}, episode {number}, frame {frame}",
                value=f"{time_s:.4f} s",
            )
        yield Row(episode, frame, time_s, packed)
        due += 1
    if due < episode.length or next(episodes, None) is not None:
        raise InputError(
            "the tables end before the last episode does", where=dataset.root, value=f"episode {episode.number}"
        )


def pictures(dataset: DataSet) -> Iterator[tuple[Row, Bytes]]:
    """Each frame with its picture (H, W, 3) uint8 grey levels, red first. Raises InputError as `rows` does."""
    if dataset.is_video:
        yield from _from_videos(dataset)
        return
    for row in rows(dataset):
        yield row, _unpacked(row, f"{dataset.root}, {dataset.camera}")


def _cells(dataset: DataSet) -> Iterator[tuple[Path, int, int, float, bytes | None]]:
    columns = [*_INDEX] if dataset.is_video else [*_INDEX, dataset.camera]
    for place in dict.fromkeys(one.data for one in dataset.episodes):
        path = dataset.data(place)
        for batch in parts(path, columns):
            index = [batch.column(name).to_pylist() for name in _INDEX]
            packed: list[Any] = [None] * batch.num_rows
            if not dataset.is_video:
                packed = [(one or {}).get("bytes") for one in batch.column(dataset.camera).to_pylist()]
            for number, frame, time_s, data in zip(*index, packed, strict=True):
                yield path, number, frame, float(time_s), data


def _from_videos(dataset: DataSet) -> Iterator[tuple[Row, Bytes]]:
    place: Place | None = None
    shown: Iterator[tuple[float, Bytes]] = iter(())
    for row in rows(dataset):
        due_s, off_s = row.episode.from_s + row.time_s, MAX_OFF / dataset.rate_Hz
        if row.episode.video != place:
            place = row.episode.video
            shown = _decoded(dataset.video(place))
        found = next((one for one in shown if row.frame or one[0] > due_s - off_s), None)
        where = f"{dataset.video(place)}, episode {row.episode.number}, frame {row.frame}"
        if found is None:
            raise InputError("the video ends before its frames do", where=where, remedy="Download it again.")
        at_s, rgb = found
        if abs(at_s - due_s) > off_s:
            raise InputError(
                f"the video is not at the constant rate of {dataset.rate_Hz:g} a second",
                where=where,
                value=f"{at_s:.4f} s, not {due_s:.4f} s",
                remedy="Encode it anew at that rate, or record with single pictures.",
            )
        yield row, rgb


def _decoded(path: Path) -> Iterator[tuple[float, Bytes]]:
    """Times, s, and pictures of a video."""
    with told(path), library("av").open(str(path), format="mp4") as box:
        if not box.streams.video:
            raise InputError("the file holds no video", where=path)
        stream = box.streams.video[0]
        for frame in box.decode(stream):
            check(frame.width * frame.height, "MAX_PIXELS", what="a picture's pixels", where=path)
            if frame.time is None:
                raise InputError("a picture of the video has no time", where=path)
            yield float(frame.time), frame.to_ndarray(format="rgb24")


def _unpacked(row: Row, where: str) -> Bytes:
    place = f"{where}, episode {row.episode.number}, frame {row.frame}"
    if not row.packed:
        raise InputError("a picture is not in its table", where=place, remedy="Store pictures within the tables.")
    check_picture(row.packed, where=place)
    bgr = cv2.imdecode(np.frombuffer(row.packed, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise InputError("a picture is damaged", where=place, remedy="Download it again.")
    return np.ascontiguousarray(bgr[..., ::-1])
