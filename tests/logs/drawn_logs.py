"""Logs of a drawn recording: pictures and wrenches on a clock, as each kind of log holds them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.records.measured import Bytes
from tactilevision.robots.log_export import _header, open_writer, wrench_message
from tactilevision.robots.messages import IMAGE, TRANSFORMS, typestore

START_NS = 1_790_000_000 * 10**9 + 123_456_789  # a time of day in 2026
Turns = tuple[tuple[str, str, str, tuple[float, float, float, float]], ...]  # topic, frame, parent, x y z w
Draw = Callable[..., Path]
KINDS = ("log.mcap", "log.bag", "log")


@dataclass(frozen=True)
class Drawn:
    """What is put into a log; shifts are of the headers against the log's time, in s."""

    frames: int = 4
    camera: str = "tool"
    sensor: str = "tool"
    picture_shift_s: float = 0.0
    wrench_shift_s: float = 0.0
    encoding: str = "bgr8"
    turns: Turns = ()


def pictures(count: int) -> Bytes:
    """Pictures (N, 6, 8, 3), red first."""
    return np.random.default_rng(3).integers(0, 255, (count, 6, 8, 3), dtype=np.uint8)


def time_ns(number: int, shift_s: float = 0.0) -> int:
    return START_NS + number * 40_000_000 + round(shift_s * 1e9)


def image(rgb: Bytes, *, at_ns: int, drawn: Drawn, kind: str) -> Any:
    stored = rgb[..., ::-1] if drawn.encoding.startswith("bgr") else rgb
    rows, columns = rgb.shape[:2]
    data = np.frombuffer(np.ascontiguousarray(stored).tobytes(), np.uint8)
    size = {"height": rows, "width": columns, "step": 3 * columns}
    header = _header(at_ns, drawn.camera, kind)
    return typestore(kind).types[IMAGE](header=header, encoding=drawn.encoding, is_bigendian=0, data=data, **size)


def transform(child: str, parent: str, quaternion: tuple[float, ...], *, kind: str) -> Any:
    types = typestore(kind).types
    part = {name: types[f"geometry_msgs/msg/{name}"] for name in ("TransformStamped", "Transform", "Vector3")}
    turn = types["geometry_msgs/msg/Quaternion"](*quaternion)
    move = part["Transform"](translation=part["Vector3"](0.1, 0.2, 0.3), rotation=turn)
    header = _header(START_NS, parent, kind)
    return types[TRANSFORMS](transforms=[part["TransformStamped"](header, child, move)])


def write(path: Path, drawn: Drawn) -> Path:
    with open_writer(path) as (put, kind):
        for topic, child, parent, quaternion in drawn.turns:
            put(topic, transform(child, parent, quaternion, kind=kind), START_NS)
        for number, rgb in enumerate(pictures(drawn.frames)):
            at_ns = time_ns(number)
            picture = image(rgb, at_ns=time_ns(number, drawn.picture_shift_s), drawn=drawn, kind=kind)
            put("/camera", picture, at_ns)
            wrench_ns = time_ns(number, drawn.wrench_shift_s)
            force, moment = np.array([1.0, 2.0, number]), np.array([1000.0, 0.0, 0.0])
            wrench = wrench_message(force, moment, time_ns=wrench_ns, frame_id=drawn.sensor, encoding=kind)
            put("/ft", wrench, at_ns)
    return path


def drawer(folder: Path) -> Draw:
    """draw(name, **changes) writes a log of that name."""
    return lambda name="log.mcap", **changes: write(folder / name, replace(Drawn(), **changes))
