"""Reader of robot logs (ROS 1 bag, ROS 2 folder or MCAP): topics and messages in bytes."""

from __future__ import annotations

import bz2
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from tactilevision import errors
from tactilevision.errors import InputError
from tactilevision.files.opening import MB, check, check_regular, damage, limit

library = partial(errors.library, extra="logs", where="logs and data sets")

# Compressed parts of a log.

ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of a frame of Zstandard (RFC 8878, 3.1.1)


def unpack(kind: str, data: bytes, *, where: object) -> bytes:
    """Decompress one part; `kind` is "", none, bz2, lz4 or zstd.

    Raises InputError beyond the limit MAX_ARRAY_MB, for another kind, and for a truncated part.
    """
    if kind in ("", "none"):
        return data
    if kind not in _OPEN:
        raise InputError("a part of the log is packed in a way that is not read", where=where, value=kind)
    most = int(limit("MAX_ARRAY_MB") * MB)
    with damage(where, what="a packed part of the log is damaged"):
        unpacker = _OPEN[kind]()
        found = bytes(unpacker.decompress(data, max_length=most + 1))
        check(len(found) / MB, "MAX_ARRAY_MB", what="a part of the log, unpacked, in MB,", where=where)
        if not unpacker.eof:
            raise ValueError("it is truncated")
    return found


class _Zstd:
    """Decompressor of Zstandard with a limit, like that of bz2."""

    def __init__(self) -> None:
        self.eof = False

    def decompress(self, data: bytes, max_length: int) -> bytes:
        """Return at most `max_length` bytes."""
        opened = library("zstandard").ZstdDecompressor(max_window_size=1 << 27).stream_reader(data)
        found: bytes = opened.read(max_length)
        stated = library("zstandard").frame_content_size(data)
        self.eof = stated < 0 or len(found) >= min(stated, max_length)
        return found


_OPEN: dict[str, Any] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lambda: library("lz4.frame").LZ4FrameDecompressor(),
    "zstd": _Zstd,
}


# Logs: ROS 1 (.bag), ROS 2 (a folder, .db3 or .mcap) and MCAP (.mcap). Message definitions in a log are not used.

STORAGES = (".bag", ".db3", ".mcap")


@dataclass(frozen=True, slots=True)
class Message:
    """Bytes of one message; `log_ns` is the time of logging in ns, `encoding` ros1 or cdr."""

    topic: str
    kind: str
    log_ns: int
    data: bytes
    encoding: str


@dataclass(slots=True)
class Log:
    """A log on disk; `topics` are filled in with their types while messages are read."""

    path: Path
    topics: dict[str, str] = field(default_factory=dict)

    def messages(self, wanted: Collection[str]) -> Iterator[Message]:
        """Yield the messages of the wanted topics in the order of the log.

        Raises InputError for a log that is damaged, truncated, or beyond the limits.
        """
        total = 0.0
        for path in _files(self.path):
            check_regular(path)
            remedy = "Copy it again, or repair it with the tools of ROS (rosbag reindex, mcap recover)."
            with damage(path, what="the log is damaged or truncated", remedy=remedy):
                for message in _READ[path.suffix](self, path, wanted):
                    total += len(message.data) / MB
                    check(total, "MAX_FILE_MB", what="what the log holds, unpacked, in MB,", where=path)
                    yield message


def _files(path: Path) -> list[Path]:
    """Return the storage files of a log. Raises InputError where there is none."""
    if not path.exists():
        raise InputError("there is no such log", where=path)
    found = [path]
    if path.is_dir():
        found = sorted(one for one in path.iterdir() if one.suffix in STORAGES)
        packed = sorted(one.name for one in path.iterdir() if one.suffix == ".zstd")
        if packed:
            raise InputError(
                "the bag's files are packed", where=path, value=packed[0], remedy="Unpack them with zstd -d."
            )
    if not found or any(one.suffix not in STORAGES for one in found):
        raise InputError(
            "is no log that is read here", where=path, remedy=f"Logs are {', '.join(STORAGES)}, or a ROS 2 folder."
        )
    return found


def _read_ros1(log: Log, path: Path, wanted: Collection[str]) -> Iterator[Message]:
    with library("rosbags.rosbag1").Reader(path) as bag:
        names = {value: name for name, value in library("rosbags.rosbag1.reader").decompressors.items()}
        for place, chunk in bag.chunks.items():
            bag.chunks[place] = chunk._replace(decompressor=partial(unpack, names[chunk.decompressor], where=path))
        yield from _messages(log, bag, wanted, "ros1")


def _read_sqlite(log: Log, path: Path, wanted: Collection[str]) -> Iterator[Message]:
    if set("?#%") & set(str(path)):
        raise InputError("the path has a letter that SQLite reserves (?, #, %)", where=path, remedy="Rename it.")
    with library("rosbags.rosbag2").Reader(path) as bag:
        for message in _messages(log, bag, wanted, "cdr"):
            yield replace(message, data=_plain(message.data, path))


def _messages(log: Log, bag: Any, wanted: Collection[str], encoding: str) -> Iterator[Message]:
    log.topics |= {one.topic: one.msgtype for one in bag.connections}
    chosen = [one for one in bag.connections if one.topic in wanted]
    for about, log_ns, data in bag.messages(chosen) if chosen else ():
        yield Message(about.topic, about.msgtype, log_ns, bytes(data), encoding)


def _plain(data: bytes, path: Path) -> bytes:
    """Decompress a message that begins as Zstandard; CDR begins with 00."""
    return unpack("zstd", data, where=path) if data.startswith(ZSTD) else data


def _read_mcap(log: Log, path: Path, wanted: Collection[str]) -> Iterator[Message]:
    records, stream = library("mcap.records"), library("mcap.stream_reader")
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str, str]] = {}
    with path.open("rb") as file:
        size = path.stat().st_size
        for outer in stream.StreamReader(file, emit_chunks=True, record_size_limit=size).records:
            inner = [outer]
            if isinstance(outer, records.Chunk):
                outer.data, outer.compression = unpack(outer.compression, outer.data, where=path), ""
                if len(outer.data) != outer.uncompressed_size:
                    raise ValueError(f"a chunk unpacks to {len(outer.data)} bytes, not {outer.uncompressed_size}")
                inner = stream.breakup_chunk(outer, validate_crc=True)
            for record in inner:
                if isinstance(record, records.Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, records.Channel):
                    kind = schemas.get(record.schema_id, "")
                    channels[record.id] = record.topic, kind, record.message_encoding
                    log.topics[record.topic] = kind
                elif isinstance(record, records.Message) and channels[record.channel_id][0] in wanted:
                    topic, kind, encoding = channels[record.channel_id]
                    yield Message(topic, ros2_name(kind), record.log_time, _plain(record.data, path), encoding)


def ros2_name(kind: str) -> str:
    """Return the ROS 2 name of a type: sensor_msgs/msg/Image for sensor_msgs/Image of ROS 1."""
    return kind if kind.count("/") != 1 else kind.replace("/", "/msg/")


_READ: dict[str, Callable[[Log, Path, Collection[str]], Iterator[Message]]] = {
    ".bag": _read_ros1,
    ".db3": _read_sqlite,
    ".mcap": _read_mcap,
}
