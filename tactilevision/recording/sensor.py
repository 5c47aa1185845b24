"""The sensor as recording.toml describes it: a registered one with changes, or a custom one."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError, RecordingError, found_in
from tactilevision.files.arrays import read_arrays
from tactilevision.files.opening import check_numbers, inside
from tactilevision.recording.layout import nearest
from tactilevision.records.rig import Gel, GelLayer, Sensor
from tactilevision.sensors import SENSORS, get_sensor

if TYPE_CHECKING:
    from tactilevision.recording.settings import GelSettings, SensorSettings

Maps = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
Size = tuple[int, int]


def build_sensor(
    settings: SensorSettings, toml: Path, *, frame_size_px: Size | None
) -> tuple[Sensor, tuple[str, ...]]:
    """Build the sensor; return it and warnings.

    `frame_size_px` (width, height) is that of the pictures, None without any: then a custom sensor may lack its
    size and scale (0 and NaN).
    Raises RecordingError for an unknown kind, missing or contradictory sizes, and unreadable maps.
    """
    if settings.kind is None and frame_size_px is not None:
        raise RecordingError(
            "[sensor] kind is missing", where=toml, remedy=f'State one of {", ".join(SENSORS)}, or "custom".'
        )
    maps = (
        None
        if settings.rectification is None
        else read_maps(inside(toml.parent, settings.rectification, where=toml))
    )
    straight = (maps[0].shape[1], maps[0].shape[0]) if maps else frame_size_px
    width_px, height_px = _stated_size(settings, straight, toml) or (None, None)
    given: dict[str, Any] = {
        "serial": settings.serial,
        "gel": _gel(settings.gel, toml),
        "rectification": maps,
        "has_markers": settings.has_markers,
        "mm_per_px": None if settings.mm_per_px is None else tuple(settings.mm_per_px),
        "width_px": width_px,
        "height_px": height_px,
    }
    given = {name: value for name, value in given.items() if value is not None}
    doubts = _doubts_of_maps(maps, frame_size_px) if maps and frame_size_px else ()
    if settings.kind is None or settings.kind == "custom":
        return _custom(given, settings, toml, frame_size_px), doubts
    sensor, warnings = _named(given, settings, toml, frame_size_px)
    return sensor, warnings + doubts


def _custom(given: dict[str, Any], settings: SensorSettings, toml: Path, frame_size_px: Size | None) -> Sensor:
    missing = [name for name in ("mm_per_px", "width_px", "height_px") if getattr(settings, name) is None]
    if missing and frame_size_px is not None:
        raise RecordingError(
            f"[sensor] {missing[0]} is missing; a custom sensor needs it to read the frames",
            where=toml,
            remedy="State it for the rectified frame, or name a sensor: " + ", ".join(SENSORS) + ".",
        )
    unknown: dict[str, Any] = {"kind": "custom", "width_px": 0, "height_px": 0, "mm_per_px": (np.nan, np.nan)}
    return Sensor(**(unknown | given))


def _named(
    given: dict[str, Any], settings: SensorSettings, toml: Path, frame_size_px: Size | None
) -> tuple[Sensor, tuple[str, ...]]:
    assert settings.kind is not None
    if settings.kind not in SENSORS:
        near = nearest(settings.kind, SENSORS)
        known = ", ".join(sorted({*SENSORS, "custom"}))
        raise RecordingError(
            "[sensor] kind names no known sensor",
            where=toml,
            value=settings.kind,
            remedy=(f"Did you mean {near}? " if near else "") + f"Known are {known}.",
        )
    usual = get_sensor(settings.kind)
    sensor = get_sensor(settings.kind, **given)
    if frame_size_px is None:
        return sensor, ()
    warnings = []
    if settings.rectification is None and sensor.rectification is None:
        warnings.append(
            "guessed: frames are rectified already; if not, give a TOML file with [sensor] rectification"
            if toml.name == "--sensor"
            else f"{toml.name}: [sensor] rectification is missing: frames are taken as rectified already"
        )
    straight = sensor.rectification[0].shape[::-1] if sensor.rectification else frame_size_px
    if straight != (usual.width_px, usual.height_px) and settings.mm_per_px is None:
        raise RecordingError(
            f"frames of {settings.kind} are {_by(straight)} here, not {_by((usual.width_px, usual.height_px))}, "
            "so its usual scale does not apply",
            where=toml,
            remedy="State mm_per_px in [sensor], or --mm-per-px if the command has it.",
        )
    return dataclasses.replace(sensor, width_px=straight[0], height_px=straight[1]), tuple(warnings)


def read_maps(path: Path) -> Maps:
    """Read map_x, map_y (height, width) float32 of a rectification: rectified[y, x] = raw[map_y, map_x]."""
    try:
        arrays = read_arrays(path)
    except (OSError, InputError) as fault:
        said = fault.what if isinstance(fault, InputError) else fault.strerror or fault
        remedy = "Save it in the folder of recording.toml with numpy.savez(path, map_x=..., map_y=...)."
        raise RecordingError(f"the rectification cannot be read: {said}", where=path, remedy=remedy) from fault
    return maps_of(arrays, path)


def maps_of(arrays: Mapping[str, npt.NDArray[Any]], path: Path) -> Maps:
    """Return map_x, map_y (height, width) float32, px, of the arrays of a rectification; `path` is their file.

    Raises RecordingError for other arrays.
    """
    missing = [name for name in ("map_x", "map_y") if name not in arrays]
    if missing:
        raise RecordingError(f"{missing[0]} is missing; there are {', '.join(arrays)}", where=path)
    if any(arrays[name].dtype.kind not in "fiu" for name in ("map_x", "map_y")):
        raise RecordingError("the rectification cannot be read: map_x and map_y are numbers", where=path)
    for name in ("map_x", "map_y"):
        check_numbers(arrays[name], what=f"a number of {name}", where=path)
    maps = (arrays["map_x"].astype(np.float32), arrays["map_y"].astype(np.float32))
    if maps[0].ndim != 2 or maps[0].shape != maps[1].shape or not maps[0].size:
        raise RecordingError(
            "map_x and map_y have the same shape (height, width)",
            where=path,
            value=(maps[0].shape, maps[1].shape),
        )
    return maps


def _doubts_of_maps(maps: Maps, frame_size_px: Size) -> tuple[str, ...]:
    """Return a warning if maps look past the picture: of another camera, or with x and y exchanged."""
    inside = [(axis >= -0.5) & (axis <= size - 0.5) for axis, size in zip(maps, frame_size_px, strict=True)]
    share = 1 - float(np.mean(inside[0] & inside[1]))
    if share < 0.5:
        return ()
    return (
        f"the rectification looks past the frames for {100 * share:.0f} % of its pixels: "
        "are map_x and map_y exchanged?",
    )


def _stated_size(settings: SensorSettings, straight: Size | None, toml: Path) -> Size | None:
    """Return width and height as far as known; raise if what is stated differs from what was found."""
    stated = (settings.width_px, settings.height_px)
    if straight is not None:
        for name, said, found in zip(("width_px", "height_px"), stated, straight, strict=True):
            if said is not None and said != found:
                found_in = "the rectification has" if settings.rectification else "the frames have"
                raise RecordingError(
                    f"[sensor] {name} = {said}, but {found_in} {found}",
                    where=toml,
                    remedy="It is the size of the rectified frame.",
                )
        return straight
    return (stated[0], stated[1]) if stated[0] is not None and stated[1] is not None else None


def _gel(settings: GelSettings | None, toml: Path) -> Gel | None:
    if settings is None:
        return None
    found = settings.model_dump(include=set(Gel.__dataclass_fields__))
    guess = "disc" if settings.radius_mm else "rectangle" if settings.size_mm else "unbounded"
    found["shape"] = settings.shape or ("mesh" if settings.mesh else guess)
    for pair in ("size_mm", "curvature_mm", "thickness_ends_mm"):
        found[pair] = None if found[pair] is None else tuple(found[pair])
    found["layers"] = tuple(GelLayer(**one.model_dump()) for one in settings.layers)
    if settings.mesh is not None:
        found["mesh"] = str(inside(toml.parent, settings.mesh, where=toml))
    with found_in(toml, "[sensor.gel]"):
        return Gel(**found)


def _by(size: tuple[int, ...]) -> str:
    return f"{size[0]} x {size[1]}"
