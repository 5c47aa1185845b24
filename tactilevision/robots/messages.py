"""Decoder of ROS messages: pictures, wrenches, header clocks and static transforms, within a child process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.child import Answer, Answers
from tactilevision.files.opening import MAX_NAME, check_numbers
from tactilevision.files.pictures import check_picture
from tactilevision.records.measured import Floats
from tactilevision.robots.logs import Message, Topics, library, messages, storage_files

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
WRENCH = "geometry_msgs/msg/WrenchStamped"
CLOUD = "sensor_msgs/msg/PointCloud2"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_COLOURS = {  # bytes of a pixel, and how OpenCV makes blue, green and red of it
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),  # two pixels share their colour, as USB cameras send it
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUY2),
}


@dataclass(frozen=True, slots=True)
class Stamp:
    """Header of a message: its time in ns, the time of logging in ns, and the frame of reference."""

    header_ns: int
    log_ns: int
    frame_id: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as bytes of a file and its suffix: raw ones become PNG, compressed ones are kept."""

    stamp: Stamp
    data: bytes
    suffix: str


@dataclass(frozen=True, slots=True)
class WrenchReading:
    """Force (3,) in N and torque (3,) in N m, in the axes of `stamp.frame_id`."""

    stamp: Stamp
    force_N: Floats
    torque_Nm: Floats


