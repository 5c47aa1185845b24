"""Depth and force as ROS messages: an MCAP file, a ROS 1 bag, or a ROS 2 folder (sqlite3)."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import OutputError
from tactilevision.files import replacing, told_as_output, unfinished
from tactilevision.logs.library import library
from tactilevision.logs.messages import IMAGE, WRENCH, typestore
from tactilevision.records import Floats, HeightMap

MM = 1e-3  # metres: the unit of length in ROS (REP 103)
Put = Callable[[str, Any, int], None]  # topic, message, time in ns


def depth_message(height: HeightMap, *, time_ns: int, frame_id: str, encoding: str) -> Any:
    """sensor_msgs/Image 32FC1 in metres of a map (H, W) in mm; NaN where that is not valid (REP 118)."""
    depth_m = np.where(height.valid, height.depth_mm * MM, np.nan).astype("<f4")
    rows, columns = depth_m.shape
    data = np.frombuffer(np.ascontiguousarray(depth_m).tobytes(), np.uint8)
    return _type(IMAGE, encoding)(
        header=_header(time_ns, frame_id, encoding),
        height=rows,
        width=columns,
        encoding="32FC1",
        is_bigendian=0,
        step=4 * columns,
        data=data,
    )


def wrench_message(force_N: Floats, moment_Nmm: Floats, *, time_ns: int, frame_id: str, encoding: str) -> Any:
    """geometry_msgs/WrenchStamped of force (3,) in N and moment (3,) in N mm, which becomes N m."""
    vector = _type("geometry_msgs/msg/Vector3", encoding)
    force, torque = vector(*map(float, force_N)), vector(*(float(one) * MM for one in moment_Nmm))
    both = _type("geometry_msgs/msg/Wrench", encoding)(force=force, torque=torque)
    return _type(WRENCH, encoding)(header=_header(time_ns, frame_id, encoding), wrench=both)


@contextmanager
def open_writer(path: Path) -> Iterator[tuple[Put, str]]:
    """What puts messages into a log, and their encoding; the log has its name once it is whole.

    The ending chooses: .mcap, .bag (ROS 1), none (a ROS 2 folder). Raises OutputError for another.
    """
    if path.suffix == ".mcap":
        with replacing(path) as temporary, _mcap(temporary) as put:
            yield put, "cdr"
    elif path.suffix == ".bag":
        with replacing(path) as temporary:
            temporary.unlink()
            with library("rosbags.rosbag1").Writer(temporary) as bag:
                yield _putter(bag, "ros1"), "ros1"
    elif not path.suffix:
        with _folder(path) as put:
            yield put, "cdr"
    else:
        raise OutputError("logs end in .mcap or .bag; without an ending it is a ROS 2 folder", where=path)


@contextmanager
def _folder(path: Path) -> Iterator[Put]:
    if path.exists():
        raise OutputError(
            "is there already", where=path, remedy="A ROS 2 bag is written anew: choose another name."
        )
    bags = library("rosbags.rosbag2")
    with told_as_output(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=unfinished(), dir=path.parent))
    try:
        with bags.Writer(scratch / path.name, version=8, storage_plugin=bags.StoragePlugin.SQLITE3) as bag:
            yield _putter(bag, "cdr")
        with told_as_output(path):
            (scratch / path.name).rename(path)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _putter(bag: Any, encoding: str) -> Put:
    """Through rosbags."""
    store, topics = typestore(encoding), {}

    def put(topic: str, message: Any, time_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in topics:
            topics[topic] = bag.add_connection(topic, kind, typestore=store)
        packed = store.serialize_ros1(message, kind) if encoding == "ros1" else store.serialize_cdr(message, kind)
        bag.write(topics[topic], time_ns, packed)

    return put


@contextmanager
def _mcap(path: Path) -> Iterator[Put]:
    """Through mcap."""
    store, topics = typestore("cdr"), {}
    with path.open("wb") as file:
        writer = library("mcap.writer").Writer(file)
        writer.start(profile="ros2", library="tactilevision")

        def put(topic: str, message: Any, time_ns: int) -> None:
            kind = message.__msgtype__
            if topic not in topics:
                text, _ = store.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                topics[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(topics[topic], log_time=time_ns, data=data, publish_time=time_ns)

        yield put
        writer.finish()


def _type(kind: str, encoding: str) -> Any:
    return typestore(encoding).types[kind]


def _header(time_ns: int, frame_id: str, encoding: str) -> Any:
    stamp = _type("builtin_interfaces/msg/Time", encoding)(sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    counted = {"seq": 0} if encoding == "ros1" else {}
    return _type("std_msgs/msg/Header", encoding)(stamp=stamp, frame_id=frame_id, **counted)
