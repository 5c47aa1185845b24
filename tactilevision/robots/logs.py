"""Reader of robot logs (ROS 1 bag, ROS 2 folder or MCAP): topics and messages in bytes, within a child process."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import quote

from tactilevision import errors
from tactilevision.errors import InputError
from tactilevision.files.opening import damage, inside

library = partial(errors.library, extra="logs", where="logs and data sets")

# Logs: ROS 1 (.bag), ROS 2 (a folder, .db3 or .mcap) and MCAP (.mcap). Message definitions in a log are not used.

STORAGES = (".bag", ".db3", ".mcap")
ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of a frame of Zstandard (RFC 8878, 3.1.1)
Topics = dict[str, str]  # their types by their names


@dataclass(frozen=True, slots=True)
class Message:
    """Bytes of one message; `log_ns` is the time of logging in ns, `encoding` ros1 or cdr."""

    topic: str
    kind: str
    log_ns: int
    data: bytes
    encoding: str


def storage_files(path: Path) -> list[Path]:
    """Return the storage files of a log. Raises InputError where there is none."""
    if not path.exists():
        raise InputError("there is no such log", where=path)
    found = [path]
    if path.is_dir():
        names = sorted(one.name for one in path.iterdir())
        found = [inside(path, name, where=path) for name in names if name.endswith(STORAGES)]
        packed = [name for name in names if name.endswith(".zstd")]
        if packed:
            raise InputError(
                "the bag's files are packed", where=path, value=packed[0], remedy="Unpack them with zstd -d."
            )
    if not found or any(one.suffix not in STORAGES for one in found):
        raise InputError(
            "is no log that is read here", where=path, remedy=f"Logs are {', '.join(STORAGES)}, or a ROS 2 folder."
        )
    return found


def messages(path: Path, wanted: Collection[str], topics: Topics) -> Iterator[Message]:
    """Yield the messages of the wanted topics in the order of the log, and enter all topics into `topics`.

    It runs in a child process, since it has no limits. Raises InputError for a log that is damaged or truncated.
    """
    remedy = "Copy it again, or repair it with the tools of ROS (rosbag reindex, mcap recover)."
    for file in storage_files(path):
        with damage(file, what="the log is damaged or truncated", remedy=remedy):
            with file.open("rb") as opened:
                first = opened.read(16)
            read = next((read for start, read in _READ.items() if first.startswith(start)), None)
            if read is None:
                raise InputError("is no ROS bag, SQLite or MCAP by its first bytes", where=file, value=first)
            yield from read(file, wanted, topics)


def _read_ros1(path: Path, wanted: Collection[str], topics: Topics) -> Iterator[Message]:
    with library("rosbags.rosbag1").Reader(path) as bag:
        topics |= {one.topic: one.msgtype for one in bag.connections}
        chosen = [one for one in bag.connections if one.topic in wanted]
        for about, log_ns, data in bag.messages(chosen) if chosen else ():
            yield Message(about.topic, about.msgtype, log_ns, bytes(data), "ros1")


def _read_sqlite(path: Path, wanted: Collection[str], topics: Topics) -> Iterator[Message]:
    """Read tables alone: a view, a trigger, a virtual table or a calculated column is a program."""
    with closing(sqlite3.connect(f"file:{quote(str(path.absolute()))}?immutable=1&mode=ro", uri=True)) as base:
        base.execute("PRAGMA trusted_schema = OFF")
        base.execute("PRAGMA cell_size_check = ON")
        programs = "SELECT name FROM sqlite_master WHERE type NOT IN ('table', 'index') OR NOT rootpage > 0"
        columns = "SELECT name FROM pragma_table_xinfo(?) WHERE hidden"
        found = [*base.execute(programs), *base.execute(columns, ["topics"]), *base.execute(columns, ["messages"])]
        if found:
            raise InputError("holds more than tables", where=path, value=str(found[0][0])[:80])
        about = {number: (name, kind) for number, name, kind in base.execute("SELECT id, name, type FROM topics")}
        topics |= dict(about.values())
        chosen = ", ".join(str(int(number)) for number, (name, _) in about.items() if name in wanted)
        rows = base.execute(f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({chosen})")  # noqa: S608
        for number, log_ns, data in rows:
            yield Message(*about[number], int(log_ns), _plain(data), "cdr")


def _plain(data: bytes) -> bytes:
    """Decompress a message that begins as Zstandard; CDR begins with 00."""
    if not data.startswith(ZSTD):
        return data
    return bytes(library("zstandard").ZstdDecompressor().decompressobj().decompress(data))


def _read_mcap(path: Path, wanted: Collection[str], topics: Topics) -> Iterator[Message]:
    records, stream = library("mcap.records"), library("mcap.stream_reader")
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str, str]] = {}
    with path.open("rb") as file:
        for outer in stream.StreamReader(file, emit_chunks=True, record_size_limit=None).records:
            packed = isinstance(outer, records.Chunk)
            for record in stream.breakup_chunk(outer, validate_crc=True) if packed else [outer]:
                if isinstance(record, records.Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, records.Channel):
                    kind = schemas.get(record.schema_id, "")
                    channels[record.id] = record.topic, kind, record.message_encoding
                    topics[record.topic] = kind
                elif isinstance(record, records.Message) and channels[record.channel_id][0] in wanted:
                    topic, kind, encoding = channels[record.channel_id]
                    yield Message(topic, ros2_name(kind), record.log_time, _plain(record.data), encoding)


def ros2_name(kind: str) -> str:
    """Return the ROS 2 name of a type: sensor_msgs/msg/Image for sensor_msgs/Image of ROS 1."""
    return kind if kind.count("/") != 1 else kind.replace("/", "/msg/")


_READ: dict[bytes, Callable[[Path, Collection[str], Topics], Iterator[Message]]] = {
    b"#ROSBAG V2": _read_ros1,
    b"SQLite format 3\0": _read_sqlite,
    b"\x89MCAP0\r\n": _read_mcap,
}
