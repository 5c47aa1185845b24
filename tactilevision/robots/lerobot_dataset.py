"""Reader of LeRobot data sets, version 3: metadata, parquet tables and camera pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.child import Answer, Answers
from tactilevision.files.documents import read_json
from tactilevision.files.opening import MB, damage, inside
from tactilevision.recording.images import decode_image
from tactilevision.records.measured import Bytes
from tactilevision.robots.logs import library

# Parquet files and videos: read in a child process.

AGAIN = "Download it again."
ROWS = 64  # of a part: some tens of MB with depth maps of a whole picture
INTEGER = "whole numbers"
NUMBER = "numbers"
_BYTES = {"binary", "large_binary"}  # types of Arrow
PICTURE = "pictures (structs with bytes)"


def place_in(root: Path, name: str) -> Path:
    """Return a file of the data set. Raises InputError where it is missing or outside."""
    path = inside(root, name, where=root)
    if not path.exists():
        raise InputError("the data set lacks a file", where=root, value=name, remedy="Download it whole.")
    return path


def parts(path: Path, columns: Mapping[str, str] | None = None) -> Iterator[Any]:
    """Yield rows in record batches, the first empty; `columns` are names and what each holds, None: all.

    Raises InputError where the file is damaged, and where a column is missing or of another type.
    """
    for (packed,) in Answers(batches, str(path), dict(columns or {}), files=[path]):
        with damage(path, remedy=AGAIN), library("pyarrow").ipc.open_stream(packed) as stream:
            batch = stream.read_next_batch()
            batch.validate(full=True)
        yield batch


def batches(path: str, columns: Mapping[str, str]) -> Iterator[Answer]:
    """Yield, in a child process, rows as streams of Arrow; a part without rows is the first. No column: all."""
    arrow = library("pyarrow")
    with library("pyarrow.parquet").ParquetFile(path, buffer_size=MB) as file:
        schema = file.schema_arrow.remove_metadata()
        for name, kind in columns.items():
            if schema.get_field_index(name) < 0:
                raise InputError("a column is missing, or occurs twice", where=path, value=name)
            found = schema.field(name).type
            if not _holds(found, kind):
                raise InputError(f"column {name} does not hold {kind}", where=path, value=str(found)[:80])
        schema = arrow.schema([schema.field(name) for name in columns or range(len(schema))])
        first = [arrow.RecordBatch.from_pylist([], schema)]
        names = list(columns) or None
        for batch in chain(first, file.iter_batches(batch_size=ROWS, columns=names, use_threads=False)):
            empty = [name for name in columns if columns[name] != PICTURE and batch.column(name).null_count]
            if empty:
                raise InputError(f"column {empty[0]} has an empty cell", where=path)
            sink = arrow.BufferOutputStream()
            with arrow.ipc.new_stream(sink, schema) as stream:
                stream.write_batch(batch.select(schema.names))
            yield (np.frombuffer(sink.getvalue(), np.uint8),)


def _holds(kind: Any, wanted: str) -> bool:
    """Return whether a column of this type of Arrow holds what is wanted."""
    types = library("pyarrow.types")
    if wanted == PICTURE:
        return bool(types.is_struct(kind)) and {str(one.type) for one in kind if one.name == "bytes"} <= _BYTES
    return bool(types.is_integer(kind) or (wanted == NUMBER and types.is_floating(kind)))


# Metadata: meta/info.json and meta/episodes.

INFO, STATS, EPISODES = "meta/info.json", "meta/stats.json", "meta/episodes"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"  # LeRobot's own place
VERSION = "v3."
Place = tuple[int, int]  # numbers of chunk and file
EPISODE_BYTES = 16  # of an episode's row at least; its statistics alone take some hundred
MAX_OFF = 0.1  # of the time between two frames, between a picture's time and its row's
_INDEX = {"episode_index": INTEGER, "frame_index": INTEGER, "timestamp": NUMBER}
_NUMBERS = dict.fromkeys(("episode_index", "length", "data/chunk_index", "data/file_index"), INTEGER)
_VIDEO = {"chunk_index": INTEGER, "file_index": INTEGER, "from_timestamp": NUMBER}


@dataclass(frozen=True, slots=True)
class Episode:
    """One episode: its number of frames, its table, its video, and where it begins there, s."""

    number: int
    length: int
    data: Place
    video: Place
    from_s: float


@dataclass(frozen=True, slots=True)
class Row:
    """One frame of the tables; `packed` holds its picture where pictures are stored there."""

    episode: Episode
    frame: int
    time_s: float
    packed: bytes | None = None


@dataclass(frozen=True, slots=True)
class DataSet:
    """A data set on disk with one of its cameras, stored as videos or as single pictures.

    Rows count frames at a constant rate and videos are matched by time, so that missing frames and videos of
    another or variable rate are refused.
    """

    root: Path
    info: Mapping[str, Any]
    camera: str
    is_video: bool
    rate_Hz: float
    episodes: tuple[Episode, ...]

    @property
    def features(self) -> Mapping[str, Any]:
        """Return the features of each frame by key."""
        found: Mapping[str, Any] = self.info["features"]
        return found

    def file(self, name: str) -> Path:
        """Return a file of the data set. Raises as `place_in` does."""
        return place_in(self.root, name)

    def data(self, place: Place) -> Path:
        """Return a table of frames. Raises InputError where it is missing."""
        return self.file(f"data/{_name(place)}.parquet")

    def video(self, place: Place) -> Path:
        """Return a video of the camera. Raises InputError where it is missing."""
        return self.file(f"videos/{self.camera}/{_name(place)}.mp4")

    def rows(self) -> Iterator[Row]:
        """Yield all frames in order. Raises InputError where one is missing, or not at the data set's rate."""
        order = ((episode, frame) for episode in self.episodes for frame in range(episode.length))
        for path, number, frame, time_s, packed in self._cells():
            episode, due = next(order, (self.episodes[-1], self.episodes[-1].length))
            if (number, frame) != (episode.number, due):
                said = f"frame {frame} of episode {number}, where frame {due} of episode {episode.number} is due"
                remedy = "Download it again, or record the episode again."
                raise InputError("frames are missing or out of order", where=path, value=said, remedy=remedy)
            if not abs(time_s - frame / self.rate_Hz) < MAX_OFF / self.rate_Hz:
                raise InputError(
                    f"a frame is not at the stated rate of {self.rate_Hz:g} a second",
                    where=f"{path}, episode {number}, frame {frame}",
                    value=f"{time_s:.4f} s",
                )
            yield Row(episode, frame, time_s, packed)
        if (rest := next(order, None)) is not None:
            said = f"episode {rest[0].number}"
            raise InputError("the tables end before the last episode does", where=self.root, value=said)

    def pictures(self) -> Iterator[tuple[Row, Bytes]]:
        """Yield each frame with its picture (H, W, 3) uint8 grey levels, red first. Raises as `rows` does."""
        if self.is_video:
            yield from self._from_videos()
            return
        for row in self.rows():
            place = f"{self.root}, {self.camera}, episode {row.episode.number}, frame {row.frame}"
            if not row.packed:
                remedy = "Store pictures within the tables."
                raise InputError("a picture is not in its table", where=place, remedy=remedy)
            yield row, decode_image(row.packed, Path(place))

    def _cells(self) -> Iterator[tuple[Path, int, int, float, bytes | None]]:
        columns = _INDEX if self.is_video else _INDEX | {self.camera: PICTURE}
        for place in dict.fromkeys(one.data for one in self.episodes):
            path = self.data(place)
            for batch in parts(path, columns):
                index = [batch.column(name).to_pylist() for name in _INDEX]
                packed: list[Any] = [None] * batch.num_rows
                if not self.is_video:
                    packed = [(one or {}).get("bytes") for one in batch.column(self.camera).to_pylist()]
                for number, frame, time_s, data in zip(*index, packed, strict=True):
                    yield path, number, frame, time_s, data

    def _from_videos(self) -> Iterator[tuple[Row, Bytes]]:
        place: Place | None = None
        shown: Iterator[Answer] = iter(())
        for row in self.rows():
            due_s, off_s = row.episode.from_s + row.time_s, MAX_OFF / self.rate_Hz
            if row.episode.video != place:
                place = row.episode.video
                path = self.video(place)
                shown = Answers(video_frames, str(path), files=[path])
            found = next((one for one in shown if row.frame or one[0] > due_s - off_s), None)
            where = f"{self.video(place)}, episode {row.episode.number}, frame {row.frame}"
            if found is None:
                raise InputError("the video ends before its frames do", where=where, remedy=AGAIN)
            at_s, rgb = found
            if abs(at_s - due_s) > off_s:
                raise InputError(
                    f"the video is not at the constant rate of {self.rate_Hz:g} a second",
                    where=where,
                    value=f"{at_s:.4f} s, not {due_s:.4f} s",
                    remedy="Encode it again at that rate, or record single pictures.",
                )
            yield row, rgb


