"""What a stream sees for Foxglove: over its websocket on this machine, and as an MCAP file. Extra `foxglove`.

Topics: /picture the rectified frame (RawImage), /depth the map and /tractions the forces as grids (Grid; places
on the pad from its centre, in metres; MPa), /wrench and /state as JSON. Times are this machine's, since 1970.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from tactilevision.camera.loop import Told
from tactilevision.errors import InputError, OutputError
from tactilevision.files import told_as_output, unfinished
from tactilevision.reconstruct import Reconstructor
from tactilevision.records import Floats, Pair
from tactilevision.sensors import rectify

PAD = "pad"  # frame of reference of everything
MM = 1e-3  # metres: Foxglove's unit of length
PORT = 8765  # where Foxglove looks for a server
_NUMBERS = {"type": "array", "items": {"type": ["number", "null"]}}
_WRENCH = {
    "type": "object",
    "properties": dict.fromkeys(("force_N", "force_std_N", "moment_Nmm", "moment_std_Nmm"), _NUMBERS),
}
_STATE = {
    "type": "object",
    "properties": {
        "contact": {"type": "boolean"},
        "peak_mm": {"type": "number"},
        "age_ms": {"type": "number"},
        "rate_Hz": {"type": "number"},
        "flags": {"type": "array", "items": {"type": "string"}},
    },
}


def check_installed() -> None:
    """Raise InputError where the extra is missing."""
    try:
        import_module("foxglove")
    except ImportError as fault:
        raise InputError(
            "the package foxglove-sdk is missing",
            where="--foxglove and --mcap",
            remedy="Install it: pip install 'tactilevision[foxglove]'.",
        ) from fault


class Foxglove:
    """Open while frames come; `show` hands it each moment.

    `serve`: on PORT of this machine. `mcap`: the file, which has its name once it is whole, also where the stream
    ended by a fault. Raises InputError where the extra is missing, OutputError where the disk refuses.
    """

    def __init__(self, reconstructor: Reconstructor, *, serve: bool = False, mcap: Path | None = None) -> None:
        self.reconstructor, self.mcap = reconstructor, mcap
        check_installed()
        import foxglove
        from foxglove import channels

        self._context = foxglove.Context()
        self._picture = channels.RawImageChannel("/picture", context=self._context)
        self._depth = channels.GridChannel("/depth", context=self._context)
        self._tractions = channels.GridChannel("/tractions", context=self._context)
        self._wrench = foxglove.Channel("/wrench", schema=_WRENCH, context=self._context)
        self._state = foxglove.Channel("/state", schema=_STATE, context=self._context)
        self._began_ns = time.time_ns() - round(1e9 * time.monotonic())
        self._scratch = None if mcap is None else mcap.with_name(f"{unfinished()}{mcap.name}")
        self._writer, self._server = None, None
        if self._scratch is not None:
            with told_as_output(self._scratch):
                self._scratch.parent.mkdir(parents=True, exist_ok=True)
                self._writer = foxglove.open_mcap(self._scratch, allow_overwrite=True, context=self._context)
        if serve:
            self._server = _served(self._context)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.stop()
        if self._writer is not None and self._scratch is not None and self.mcap is not None:
            try:
                with told_as_output(self.mcap):
                    self._writer.close()
                    self._scratch.replace(self.mcap)
            except (RuntimeError, OutputError) as refused:  # its own kind of error, also for a full disk
                if kind is not None:  # what ended the stream is told, an interrupt above all
                    return
                if isinstance(refused, OutputError):
                    raise
                raise OutputError(
                    f"cannot be written: {refused}",
                    where=self.mcap,
                    remedy="Is the disk full?",
                ) from refused
            finally:
                with suppress(OSError):
                    self._scratch.unlink(missing_ok=True)

    def show(self, told: Told, rate_Hz: float) -> None:
        """Send one moment on all topics."""
        from foxglove.messages import RawImage

        moment, at_ns = told.moment, self._began_ns + round(1e9 * told.shot.time_s)
        stamp = _stamp(at_ns)
        rgb = rectify(self.reconstructor.sensor, told.shot.rgb)
        height, width = rgb.shape[:2]
        size: dict[str, Any] = {"width": width, "height": height, "step": 3 * width}
        data = np.ascontiguousarray(rgb).tobytes()
        picture = RawImage(timestamp=stamp, frame_id=PAD, encoding="rgb8", data=data, **size)
        self._picture.log(picture, log_time=at_ns)
        depth = moment.height
        known = np.where(depth.valid, depth.depth_mm * MM, np.nan)
        self._depth.log(_grid({"elevation": known}, depth.mm_per_px, stamp=stamp), log_time=at_ns)
        state = {"contact": moment.contact, "peak_mm": moment.peak_mm, "age_ms": told.age_ms, "rate_Hz": rate_Hz}
        self._state.log(state | {"flags": list(depth.flags)}, log_time=at_ns)
        found, wrench = moment.tractions, moment.wrench
        if found is None or wrench is None:
            return
        fields = {"t_x": found.t_x, "t_y": found.t_y, "t_z": found.t_z}
        grid = _grid(fields, found.mm_per_px, stamp=stamp, first_mm=found.first_mm)
        self._tractions.log(grid, log_time=at_ns)
        names = ("force_N", "force_std_N", "moment_Nmm", "moment_std_Nmm")
        self._wrench.log({name: _plain(getattr(wrench, name)) for name in names}, log_time=at_ns)


def _served(context: Any) -> Any:
    import foxglove

    try:
        return foxglove.start_server(name="tactilevision", host="127.0.0.1", port=PORT, context=context)
    except (OSError, RuntimeError) as fault:
        raise InputError(
            "Foxglove's port is taken", where="--foxglove", value=PORT, remedy="End the other server."
        ) from fault


def _grid(fields: dict[str, Floats], mm_per_px: Pair, *, stamp: Any, first_mm: Pair | None = None) -> Any:
    """Fields (H, W) as one grid of float32, each cell centred where its number holds."""
    from foxglove.messages import (
        Grid,
        PackedElementField,
        PackedElementFieldNumericType,
        Pose,
        Quaternion,
        Vector2,
        Vector3,
    )

    stacked = np.stack([np.asarray(field, "<f4") for field in fields.values()], axis=-1)
    rows, columns, count = stacked.shape
    sizes = zip((columns, rows), mm_per_px, strict=True)
    first = first_mm or tuple(-(n - 1) / 2 * step for n, step in sizes)
    corner = [MM * (place - step / 2) for place, step in zip(first, mm_per_px, strict=True)]
    return Grid(
        timestamp=stamp,
        frame_id=PAD,
        pose=Pose(
            position=Vector3(x=corner[0], y=corner[1], z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        ),
        column_count=columns,
        cell_size=Vector2(x=MM * mm_per_px[0], y=MM * mm_per_px[1]),
        row_stride=4 * count * columns,
        cell_stride=4 * count,
        fields=[
            PackedElementField(name=name, offset=4 * k, type=PackedElementFieldNumericType.Float32)
            for k, name in enumerate(fields)
        ],
        data=np.ascontiguousarray(stacked).tobytes(),
    )


def _stamp(at_ns: int) -> Any:
    from foxglove.messages import Timestamp

    return Timestamp(sec=at_ns // 10**9, nsec=at_ns % 10**9)


def _plain(values: tuple[float, ...]) -> list[float | None]:
    """JSON has no NaN."""
    return [value if math.isfinite(value) else None for value in values]
