"""Makers of containers that unpack to gigabytes, or state work without end, each of some kilobytes."""

from __future__ import annotations

import bz2
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

GB = 10**9
TOPICS = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)"
MESSAGES = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)"
TOPIC = "INSERT INTO topics VALUES (1, '/camera', 'sensor_msgs/msg/Image', 'cdr')"


def _record(header: dict[str, bytes], data: bytes) -> bytes:
    """A record of a ROS 1 bag."""
    fields = [name.encode() + b"=" + value for name, value in header.items()]
    packed = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(packed)) + packed + struct.pack("<I", len(data)) + data


def _connection() -> bytes:
    about = {"topic": b"/camera", "type": b"sensor_msgs/Image", "md5sum": b"*", "message_definition": b""}
    inner = b"".join(
        struct.pack("<I", len(one)) + one for one in (k.encode() + b"=" + v for k, v in about.items())
    )
    return _record({"op": b"\7", "conn": struct.pack("<I", 0), "topic": b"/camera"}, inner)


def bag_of_zeros(path: Path, *, unpacked: int = GB) -> None:
    """A chunk of bzip2 that unpacks to zeros."""
    part = bz2.compress(bytes(unpacked // 100))
    magic = b"#ROSBAG V2.0\n"
    u32, u64 = struct.Struct("<I").pack, struct.Struct("<Q").pack
    chunk = _record({"op": b"\5", "compression": b"bz2", "size": u32(2**32 - 1)}, part * 100)
    index = _record(
        {"op": b"\4", "ver": u32(1), "conn": u32(0), "count": u32(1)}, struct.pack("<II", 1, 0) + u32(0)
    )
    head = {"op": b"\3", "conn_count": u32(1), "chunk_count": u32(1), "index_pos": u64(0)}
    size = len(_record(head, b""))
    head["index_pos"] = u64(len(magic) + size + len(chunk) + len(index))
    times = {"start_time": struct.pack("<II", 1, 0), "end_time": struct.pack("<II", 1, 0)}
    info = {"op": b"\6", "ver": u32(1), "chunk_pos": u64(len(magic) + size), "count": u32(1)} | times
    end = _connection() + _record(info, u32(0) + u32(1))
    path.write_bytes(magic + _record(head, b"") + chunk + index + end)


def _mcap(path: Path, chunks: list[tuple[str, bytes, int]]) -> None:
    """An MCAP of a schema, a channel and these chunks: compression, data, stated size."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(kind: int, data: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(data)) + data

    out = b"\x89MCAP0\r\n" + record(1, text("ros2") + text(""))
    schema = struct.pack("<H", 1) + text("sensor_msgs/msg/Image") + text("ros2msg") + struct.pack("<I", 0)
    out += record(3, schema)
    out += record(4, struct.pack("<HH", 1, 1) + text("/camera") + text("cdr") + struct.pack("<I", 0))
    for kind, data, size in chunks:
        about = struct.pack("<QQQI", 0, 1, size, 0) + text(kind) + struct.pack("<Q", len(data))
        out += record(6, about + data)
    out += record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + b"\x89MCAP0\r\n"
    path.write_bytes(out)


def _message(data: bytes) -> bytes:
    body = struct.pack("<HIQQ", 1, 0, 1, 1) + data
    return struct.pack("<BQ", 5, len(body)) + body


def _packed(start: bytes, zeros: int) -> bytes:
    """Bytes and then zeros in Zstandard, without all of them in memory here."""
    import zstandard

    part = bytes(10**6)
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=len(start) + zeros * len(part))
    return b"".join([packer.compress(start), *(packer.compress(part) for _ in range(zeros)), packer.flush()])


def mcap_of_zeros(path: Path) -> None:
    """A chunk with one message of a gigabyte."""
    head = struct.pack("<BQ", 5, 22 + GB) + struct.pack("<HIQQ", 1, 0, 1, 1)
    _mcap(path, [("zstd", _packed(head, 1000), len(head) + GB)])


def mcap_of_packed_messages(path: Path) -> None:
    """A message of a gigabyte that is packed by itself."""
    body = _message(_packed(b"", 1000))
    _mcap(path, [("", body, len(body))])


def mcap_of_small_messages(path: Path) -> None:
    """Millions of empty messages in a chunk."""
    import zstandard

    whole = _message(b"") * 3_000_000
    _mcap(path, [("zstd", zstandard.ZstdCompressor(level=1).compress(whole), len(whole))])


def mcap_of_many_chunks(path: Path) -> None:
    """Chunks that take long for their size."""
    _mcap(path, [("zstd", _packed(b"", 100), 10**8)] * 200)


def cdr_picture(width: int = 2, height: int = 2, *, frame: str = "tool") -> bytes:
    """A message sensor_msgs/Image of zeros."""
    from tactilevision.robots.messages import IMAGE, typestore

    store = typestore("cdr")
    time = store.types["builtin_interfaces/msg/Time"](1, 0)
    header = store.types["std_msgs/msg/Header"](time, frame)
    data = np.zeros(3 * width * height, np.uint8)
    return bytes(store.serialize_cdr(store.types[IMAGE](header, height, width, "rgb8", 0, 3 * width, data), IMAGE))


def mcap_of_pictures(path: Path, count: int = 50_000, chunks: int = 20, **about: Any) -> None:
    """Many pictures, each whole, that are stored once."""
    import zstandard

    whole = _message(cdr_picture(**about)) * count
    _mcap(path, [("zstd", zstandard.ZstdCompressor(level=3).compress(whole), len(whole))] * chunks)


def _database(*statements: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        base = sqlite3.connect(path)
        for statement in statements:
            base.execute(statement)
        base.commit()
        base.close()

    return make


def _view(name: str, columns: str) -> str:
    """A view of rows without end."""
    rows = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT"
    return f"CREATE VIEW {name} AS {rows} {columns} FROM n"


MESSAGE = "x AS id, 1 AS topic_id, x AS timestamp,"
view_without_end = _database(TOPICS, TOPIC, _view("messages", f"{MESSAGE} x'00' AS data"))
view_of_gigabytes = _database(TOPICS, TOPIC, _view("messages", f"{MESSAGE} zeroblob(500000000) AS data"))
topics_without_end = _database(MESSAGES, _view("topics", "x AS id, x AS name, x AS type"))
calculated_column = _database(
    TOPICS,
    TOPIC,
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data AS (zeroblob(900000000)))",
    "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1), (1, 2)",
)


def endless_tree(path: Path) -> None:
    """A table whose inner pages all lead to the same pages below: rows without end."""
    size = 512
    base = sqlite3.connect(path)
    base.execute(f"PRAGMA page_size = {size}")
    for statement in (TOPICS, MESSAGES, TOPIC):
        base.execute(statement)
    rows = [(k, cdr_picture()) for k in range(1200)]
    base.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", rows)
    base.commit()
    (root,) = base.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    base.close()
    data = bytearray(path.read_bytes())
    pages = {number: (number - 1) * size for number in range(2, len(data) // size + 1)}
    inner = [root, *(number for number, start in pages.items() if data[start] == 5 and number != root)][:8]
    leaf = max(number for number, start in pages.items() if data[start] == 13)
    for number, below in zip(inner, [*inner[1:], leaf], strict=True):
        start = pages[number]
        data[start + 8 : start + 12] = struct.pack(">I", below)
        for cell in range(struct.unpack_from(">H", data, start + 3)[0]):
            place = start + struct.unpack_from(">H", data, start + 12 + 2 * cell)[0]
            data[place : place + 4] = struct.pack(">I", below)
    path.write_bytes(data)


def playlist(path: Path) -> None:
    """A list of files for FFmpeg, which may lie anywhere."""
    path.write_text("ffconcat version 1.0\n" + "file 'link.avi'\n" * 50)


def film_list(path: Path) -> None:
    """A list of HTTP Live Streaming."""
    path.write_text("#EXTM3U\n#EXT-X-TARGETDURATION:1\n" + "#EXTINF:1,\nlink.avi\n" * 50 + "#EXT-X-ENDLIST\n")


def table_of_gigabytes(path: Path) -> None:
    """A Parquet table with a further column whose long text is stored once."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.concat_tables([pq.read_table(path)] * 6)
    every = pa.DictionaryArray.from_arrays(pa.array(np.zeros(len(table), np.int32)), ["x" * 20_000_000])
    pq.write_table(table.append_column("task", every), path, compression="zstd", store_schema=False)


def table_of_episodes(path: Path, camera: str, count: int = 1_000_000) -> None:
    """A Parquet table of episodes in order, each of half a byte."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    zeros, video = np.zeros(count, np.int64), f"videos/{camera}"
    columns = {"episode_index": np.arange(count), "length": zeros + 1, f"{video}/from_timestamp": zeros}
    for name in ("data", video):
        columns |= {f"{name}/chunk_index": zeros, f"{name}/file_index": zeros}
    delta = {"episode_index": "DELTA_BINARY_PACKED"}
    pq.write_table(pa.table(columns), path, compression="zstd", use_dictionary=False, column_encoding=delta)


def film_of_samples(path: Path, count: int, *, size: int) -> None:
    """An MP4 of five frames whose tables state another number, of one size (0: as before)."""
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30, (64, 48))
    for _ in range(5):
        writer.write(np.full((48, 64, 3), 90, np.uint8))
    writer.release()
    data = bytearray(path.read_bytes())
    for name, words in (("stsz", (size, count)), ("stts", (1, count, 1024)), ("stsc", (1, 1, count, 1))):
        place = data.index(name.encode()) + 8
        data[place : place + 4 * len(words)] = struct.pack(f">{len(words)}I", *words)
    path.write_bytes(data)
