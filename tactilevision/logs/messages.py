"""Pictures and wrenches out of the bytes of ROS messages, ROS 1 or CDR."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tactilevision.door.limits import check
from tactilevision.door.numbers import check_numbers
from tactilevision.door.pictures import check_picture
from tactilevision.errors import InputError
from tactilevision.logs.library import library
from tactilevision.logs.log import Message
from tactilevision.records import Floats

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
