"""Writing a recording: its settings, its maps and pictures, and all of its tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w

from tactilevision.errors import InputError
from tactilevision.files import replacing, write_text
from tactilevision.recording import layout, write_tables as tables
from tactilevision.recording.model import Recording
from tactilevision.records import Bytes, Sensor

MAPS = "maps.npz"


def write_recording(recording: Recording) -> None:
    """Write everything but the pictures into `recording.path`.

    recording.toml comes last: a folder that was left half-way is not taken for a recording. Forces are written
    in the rectified frame's axes, as they are held, so no [force] rotation is written.
    """
    folder = recording.path
    if recording.frame_names:
        tables.write_frame_table(
            folder,
            recording.frame_names,
            times_s=recording.frame_times_s,
            extra=_extra(recording, layout.FRAME_TABLE),
        )
    if recording.forces is not None:
        tables.write_forces(folder, recording.forces, extra=_extra(recording, layout.FORCES))
    if recording.stage is not None:
        tables.write_stage(folder, recording.stage, extra=_extra(recording, layout.STAGE))
    if recording.presses:
        tables.write_presses(folder, recording.presses)
    if recording.curves:
        tables.write_curves(folder, recording.curves)
    if recording.points:
        tables.write_points(folder, recording.points)
    if recording.balls:
        tables.write_balls(folder, recording.balls)
    if recording.sensor.rectification is not None:
        write_maps(folder, recording.sensor)
    write_settings(recording)


def write_settings(recording: Recording) -> None:
    """Write recording.toml from the record; what is not known is left out."""
    std_N = recording.forces.std_N if recording.forces is not None else recording.force_std_N
    content: dict[str, Any] = {
        "format": layout.FORMAT,
        "name": recording.name,
        "date": recording.date,
        "sensor": _sensor(recording),
        "force": {
            "std_N": std_N if std_N is None or np.isfinite(std_N).all() else None,
            "rate_Hz": recording.force_rate_Hz,
        },
        "depth": {"source": recording.depth_source, "std_mm": recording.depth_std_mm},
        "clock": {"offset_s": recording.clock_offset_s},
        "indenter": {name: asdict(one) | {"name": None} for name, one in recording.indenters.items()},
    }
    write_text(recording.path / layout.SETTINGS, tomli_w.dumps(_known(content)))


def write_maps(folder: Path | str, sensor: Sensor) -> None:
    """Write the sensor's rectification beside recording.toml. Raises InputError where it has none."""
    if sensor.rectification is None:
        raise InputError("the sensor has no rectification", where="write_maps", value=sensor.kind)
    map_x, map_y = sensor.rectification
    with replacing(Path(folder) / MAPS) as temporary:
        np.savez_compressed(temporary, map_x=map_x, map_y=map_y)


def write_image(path: Path | str, rgb: Bytes, *, jpeg_quality: int = 95) -> None:
    """Write a picture (H, W, 3) uint8, red, green, blue; the ending of the name chooses the format.

    JPEG keeps the colours at full resolution: photometric stereo reads slopes from them.
    """
    path = Path(path)
    if path.suffix.lower() == ".npy":
        with replacing(path) as temporary:
            np.save(temporary, rgb, allow_pickle=False)
        return
    if path.suffix.lower() not in layout.IMAGE_SUFFIXES:
        raise InputError("pictures are written as " + ", ".join(layout.IMAGE_SUFFIXES), where=path)
    options = []
    if path.suffix.lower() in (".jpg", ".jpeg"):
        full = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
        options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality, *full]
    _, data = cv2.imencode(path.suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


def _extra(recording: Recording, table: str) -> Mapping[str, Any]:
    return recording.extra.get(table, {})


def _sensor(recording: Recording) -> dict[str, Any]:
    sensor = recording.sensor
    custom = sensor.kind == "custom" and sensor.width_px > 0
    return {
        "kind": sensor.kind,
        "serial": sensor.serial or None,
        "mm_per_px": None if np.isnan(sensor.mm_per_px[0]) else list(sensor.mm_per_px),
        "width_px": sensor.width_px if custom else None,
        "height_px": sensor.height_px if custom else None,
        "rectification": None if sensor.rectification is None else MAPS,
        "has_markers": sensor.has_markers or None,
        "white_level": recording.white_level,
        "gel": None if sensor.gel is None else asdict(sensor.gel),
    }


def _known(content: Mapping[str, Any]) -> dict[str, Any]:
    """TOML has no None, and NaN says nothing: both are left out, and tables that they leave empty."""
    kept = {}
    for key, value in content.items():
        inner = _known(value) if isinstance(value, dict) else list(value) if isinstance(value, tuple) else value
        if inner not in (None, {}) and inner == inner:
            kept[key] = inner
    return kept