def read_dataset(root: Path | str, camera: str) -> DataSet:
    """Read the metadata of a data set. `camera` is the key of the tactile camera.

    Raises InputError for another version, a key that is not a camera (with those that are), and missing files.
    """
    root = Path(root)
    if not (root / INFO).is_file():
        raise InputError("is no data set of LeRobot", where=root, value=f"{INFO} is missing")
    info = read_json(place_in(root, INFO))
    version, features, rate = info.get("codebase_version"), info.get("features"), info.get("fps")
    if not str(version).startswith(VERSION):
        raise InputError(
            "the data set is of a version that is not read",
            where=root / INFO,
            value=version,
            remedy="LeRobot converts v2.1 to v3.0: lerobot.datasets.v30.convert_dataset_v21_to_v30.",
        )
    if not isinstance(features, dict) or not isinstance(rate, int | float) or not rate > 0:
        raise InputError("states no features, or no rate (fps)", where=root / INFO, value=rate)
    kinds = {name: str(one.get("dtype")) for name, one in features.items() if _is_seen(one)}
    cameras = {name: kind for name, kind in kinds.items() if kind in ("video", "image")}
    if camera not in cameras:
        listed = ", ".join(f"{name} ({kind})" for name, kind in cameras.items()) or "none"
        raise InputError("the data set has no such camera", where=root, value=camera, remedy=f"It has: {listed}.")
    is_video = cameras[camera] == "video"
    return DataSet(root, info, camera, is_video, float(rate), _episodes(root, camera, is_video))