@cache
def typestore(encoding: str) -> Any:
    """Return the message types of ROS 1 or 2."""
    stores = library("rosbags.typesys")
    store = stores.get_typestore(stores.Stores.ROS1_NOETIC if encoding == "ros1" else stores.Stores.ROS2_HUMBLE)
    if TRANSFORMS not in store.types:  # ROS 1 has it in a package of its own
        store.register(stores.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
    return store


# Read in a child process: an answer for each message, then the topics.


def read_log(path: Path, topics: Topics, **wanted: str | None) -> Iterator[tuple[str, Any]]:
    """Yield a word of `wanted` and what a message of its topic holds, in order.

    This is a Picture, a WrenchReading, or a transform: the frames child and parent, and a quaternion (4,),
    dimensionless, with v_parent = R v_child.

    The words are picture, wrench, tf and tf_static; None is no topic. `topics` are entered at the end, with their
    types. Raises InputError for a log that is damaged or beyond the limits, and for a message of another type.
    """
    words = {topic: word for word, topic in wanted.items() if topic is not None}
    for word, *parts in Answers(answers, str(path), words, files=storage_files(path)):
        if word == "topics":
            topics |= dict(parts[0])
        elif word == "picture":
            yield word, Picture(Stamp(*parts[:3]), parts[4].tobytes(), parts[3])
        elif word == "wrench":
            yield word, WrenchReading(Stamp(*parts[:3]), parts[3][:3], parts[3][3:])
        else:
            yield word, parts


def answers(path: str, wanted: Mapping[str, str]) -> Iterator[Answer]:
    """Yield the contents of messages for `read_log`; `wanted` are words by their topics."""
    topics: Topics = {}
    for message in messages(Path(path), wanted, topics):
        word = wanted[message.topic]
        for parts in _DECODE[word](message, f"{path}, {message.topic}"):
            yield word, *parts
    yield "topics", list(topics.items())


def _decode_picture(message: Message, where: str) -> Iterator[Answer]:
    """Yield a picture (H, W, 3) of grey levels as a file: raw ones become PNG, compressed ones are kept."""
    found = _decoded(message, (IMAGE, COMPRESSED), where)
    data = _png(found, where) if message.kind == IMAGE else bytes(found.data)
    check_picture(data, where=where)
    ending = ".jpg" if data.startswith(b"\xff\xd8") else ".png" if data.startswith(b"\x89PNG") else ""
    if not ending:
        raise InputError("packed pictures are JPEG or PNG", where=where, value=found.format)
    yield *_stamp(found, message, where), ending, data


def _decode_wrench(message: Message, where: str) -> Iterator[Answer]:
    found = _decoded(message, (WRENCH,), where)
    values = [getattr(part, axis) for part in (found.wrench.force, found.wrench.torque) for axis in "xyz"]
    check_numbers(np.array(values, float), what="a component of the wrench", where=where)
    yield *_stamp(found, message, where), np.array(values, float)


def _decode_turns(message: Message, where: str) -> Iterator[Answer]:
    for one in _decoded(message, (TRANSFORMS,), where).transforms:
        quaternion = [getattr(one.transform.rotation, axis) for axis in "xyzw"]
        yield _short(one.child_frame_id, where), _short(one.header.frame_id, where), quaternion


_DECODE = {"picture": _decode_picture, "wrench": _decode_wrench, "tf": _decode_turns, "tf_static": _decode_turns}


def _decoded(message: Message, kinds: tuple[str, ...], where: str) -> Any:
    if message.kind not in kinds or message.encoding not in ("ros1", "cdr"):
        remedy = "Needed: " + " or ".join(kinds) + "."
        raise InputError("the topic is of another type", where=where, value=message.kind, remedy=remedy)
    store = typestore(message.encoding)
    read = store.deserialize_ros1 if message.encoding == "ros1" else store.deserialize_cdr
    return read(message.data, message.kind)


def _stamp(found: Any, message: Message, where: str) -> tuple[int, int, str]:
    stamp = found.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec, message.log_ns, _short(found.header.frame_id, where)


def _short(name: str, where: str) -> str:
    if len(name) > MAX_NAME:
        raise InputError(f"the name of a frame of reference is beyond {MAX_NAME} letters", where=where)
    return name


def _png(found: Any, where: str) -> bytes:
    """Encode a raw picture as PNG."""
    if found.encoding not in _COLOURS:
        remedy = f"Slopes are read from colours of 8 bits: {', '.join(_COLOURS)}."
        raise InputError("colours of this encoding are not read", where=where, value=found.encoding, remedy=remedy)
    channels, order = _COLOURS[found.encoding]
    data = np.asarray(found.data, np.uint8)
    if found.step < channels * found.width or len(data) != found.step * found.height or not len(data):
        raise InputError(
            "a picture holds other bytes than its size needs",
            where=where,
            value=f"{found.width} x {found.height}, step {found.step}, {len(data)} bytes",
        )
    if channels == 2 and found.width % 2:
        raise InputError("a picture of paired pixels has an odd width", where=where, value=found.width)
    rows = data.reshape(found.height, found.step)[:, : channels * found.width]
    picture = np.ascontiguousarray(rows).reshape(found.height, found.width, channels)
    _, packed = cv2.imencode(".png", picture if order is None else cv2.cvtColor(picture, order))
    return packed.tobytes()


# Clocks of headers. A header's time less the log's is a small and steady delay where both have the same clock.

MAX_DELAY_S = 0.5  # s: pictures reach a log within some tenths of a second; another clock is off by far more


class Clock(StrEnum):
    """Source of time: the messages' headers, or the log."""

    HEADER = "header"
    LOG = "log"


def check_clocks(topics: Mapping[str, Sequence[Stamp]], log: Path) -> None:
    """Raise InputError for headers without a time, a clock that was reset within the log, and two clocks.

    `topics` are the stamps of each by its name.
    """
    ahead_s = [_ahead_s(stamps, f"{log}, {topic}") for topic, stamps in topics.items()]
    if np.ptp(ahead_s) > MAX_DELAY_S:
        raise InputError(
            "frames and wrench are on two clocks",
            where=log,
            value=f"headers are {' and '.join(f'{one:+.3f} s' for one in ahead_s)} from the log's time",
            remedy="Use the log's time with --clock log.",
        )


def _ahead_s(stamps: Sequence[Stamp], where: str) -> float:
    """Return the median of header less log time, s, of one topic. Raises as `check_clocks`."""
    if any(one.header_ns == 0 for one in stamps):
        raise InputError("a header holds no time", where=where, remedy="Use the log's time with --clock log.")
    ahead_s = np.array([one.header_ns - one.log_ns for one in stamps]) / 10**9
    middle = float(np.median(ahead_s))
    off = np.flatnonzero(np.abs(ahead_s - middle) > MAX_DELAY_S)
    if off.size > 1 or (off.size and len(stamps) < 3):
        raise InputError(
            "the headers' clock was reset within the log",
            where=f"{where}, message {off[0] + 1}",
            value=f"{ahead_s[off[0]] - middle:+.3f} s",
            remedy="Cut the log there, or use its own time with --clock log.",
        )
    return middle


def times_s(stamps: Sequence[Stamp], clock: Clock, *, origin_ns: int) -> Floats:
    """Return times (n,) in s after `origin_ns` on the chosen clock."""
    return np.array([_time_ns(one, clock) - origin_ns for one in stamps], dtype=float) / 10**9


def first_ns(stamps: Sequence[Stamp], clock: Clock) -> int:
    """Return the earliest time, ns, rounded down to a second."""
    return min(_time_ns(one, clock) for one in stamps) // 10**9 * 10**9


def _time_ns(stamp: Stamp, clock: Clock) -> int:
    return stamp.log_ns if clock is Clock.LOG else stamp.header_ns


# Rotation between frames of reference by the transforms of a log: v_parent = R v_child, R of a unit quaternion.
# Frames whose R changes within the log are moving joints; joints that stood still count as fixed.

FIXED_RAD = 2e-3  # a joint at rest is read to a tenth of a degree; this is less than a force's noise
UNIT = 1e-3  # tolerance of a quaternion's length of 1, for quaternions of 32 bits


def fixed_rotation(log: Path, of: str, into: str) -> Floats | None:
    """Return R (3, 3), dimensionless, with v_into = R v_of; None where the frames are not fixed to each other.

    Raises InputError for a quaternion that is not of unit length.
    """
    from scipy.spatial.transform import Rotation  # which takes a while to load

    parents: dict[str, tuple[str, Rotation]] = {}
    moving = set()
    for word, (child, parent, quaternion) in read_log(log, {}, tf="/tf", tf_static="/tf_static"):
        # names of ROS 1 begin with a slash, those in transforms do not
        child, parent = child.lstrip("/"), parent.lstrip("/")
        if not abs(float(np.linalg.norm(quaternion)) - 1.0) < UNIT:
            said = f"the transform of {child!r} is no rotation"
            raise InputError(said, where=f"{log}, /{word}", value=quaternion)
        known, turn = parents.setdefault(child, (parent, turned := Rotation.from_quat(quaternion)))
        if known != parent or (turn.inv() * turned).magnitude() > FIXED_RAD:
            moving.add(child)
    fixed = {child: way for child, way in parents.items() if child not in moving}
    theirs, ours = (_way_up(frame.lstrip("/"), fixed, Rotation.identity()) for frame in (of, into))
    shared = next((frame for frame in theirs if frame in ours), None)
    return None if shared is None else np.asarray((ours[shared].inv() * theirs[shared]).as_matrix())


def _way_up(frame: str, fixed: Mapping[str, tuple[str, Rotation]], start: Rotation) -> dict[str, Rotation]:
    """Return the rotation of `frame` in each frame that it is fixed to, itself the first with `start`."""
    ways, turned = dict[str, Any](), start
    while frame not in ways:
        ways[frame] = turned
        frame, turn = fixed.get(frame, (frame, start))
        turned = turn * turned
    return ways
