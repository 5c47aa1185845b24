"""Catalogue of sensors, and rectification of raw pictures.

Any other `records.Sensor` works everywhere too. A new one is a file here and a line in SENSORS.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from tactilevision.errors import InputError, check_known
from tactilevision.records.rig import Sensor
from tactilevision.sensors.digit import DIGIT
from tactilevision.sensors.gelsight_mini import GELSIGHT_MINI
from tactilevision.sensors.gelsight_wedge import GELSIGHT_WEDGE
from tactilevision.sensors.gelslim3 import GELSLIM3, GELSLIM3_MARKERS
from tactilevision.sensors.rectification import (
    find_grid,
    maps_from_corners,
    maps_from_grid,
    maps_from_lookup,
    rectify,
    save_rectification,
    sensor_from_corners,
    sensor_from_grid,
)

SENSORS: dict[str, Sensor] = {
    sensor.kind: sensor for sensor in (GELSLIM3, GELSLIM3_MARKERS, GELSIGHT_MINI, DIGIT, GELSIGHT_WEDGE)
}

MIN_SCALE = 1e-4  # mm per pixel: a tenth of a micrometre, below the resolution of light
MAX_SCALE = 100.0  # mm per pixel: a gel in one pixel

__all__ = [
    "MAX_SCALE",
    "MIN_SCALE",
    "SENSORS",
    "check_scale",
    "find_grid",
    "get_sensor",
    "maps_from_corners",
    "maps_from_grid",
    "maps_from_lookup",
    "may_have_marks",
    "rectify",
    "save_rectification",
    "sensor_from_corners",
    "sensor_from_grid",
]


def get_sensor(kind: str, **overrides: Any) -> Sensor:
    """Return the sensor of that name, with fields of `records.Sensor` replaced by `overrides`.

    "custom" has no defaults: width_px, height_px and mm_per_px are then needed. `mm_per_px` may be one number.
    Raises InputError for an unknown name, an unknown or missing field, and sizes or scales not above 0.
    """
    scale = overrides.get("mm_per_px")
    if isinstance(scale, int | float):
        overrides["mm_per_px"] = (float(scale), float(scale))
    unknown = set(overrides) - {field.name for field in dataclasses.fields(Sensor)}
    if unknown:
        raise InputError(
            "a sensor has no such field",
            where="get_sensor",
            value=sorted(unknown),
            remedy="Fields: " + ", ".join(field.name for field in dataclasses.fields(Sensor)) + ".",
        )
    if kind == "custom":
        missing = [name for name in ("width_px", "height_px", "mm_per_px") if name not in overrides]
        if missing:
            raise InputError(f"a custom sensor needs {', '.join(missing)}", where="get_sensor")
        return _checked(Sensor(kind="custom", **overrides))
    check_known(kind, [*SENSORS, "custom"], what="no sensor of that name", where="get_sensor")
    return _checked(dataclasses.replace(SENSORS[kind], **overrides))


def may_have_marks(sensor: Sensor) -> bool:
    """Return whether to look for marks: not if this kind has none by the catalogue."""
    return sensor.has_markers or sensor.kind not in SENSORS


def check_scale(mm_per_px: float, *, where: str) -> None:
    """Raise InputError for a scale below MIN_SCALE, above MAX_SCALE, or not a number."""
    if not MIN_SCALE <= mm_per_px <= MAX_SCALE:
        raise InputError(
            f"a scale lies between {MIN_SCALE:g} and {MAX_SCALE:g} mm per pixel",
            where=where,
            value=mm_per_px,
            remedy="State a length on the gel in mm over its length in the picture in pixels: most are .02 to .1.",
        )


def _checked(sensor: Sensor) -> Sensor:
    if min(sensor.width_px, sensor.height_px) < 2:
        raise InputError(
            "a sensor has 2 px or more each way",
            where=f"sensor {sensor.kind}",
            value=(sensor.width_px, sensor.height_px),
        )
    for scale in sensor.mm_per_px:
        check_scale(scale, where=f"sensor {sensor.kind}")
    return sensor