def _is_seen(feature: Any) -> bool:
    """Return whether a feature may be a camera's: not one that is a map of depth."""
    about = feature.get("info") if isinstance(feature, dict) else None
    return isinstance(feature, dict) and not (isinstance(about, dict) and about.get("is_depth_map"))


def episode_files(root: Path) -> list[str]:
    """Return the names of the tables of episodes in the data set."""
    return [path.relative_to(root).as_posix() for path in sorted((root / EPISODES).glob("*/*.parquet"))]


def _episodes(root: Path, camera: str, is_video: bool) -> tuple[Episode, ...]:
    names = _NUMBERS | {f"videos/{camera}/{part}": kind for part, kind in _VIDEO.items() if is_video}
    found: list[Episode] = []
    size = 0
    for name in episode_files(root):
        size += (path := place_in(root, name)).stat().st_size
        for batch in parts(path, names):
            if len(found) > size / EPISODE_BYTES:
                raise InputError("states more episodes than its size can hold", where=path, value=len(found))
            for row in zip(*(batch.column(key).to_pylist() for key in names), strict=True):
                number, length, chunk, file, *video = row
                at, from_s = ((video[0], video[1]), video[2]) if video else ((0, 0), 0.0)
                found.append(Episode(number, length, (chunk, file), at, from_s))
    found.sort(key=lambda one: one.number)
    missing = next((k for k, one in enumerate(found) if one.number != k), None if found else 0)
    if missing is not None:
        raise InputError("the data set lacks an episode", where=root / EPISODES, value=missing)
    return tuple(found)


def _name(place: Place) -> str:
    return f"chunk-{place[0]:03d}/file-{place[1]:03d}"


def video_frames(path: str) -> Iterator[Answer]:
    """Yield times, s, and pictures (H, W, 3), grey levels, of a video, in a child process."""
    with library("av").open(path, format="mp4", options={"protocol_whitelist": "file"}) as box:
        for frame in box.decode(video=0):
            yield float(frame.time), frame.to_ndarray(format="rgb24")
