"""Decode ROS messages: pictures, wrenches, header clocks and static transforms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tactilevision.errors import InputError
from tactilevision.files.opening import check, check_numbers
from tactilevision.files.pictures import check_picture
from tactilevision.records.measured import Floats
from tactilevision.robots.logs import Log, Message, library

# Pictures and wrenches out of the bytes of ROS messages, ROS 1 or CDR.

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
WRENCH = "geometry_msgs/msg/WrenchStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_COLOURS = {"rgb8": (3, False), "bgr8": (3, True), "rgba8": (4, False), "bgra8": (4, True), "8UC3": (3, True)}
_PAIRED = {  # two pixels share their colour, as USB cameras send it
    "yuv422": cv2.COLOR_YUV2BGR_UYVY,
    "uyvy": cv2.COLOR_YUV2BGR_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2BGR_YUY2,
    "yuyv": cv2.COLOR_YUV2BGR_YUY2,
}


@dataclass(frozen=True, slots=True)
class Stamp:
    """The header: ns on the clock of whoever sent it, ns when it was logged, and the frame of reference."""

    header_ns: int
    log_ns: int
    frame_id: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as a file: its bytes and their ending; raw ones become PNG, packed ones stay as they came."""

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
    """The messages of ROS, as its packages define them."""
    stores = library("rosbags.typesys")
    store = stores.get_typestore(stores.Stores.ROS1_NOETIC if encoding == "ros1" else stores.Stores.ROS2_HUMBLE)
    if TRANSFORMS not in store.types:  # ROS 1 has it in a package of its own
        store.register(stores.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
    return store


def decode_picture(message: Message, where: Path) -> Picture:
    """A picture (H, W, 3) of grey levels, as a file.

    Raises InputError for another type, colours that are not read, and damaged bytes.
    """
    found = _decoded(message, (IMAGE, COMPRESSED), where)
    stamp = _stamp(found, message)
    if message.kind == COMPRESSED:
        data = bytes(found.data)
        check_picture(data, where=where)
        ending = ".jpg" if data.startswith(b"\xff\xd8") else ".png" if data.startswith(b"\x89PNG") else ""
        if not ending:
            raise InputError(
                "packed pictures are JPEG or PNG", where=f"{where}, {message.topic}", value=found.format
            )
        return Picture(stamp, data, ending)
    return Picture(stamp, _png(found, f"{where}, {message.topic}"), ".png")


def decode_wrench(message: Message, where: Path) -> WrenchReading:
    """A wrench. Raises InputError for another type, and for numbers that no sensor gives."""
    found = _decoded(message, (WRENCH,), where)
    force, torque = (
        np.array([part.x, part.y, part.z], float) for part in (found.wrench.force, found.wrench.torque)
    )
    for values in (force, torque):
        check_numbers(values, what="a component of the wrench", where=f"{where}, {message.topic}")
    return WrenchReading(_stamp(found, message), force, torque)


def decode_transforms(message: Message, where: Path) -> list[tuple[str, str, Floats]]:
    """Of each transform: the frame, its parent, and its unit quaternion (4,) x, y, z, w in it, dimensionless.

    Raises as `decode_wrench`.
    """
    return [
        (
            one.child_frame_id.lstrip("/"),
            one.header.frame_id.lstrip("/"),
            np.array([getattr(one.transform.rotation, axis) for axis in "xyzw"], float),
        )
        for one in _decoded(message, (TRANSFORMS,), where).transforms
    ]


def _decoded(message: Message, kinds: tuple[str, ...], where: Path) -> Any:
    place = f"{where}, {message.topic}"
    if message.kind not in kinds or message.encoding not in ("ros1", "cdr"):
        raise InputError(
            "the topic is of another type",
            where=place,
            value=message.kind,
            remedy="Needed: " + " or ".join(kinds) + ".",
        )
    store = typestore(message.encoding)
    try:
        if message.encoding == "ros1":
            return store.deserialize_ros1(message.data, message.kind)
        return store.deserialize_cdr(message.data, message.kind)
    except Exception as fault:
        raise InputError(
            f"a message is damaged: {' '.join(str(fault).split())[:120]}",
            where=place,
            remedy="Copy the log again.",
        ) from fault


def _stamp(found: Any, message: Message) -> Stamp:
    header = found.header
    return Stamp(header.stamp.sec * 10**9 + header.stamp.nanosec, message.log_ns, str(header.frame_id))


def _png(found: Any, where: str) -> bytes:
    """A raw picture, without loss."""
    if found.encoding not in {*_COLOURS, *_PAIRED}:
        raise InputError(
            "colours of this encoding are not read",
            where=where,
            value=found.encoding,
            remedy="Slopes are read from colours of 8 bits: " + ", ".join((*_COLOURS, *_PAIRED)) + ".",
        )
    channels, blue_first = _COLOURS.get(found.encoding, (2, True))
    check(found.width * found.height, "MAX_PIXELS", what="a picture's pixels", where=where)
    data = np.asarray(found.data, np.uint8)
    if found.step < channels * found.width or len(data) != found.step * found.height or not len(data):
        raise InputError(
            "a picture holds other bytes than its size needs",
            where=where,
            value=f"{found.width} x {found.height}, step {found.step}, {len(data)} bytes",
        )
    rows = data.reshape(found.height, found.step)[:, : channels * found.width]
    picture = rows.reshape(found.height, found.width, channels)[..., :3]
    if found.encoding in _PAIRED:
        if found.width % 2:
            raise InputError("a picture of paired pixels has an odd width", where=where, value=found.width)
        picture = cv2.cvtColor(np.ascontiguousarray(picture), _PAIRED[found.encoding])
    _, packed = cv2.imencode(".png", picture if blue_first else np.ascontiguousarray(picture[..., ::-1]))
    return packed.tobytes()


# Which clock the headers of a topic run on, as far as a log can tell.
#
# The log itself has one clock: when each message was written. A header's time less that is the delay, which is
# small and steady on one clock. It is large where a device counts from when it was switched on.

MAX_DELAY_S = 0.5  # s: pictures reach a log within some tenths of a second; another clock is off by far more


class Clock(StrEnum):
    """Whose time is taken: that in the headers, or the log's own."""

    HEADER = "header"
    LOG = "log"


def check_clock(stamps: Sequence[Stamp], where: str) -> float:
    """Median of header less log time, s, of one topic.

    Raises InputError where headers hold no time, and where their clock was set anew within the log.
    """
    if any(one.header_ns == 0 for one in stamps):
        raise InputError("a header holds no time", where=where, remedy="Take the log's own with --clock log.")
    ahead_s = np.array([one.header_ns - one.log_ns for one in stamps]) * 1e-9
    middle = float(np.median(ahead_s))
    off = np.flatnonzero(np.abs(ahead_s - middle) > MAX_DELAY_S)
    if off.size > 1 or (off.size and len(stamps) < 3):
        raise InputError(
            "the headers' clock was set anew within the log",
            where=f"{where}, message {off[0] + 1}",
            value=f"{ahead_s[off[0]] - middle:+.3f} s",
            remedy="Cut the log there, or take its own time with --clock log.",
        )
    return middle


def check_same_clock(frames_s: float, wrench_s: float, *, where: object) -> None:
    """Raise InputError where two topics' headers, this far ahead of the log in s, run on two clocks."""
    if abs(frames_s - wrench_s) > MAX_DELAY_S:
        raise InputError(
            "frames and wrench are on two clocks",
            where=where,
            value=f"headers are {frames_s:+.3f} s and {wrench_s:+.3f} s from the log's time",
            remedy="Take the log's own time with --clock log.",
        )


def times_s(stamps: Sequence[Stamp], clock: Clock, *, origin_ns: int) -> Floats:
    """Times (n,) in s after `origin_ns`, on the clock that was chosen."""
    return np.array([_time_ns(one, clock) - origin_ns for one in stamps], dtype=float) * 1e-9


def first_ns(stamps: Sequence[Stamp], clock: Clock) -> int:
    """The earliest time, ns, down to a whole second."""
    return min(_time_ns(one, clock) for one in stamps) // 10**9 * 10**9


def _time_ns(stamp: Stamp, clock: Clock) -> int:
    return stamp.log_ns if clock is Clock.LOG else stamp.header_ns


# How one frame of reference is turned against another, out of a log's transforms that never change.
#
# A message of /tf or /tf_static says how a frame lies in its parent: v_parent = R v_child, R of a unit quaternion.
# Frames whose R changes within the log are joints that moved; no way leads through them. Joints that stood still
# all along count as fixed: their wrench was turned so in that log.

TOPICS = ("/tf", "/tf_static")
FIXED_RAD = 2e-3  # a joint that stands still is read to a tenth of a degree; this is less than a force's noise
UNIT = 1e-3  # by which a quaternion's length may miss 1: those of 32 bits miss it by less


@dataclass(slots=True)
class _Tree:
    parents: dict[str, tuple[str, Rotation]] = field(default_factory=dict)
    moving: set[str] = field(default_factory=set)

    def add(self, child: str, parent: str, turn: Rotation) -> None:
        known = self.parents.setdefault(child, (parent, turn))
        if known[0] != parent or (known[1].inv() * turn).magnitude() > FIXED_RAD:
            self.moving.add(child)

    def way_up(self, frame: str) -> dict[str, Rotation]:
        """How `frame` is turned in each frame that it is fixed to, itself the first."""
        ways = {frame: Rotation.identity()}
        while frame in self.parents and frame not in self.moving:
            turned, (frame, turn) = ways[frame], self.parents[frame]
            if frame in ways:
                break
            ways[frame] = turn * turned
        return ways


def fixed_rotation(log: Log, of: str, into: str) -> Floats | None:
    """R (3, 3), dimensionless, with v_into = R v_of; None where no fixed way leads from one frame to the other.

    Raises InputError where a quaternion is none.
    """
    tree = _Tree()
    for message in log.messages(TOPICS):
        for child, parent, quaternion in decode_transforms(message, log.path):
            if not abs(float(np.linalg.norm(quaternion)) - 1.0) < UNIT:
                where = f"{log.path}, {message.topic}"
                raise InputError(
                    f"the transform of {child!r} is no rotation", where=where, value=quaternion.tolist()
                )
            tree.add(child, parent, Rotation.from_quat(quaternion))
    theirs, ours = tree.way_up(_bare(of)), tree.way_up(_bare(into))
    shared = next((frame for frame in theirs if frame in ours), None)
    return None if shared is None else np.asarray((ours[shared].inv() * theirs[shared]).as_matrix())


def _bare(frame: str) -> str:
    """ROS 1 began names with a slash; transforms have none."""
    return frame.lstrip("/")
