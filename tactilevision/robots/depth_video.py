"""Depth maps as LeRobot keeps them from 0.6 on: 12-bit codes, linear in metres, in a lossless HEVC video.

    code = round(4095 depth / depth_max),    0 <= depth <= depth_max

Keys of `info` are those of LeRobot's DepthEncoderConfig (pull request 3644 of huggingface/lerobot). Its defaults,
.01 to 10 m on a logarithmic scale, would store a gel's depth as one code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.writing import replacing
from tactilevision.records.constants import MICRO, MILLI
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Sensor
from tactilevision.robots.logs import library

CODES = 4095  # the greatest code of 12 bits
COARSEST_MM = MILLI  # mm: no step between two codes is larger
LOSSLESS = {"x265-params": "lossless=1"}
FORMAT = "gray12le"
Put = Callable[
    [Floats], Floats
]  # adds a map (H, W) in mm, and returns it as it is stored, NaN where that is not valid


def depth_range_mm(sensor: Sensor) -> float:
    """Return the depth of the greatest code in mm: the gel's thickness, or 4.095 where that is more.

    Steps are thus at most 1 um. Raises InputError for a sensor without a stated gel.
    """
    if sensor.gel is None:
        raise InputError(
            "native depth ranges from 0 to the gel's thickness, which the profile does not state",
            where=f"{sensor.kind} {sensor.serial}".rstrip(),
            remedy="State thickness_mm under [sensor.gel] and calibrate again, or use --depth table.",
        )
    return min(sensor.gel.thickness_mm, CODES * COARSEST_MM)


@dataclass(frozen=True, slots=True)
class DepthVideo:
    """Size (height, width) in pixels, rate, and depth of the greatest code of a video of depth.

    Gel that bulges, of negative depth, has code 0, as has depth that is unknown or beyond the range.
    """

    size: tuple[int, int]
    rate_Hz: float
    range_mm: float

    @property
    def info(self) -> dict[str, Any]:
        """Return LeRobot's description of the video; depths are in metres."""
        height, width = self.size
        shape = {"height": height, "width": width, "channels": 1, "fps": round(self.rate_Hz)}
        packing = {"codec": "hevc", "pix_fmt": FORMAT, "g": 2, "extra_options": LOSSLESS}
        scale = {"depth_min": 0.0, "depth_max": self.range_mm * MILLI, "shift": 0.0, "use_log": False}
        video: dict[str, Any] = shape | packing | scale
        about = {"is_depth_map": True, "depth_unit": "m", "has_audio": False}
        return about | {f"video.{name}": value for name, value in video.items()}

    @contextmanager
    def writer(self, path: Path) -> Iterator[Put]:
        """Write a video at `path`, complete or not at all; yield what adds a map to it."""
        av = library("av")
        quiet = LOSSLESS["x265-params"] + ":log-level=none"
        with replacing(path) as temporary, av.open(str(temporary), "w", format="mp4") as box:
            rate = Fraction(self.rate_Hz).limit_denominator(round(1 / MICRO))
            stream = box.add_stream("libx265", rate=rate, options={"g": "2", "x265-params": quiet})
            stream.height, stream.width = self.size
            stream.pix_fmt = FORMAT

            def put(depth_mm: Floats) -> Floats:
                valid = np.isfinite(depth_mm) & (depth_mm <= self.range_mm)
                codes = np.rint(np.clip(np.where(valid, depth_mm, 0.0), 0, None) * (CODES / self.range_mm))
                frame = av.VideoFrame(self.size[1], self.size[0], FORMAT)
                rows = np.frombuffer(frame.planes[0], "<u2").reshape(self.size[0], -1)
                rows[:, : self.size[1]] = codes
                box.mux(stream.encode(frame))
                return np.where(valid, codes * (self.range_mm / CODES), np.nan)

            yield put
            box.mux(stream.encode())
