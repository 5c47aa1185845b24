"""Depth, force and tractions of a recording as ROS messages in MCAP, ROS 1 or ROS 2 logs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tactilevision.errors import InputError, OutputError
from tactilevision.files.arrays import read_arrays
from tactilevision.files.opening import inside
from tactilevision.files.tiff import read_tiff
from tactilevision.files.writing import check_replaceable, make_folder, output_errors, replacing, unfinished
from tactilevision.force.frame import FIELDS, PATCH
from tactilevision.recording.layout import Columns
from tactilevision.recording.model import Recording
from tactilevision.recording.tables import read_table
from tactilevision.records.constants import KILO, MILLI
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Floats
from tactilevision.records.wrench import COMPONENTS
from tactilevision.robots.logs import library
from tactilevision.robots.messages import CLOUD, IMAGE, WRENCH, typestore

Put = Callable[[str, Any, int], None]  # topic, message, time in ns


def depth_message(height: HeightMap, *, time_ns: int, frame_id: str, encoding: str) -> Any:
    """Return sensor_msgs/Image 32FC1 in metres of a map (H, W) in mm; NaN where that is not valid (REP 118)."""
    depth_m = np.where(height.valid, height.depth_mm * MILLI, np.nan).astype("<f4")
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
    """Return geometry_msgs/WrenchStamped of force (3,) in N and moment (3,) in N mm, which becomes N m."""
    vector = _type("geometry_msgs/msg/Vector3", encoding)
    force, torque = vector(*map(float, force_N)), vector(*(float(one) * MILLI for one in moment_Nmm))
    both = _type("geometry_msgs/msg/Wrench", encoding)(force=force, torque=torque)
    return _type(WRENCH, encoding)(header=_header(time_ns, frame_id, encoding), wrench=both)


POINT = ("x", "y", "z", "traction_x", "traction_y", "traction_z", "patch")  # fields of a node: m, Pa, a number
FLOAT32 = 7  # its number in sensor_msgs/PointField


def traction_message(tractions: Tractions, number: int, *, time_ns: int, frame_id: str, encoding: str) -> Any:
    """Return sensor_msgs/PointCloud2 of POINT, float32, one for each node, in rows as the frame shows them.

    Places in m lie on the untouched face, z = 0; tractions on the gel in Pa, NaN where not measured; `patch` is
    the number of the node's contact patch, 0 outside.
    """
    rows, columns = tractions.fields[0].shape[1:]
    x, y = (
        first + step * np.arange(count)
        for first, step, count in zip(tractions.first_mm, tractions.mm_per_px, (columns, rows), strict=True)
    )
    across, down = np.meshgrid(x * MILLI, y * MILLI)
    forces = [one[number] * (KILO**2 if k < len(FIELDS) else 1.0) for k, one in enumerate(tractions.fields)]
    points = np.stack([across, down, np.zeros_like(across), *forces], axis=-1).astype("<f4")
    field, size = _type("sensor_msgs/msg/PointField", encoding), points.itemsize
    return _type(CLOUD, encoding)(
        header=_header(time_ns, frame_id, encoding),
        height=rows,
        width=columns,
        fields=[field(name=name, offset=size * k, datatype=FLOAT32, count=1) for k, name in enumerate(POINT)],
        is_bigendian=False,
        point_step=size * len(POINT),
        row_step=size * len(POINT) * columns,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=bool(np.isfinite(points).all()),
    )


@contextmanager
def open_writer(path: Path) -> Iterator[tuple[Put, str]]:
    """Open a log by its suffix, and give the function that writes messages, and their encoding.

    The suffix is .mcap, .bag (ROS 1) or none (a ROS 2 folder, sqlite3); the log is renamed once it is complete.
    Raises OutputError for another suffix.
    """
    if path.suffix == ".bag":
        with replacing(path) as temporary:
            temporary.unlink()
            with library("rosbags.rosbag1").Writer(temporary) as bag:
                yield _putter(bag, "ros1"), "ros1"
    elif path.suffix not in ("", ".mcap"):
        raise OutputError("logs end in .mcap or .bag; without an ending it is a ROS 2 folder", where=path)
    elif not path.suffix and path.exists():
        raise OutputError("exists already", where=path, remedy="Choose another name for the ROS 2 bag.")
    else:
        bags = library("rosbags.rosbag2")
        storage = bags.StoragePlugin.MCAP if path.suffix else bags.StoragePlugin.SQLITE3
        check_replaceable(path)
        make_folder(path.parent)
        with output_errors(path), TemporaryDirectory(prefix=unfinished(), dir=path.parent) as scratch:
            whole = Path(scratch) / path.stem  # an MCAP file of that name in it
            with bags.Writer(whole, version=8, storage_plugin=storage) as bag:
                yield _putter(bag, "cdr"), "cdr"
            (whole / path.name if path.suffix else whole).replace(path)


def _putter(bag: Any, encoding: str) -> Put:
    """Write through rosbags."""
    store, topics = typestore(encoding), {}

    def put(topic: str, message: Any, time_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in topics:
            topics[topic] = bag.add_connection(topic, kind, typestore=store)
        packed = store.serialize_ros1(message, kind) if encoding == "ros1" else store.serialize_cdr(message, kind)
        bag.write(topics[topic], time_ns, packed)

    return put


def _type(kind: str, encoding: str) -> Any:
    return typestore(encoding).types[kind]


def _header(time_ns: int, frame_id: str, encoding: str) -> Any:
    stamp = _type("builtin_interfaces/msg/Time", encoding)(sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    counted = {"seq": 0} if encoding == "ros1" else {}
    return _type("std_msgs/msg/Header", encoding)(stamp=stamp, frame_id=frame_id, **counted)


DEPTH_TOPIC, WRENCH_TOPIC, TRACTION_TOPIC = "/tactile/depth", "/tactile/wrench", "/tactile/tractions"
PAD = "gel_pad"  # frame of reference: x right, y down, z into the gel, from the pad's centre
_RESULTANTS = Columns(words=("frame",), maybe_numbers=COMPONENTS)


@dataclass(frozen=True, slots=True)
class Exported:
    """Numbers of messages of each kind, and of frames without a map."""

    depths: int
    wrenches: int
    tractions: int
    without: int


@dataclass(frozen=True, slots=True)
class Tractions:
    """What `force` wrote to tractions.npz: the frames' places in it, and `fields` (N, rows, columns) in MPa.

    The last field is the number of each node's patch. `first_mm` (x, y) is the place of the top left node.
    """

    frames: Mapping[str, int]
    fields: tuple[Floats, ...]
    mm_per_px: Floats
    first_mm: Floats


def export_log(
    recording: Recording, out: Path, *, depth: Path | None = None, force: Path | None = None, frame_id: str = PAD
) -> Exported:
    """Write `out` atomically from the folders that `depth` and `force` wrote for this recording.

    Times are the recording's, after the start stated in its [log]. Raises InputError where neither folder holds
    results of its frames, or frames have no time.
    """
    times = recording.frame_times_s
    if not len(times) or np.isnan(times).any():
        raise InputError(
            "frames have no time, which messages need", where=recording.path, remedy="Add frames.csv."
        )
    wrenches = {} if force is None else _wrenches(force / "resultants.csv")
    origin_ns = int(recording.settings.get("log", {}).get("origin_ns", 0))
    tractions = None if force is None else _tractions(force / "tractions.npz")
    counts = {"depth": 0, "wrench": 0, "traction": 0}
    with open_writer(out) as (put, encoding):
        for name, time_s in zip(recording.frame_names, times.tolist(), strict=True):
            time_ns = origin_ns + round(time_s * 10**9)
            about: dict[str, Any] = {"time_ns": time_ns, "frame_id": frame_id, "encoding": encoding}
            path = None if depth is None else _map(depth, name)
            if path is not None:
                put(DEPTH_TOPIC, depth_message(read_tiff(path), **about), time_ns)
                counts["depth"] += 1
            if name in wrenches:
                force_N, moment_Nmm = np.split(wrenches[name], 2)
                put(WRENCH_TOPIC, wrench_message(force_N, moment_Nmm, **about), time_ns)
                counts["wrench"] += 1
            if tractions is not None and name in tractions.frames:
                put(TRACTION_TOPIC, traction_message(tractions, tractions.frames[name], **about), time_ns)
                counts["traction"] += 1
        if not any(counts.values()):
            raise InputError(
                "there is neither depth nor force of the recording's frames",
                where=depth or force or recording.path,
                remedy="Give --depth the folder that `tactilevision depth` wrote (TIFF), --force that of `force`.",
            )
    without = 0 if depth is None else len(times) - counts["depth"]
    return Exported(counts["depth"], counts["wrench"], counts["traction"], without)


def _map(folder: Path, name: str) -> Path | None:
    """Return the map of a frame, by its stem, or by its whole name where stems are ambiguous."""
    for stem in (Path(name).stem, name):
        path = inside(folder / "depth", f"{stem}.tiff", where=folder)
        if path.is_file():
            return path
    return None


def _wrenches(path: Path) -> Mapping[str, Floats]:
    """Return force and moment (6,), N and N mm, of each frame with a normal force; NaN where not measured."""
    table = read_table(path, _RESULTANTS)
    missing = [name for name in COMPONENTS if name not in table.numbers]
    if missing:
        raise InputError("a column is missing", where=path, value=missing[0])
    numbers = np.column_stack([table.numbers[name] for name in COMPONENTS])
    pairs = zip(table.words["frame"], numbers, strict=True)
    return {name: row for name, row in pairs if np.isfinite(row[2])}


def _tractions(path: Path) -> Tractions | None:
    """Return the tractions that `force` wrote; None where it wrote none. Raises InputError for another content."""
    if not path.is_file():
        return None
    arrays = read_arrays(path)
    fields = [arrays[name] for name in (*FIELDS, PATCH) if name in arrays]
    shapes = {one.shape for one in fields} if len(fields) == len(POINT[3:]) else set()
    places = [arrays.get(name, np.zeros(0)).shape == (2,) for name in ("mm_per_px", "first_mm")]
    names = arrays.get("frame", np.zeros(0))
    if len(shapes) != 1 or not all(places) or names.dtype.kind != "U" or names.shape != fields[0].shape[:1]:
        raise InputError("holds no tractions as `tactilevision force` writes them", where=path)
    frames = {str(name): number for number, name in enumerate(names)}
    return Tractions(frames, tuple(fields), arrays["mm_per_px"], arrays["first_mm"])
