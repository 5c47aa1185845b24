"""Settings of recording.toml: keys, units, bounds, and how the file is read."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args, get_origin

from pydantic import (
    AfterValidator,
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from tactilevision.errors import InputError, RecordingError
from tactilevision.files.documents import parse_toml, read_text
from tactilevision.files.opening import is_plain, limit
from tactilevision.recording import layout
from tactilevision.recording.layout import nearest
from tactilevision.recording.units import same_quantity, scaled, with_own_unit
from tactilevision.records.constants import Z95
from tactilevision.records.ranges import SCALE
from tactilevision.records.rig import Shape, missing_size

# Keys of recording.toml, with units and bounds.

LAST_NS = 2**62  # ns since 1970: far beyond any date of a log


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("must be a finite number")
    if abs(value) > limit("MAX_NUMBER"):
        raise ValueError(f"must be below {limit('MAX_NUMBER'):g}")
    return value


def _pair(value: Any) -> Any:
    """Repeat one number for x and y."""
    return [value, value] if isinstance(value, int | float) and not isinstance(value, bool) else value


def _day(value: Any) -> Any:
    if isinstance(value, datetime.datetime):
        return value.date()
    try:
        return datetime.date.fromisoformat(value) if isinstance(value, str) else value
    except ValueError:
        raise ValueError("must be a date such as 2026-11-21") from None


def _ball(value: Any) -> Any:
    return "sphere" if value == "ball" else value


def _one_line(value: str) -> str:
    if not is_plain(value):
        raise ValueError("must be one line without control characters")
    return value


Text = Annotated[str, AfterValidator(_one_line)]
MAX_SIDE = 1_000_000  # px in a row of a picture
Number = Annotated[float, AfterValidator(_finite)]
Positive = Annotated[float, AfterValidator(_finite), Field(gt=0)]
NotNegative = Annotated[float, AfterValidator(_finite), Field(ge=0)]
Poisson = Annotated[float, AfterValidator(_finite), Field(ge=0, le=0.5)]
Two = Annotated[list[Positive], BeforeValidator(_pair), Field(min_length=2, max_length=2)]
Scale = Annotated[float, AfterValidator(_finite), Field(ge=SCALE[0], le=SCALE[1])]
Scales = Annotated[list[Scale], BeforeValidator(_pair), Field(min_length=2, max_length=2)]
Three = Annotated[list[NotNegative], Field(min_length=3, max_length=3)]
Row = Annotated[list[Number], Field(min_length=3, max_length=3)]


class _Settings(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, frozen=True)


def _halved(table: _Settings) -> str:
    """Return what a missing radius would be, if the table states a diameter."""
    stated = (table.model_extra or {}).get("diameter_mm")
    return f", half of its diameter_mm = {stated}" if isinstance(stated, int | float) else ""


class LayerSettings(_Settings):
    """[[sensor.gel.layers]]"""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    thickness_mm: Positive
    modulus_ratio: Positive = 1.0
    poisson_ratio: Poisson | None = None


class GelSettings(_Settings):
    """[sensor.gel]"""

    thickness_mm: Positive
    thickness_std_mm: NotNegative = 0.0
    shape: Shape | None = None
    radius_mm: Positive | None = None
    size_mm: Two | None = None
    poisson_ratio: Poisson | None = None
    poisson_ratio_std: NotNegative | None = None
    youngs_modulus_MPa: Positive | None = None
    youngs_modulus_std_MPa: NotNegative | None = Field(
        default=None, validation_alias=AliasChoices("youngs_modulus_std_MPa", "youngs_modulus_MPa_std")
    )

    curvature_mm: Two | None = None
    base: Literal["curved", "flat"] = "curved"
    axis: Literal["x", "y"] = "y"
    thickness_ends_mm: Two | None = None
    layers: list[LayerSettings] = Field(default_factory=list)
    mesh: Text | None = None
    mesh_unit: Literal["mm", "m", "inch"] = "mm"
    seen: Text = "seen"
    bonded: Text = "bonded"
    camera_mm: Positive | None = None

    @model_validator(mode="after")
    def _outline(self) -> Self:
        if self.shape == "disc" and self.radius_mm is None:
            raise ValueError(f'shape = "disc" needs radius_mm{_halved(self)}')
        if self.shape == "rectangle" and self.size_mm is None:
            raise ValueError('shape = "rectangle" needs size_mm = [x, y]')
        if lacking := missing_size(self):
            raise ValueError(f'shape = "{self.shape}": {lacking}')
        return self


class SensorSettings(_Settings):
    """[sensor]"""

    kind: Text | None = None
    serial: Text = ""
    mm_per_px: Scales | None = None
    width_px: Annotated[int, Field(gt=0, le=MAX_SIDE)] | None = None
    height_px: Annotated[int, Field(gt=0, le=MAX_SIDE)] | None = None
    rectification: str | None = None
    has_markers: bool | None = None
    white_level: Positive | None = None
    gel: GelSettings | None = None


class ForceSettings(_Settings):
    """[force]"""

    std_N: Three | None = None
    rate_Hz: Positive | None = None
    rotation: Annotated[list[Row], Field(min_length=3, max_length=3)] | None = None


class DepthSettings(_Settings):
    """[depth]"""

    source: Literal["vision", "stage", "gauge"] = "vision"
    std_mm: NotNegative | None = None


class ClockSettings(_Settings):
    """[clock]"""

    offset_s: Number | None = None


class LogSettings(_Settings):
    """[log]: source of an imported recording."""

    source: Text = ""
    frames: Text = ""
    wrench: Text | None = None
    clock: Literal["header", "log"] = "header"
    origin_ns: Annotated[int, Field(ge=0, lt=LAST_NS)] = 0


class IndenterSettings(_Settings):
    """[indenter.NAME]"""

    shape: Annotated[Literal["flat_cylinder", "sphere", "cone"], BeforeValidator(_ball)] = "flat_cylinder"
    radius_mm: Positive | None = None
    radius_std_mm: NotNegative = 0.0
    height_mm: Positive | None = None
    height_std_mm: NotNegative = 0.0
    bevel: Literal["right", "left", "top", "bottom"] | None = None
    bevel_distance_mm: Positive | None = None
    bevel_angle_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    edge_radius_mm: NotNegative | None = None
    half_angle_deg: Annotated[float, Field(gt=0, lt=90)] | None = None

    @model_validator(mode="after")
    def _size(self) -> Self:
        if self.shape != "cone" and self.radius_mm is None:
            raise ValueError(f'shape = "{self.shape}" needs radius_mm{_halved(self)}')
        return self


class Settings(_Settings):
    """The whole file."""

    format: int
    name: Text = ""
    date: Annotated[datetime.date, BeforeValidator(_day)] | None = None
    sensor: SensorSettings = SensorSettings()
    force: ForceSettings = ForceSettings()
    depth: DepthSettings = DepthSettings()
    clock: ClockSettings = ClockSettings()
    log: LogSettings = LogSettings()
    indenter: dict[str, IndenterSettings] = {}


# Checking recording.toml.

_Place = tuple[str | int, ...]

_TABLES: dict[str, type[BaseModel]] = {
    "[sensor.gel]": GelSettings,
    "[sensor]": SensorSettings,
    "[indenter.NAME]": IndenterSettings,
}

_TWICE = (  # two keys of one quantity, and how many times the second one the first is
    ("diameter_mm", "radius_mm", 2.0),
    ("youngs_modulus_MPa_std", "youngs_modulus_std_MPa", 1.0),
)
_WIDER = 1.1  # of an interval over that of its std: more than rounding

_PLAUSIBLE = (  # key, least and most plausible value, probable unit of a larger one
    (("sensor", "gel", "thickness_mm"), 0.05, 50, "micrometres"),
    (("sensor", "gel", "radius_mm"), 0.5, 500, "micrometres"),
    (("sensor", "gel", "youngs_modulus_MPa"), 1e-3, 50, "kPa or Pa"),
    (("sensor", "mm_per_px"), 1e-3, 1, "pixels per mm"),
    (("indenter", "*", "radius_mm"), 0.02, 100, "micrometres"),
    (("indenter", "*", "height_mm"), 1e-3, 20, "micrometres"),
    (("force", "std_N"), 0, 5, "mN"),
    (("depth", "std_mm"), 0, 1, "micrometres"),
)


def load_toml(path: Path) -> dict[str, Any]:
    """Read the file. Raises RecordingError with the line if it is not TOML, or beyond the limits."""
    try:
        return parse_toml(read_text(path), where=path)
    except OSError as fault:
        raise RecordingError(f"cannot be read: {fault.strerror}", where=path) from fault
    except InputError as fault:
        raise RecordingError(fault.what, where=fault.where, value=fault.value, remedy=fault.remedy) from fault


def check_settings(content: dict[str, Any], path: Path) -> tuple[Settings, dict[str, Any], tuple[str, ...]]:
    """Check the settings; return them, the content in the format's units, and warnings.

    A warning names each key of another unit, each without a meaning, and each implausible value.

    Raises RecordingError for an unknown format, for a key that resembles an absent known one (a slip, or a missing
    unit), and for impossible values.
    """
    _check_format(content, path)
    news: list[str] = []
    unknown: list[tuple[_Place, Any, str]] = []
    content = _in_format(Settings, content, (), path=path, news=news, unknown=unknown)
    for place, value, meant in unknown:
        if meant:
            found = None if isinstance(value, dict) else value
            units = " Units are part of the name." if "_" in meant else ""
            remedy = f"Did you mean {with_own_unit(str(place[-1]), meant)}?{units}"
            raise RecordingError(f"{_key(place)} is not known", where=path, value=found, remedy=remedy)
    _check_twice(content, (), path)
    try:
        settings = Settings.model_validate(content)
    except ValidationError as fault:
        raise _translated(fault, path) from None
    for place, _, _ in unknown:
        homes = [table for table, model in _TABLES.items() if place[-1] in model.model_fields]
        home = f"; it has one in {homes[0]}" if homes else " and is ignored"
        news.append(f"{path.name}: {_key(place)} has no meaning here{home}")
    return settings, content, (*news, *_implausible(content, path))


def check_sensor(content: dict[str, Any], path: Path) -> tuple[SensorSettings, tuple[str, ...]]:
    """Check the table [sensor] alone, of a recording.toml or of a file that holds nothing else; warnings likewise.

    Raises RecordingError as `check_settings` does, and where there is no such table.
    """
    if "sensor" not in content:
        raise RecordingError("the table [sensor] is missing", where=path, remedy="Put kind = ... under [sensor].")
    alone = {"format": layout.FORMAT, "sensor": content["sensor"]}
    settings, _, warnings = check_settings(alone, path)
    return settings.sensor, warnings


def _check_format(content: Mapping[str, Any], path: Path) -> None:
    if "format" not in content:
        near = nearest("format", [key for key, value in content.items() if isinstance(value, int | str)])
        remedy = f"Put format = {layout.FORMAT} on its first line."
        raise RecordingError("the number of the format is missing", where=path, value=near or None, remedy=remedy)
    if content["format"] is True or content["format"] != layout.FORMAT:
        what = f"this version reads format = {layout.FORMAT} only"
        remedy = "Take a newer version of tactilevision, or convert the recording."
        raise RecordingError(what, where=path, value=content["format"], remedy=remedy)


def _check_twice(table: Mapping[str, Any], place: _Place, path: Path) -> None:
    """Raise RecordingError for a quantity with two different values, or a std too small for its interval."""
    numbers = {key: value for key, value in table.items() if isinstance(value, int | float)}
    for one, other, times in _TWICE:
        if {one, other} <= set(numbers) and not math.isclose(numbers[one], times * numbers[other]):
            what = f"{_key((*place, one))} contradicts {other} = {numbers[other]:g}"
            raise RecordingError(what, where=path, value=numbers[one], remedy="State it once.")
    for key, value in table.items():
        if isinstance(value, dict):
            _check_twice(value, (*place, key), path)
        name = key.removesuffix("_interval95")
        std = next((n for n in numbers if "_std" in n and n.replace("_std", "") == name), None)
        ends = value if isinstance(value, list) and len(value) == 2 and _are_numbers(value) else None
        if name == key or std is None or ends is None:
            continue
        if ends[1] - ends[0] > _WIDER * 2 * Z95 * numbers[std]:
            what = f"{_key((*place, std))} is narrower than {key} = {value}"
            remedy = f"A std is the interval's length over {2 * Z95:g}; state it alone."
            raise RecordingError(what, where=path, value=numbers[std], remedy=remedy)


def _in_format(
    model: type[BaseModel],
    content: Mapping[str, Any],
    place: _Place,
    *,
    path: Path,
    news: list[str],
    unknown: list[tuple[_Place, Any, str]],
) -> dict[str, Any]:
    """Return the content with keys of another unit as the format names them; `news` gains a sentence for each.

    `unknown` gains each unknown key's place, its value, and the absent known key that it resembles, or "".
    """
    known = {name: name for name in model.model_fields}
    for name, about in model.model_fields.items():
        known |= {str(alias): name for alias in getattr(about.validation_alias, "choices", ())}
    made: dict[str, Any] = {}
    for key, value in content.items():
        found = None if key in known else same_quantity(key, model.model_fields)
        if found is None or not _are_numbers(value):
            made[key] = value
            continue
        name, factor = found
        if name in content or name in made:
            what = f"{_key((*place, key))} states what {name} states too"
            raise RecordingError(what, where=path, value=value, remedy="Keep one of them.")
        made[name] = [scaled(one, factor) for one in value] if isinstance(value, list) else scaled(value, factor)
        news.append(f"{path.name}: {_key((*place, key))} is read as {name} = {made[name]}")
    absent = [name for name in model.model_fields if name not in made]
    for key, value in made.items():
        if key not in known:
            unknown.append(((*place, key), value, nearest(key, absent)))
            continue
        annotation = model.model_fields[known[key]].annotation
        table = _table_of(annotation)
        if table is None or not isinstance(value, dict):
            continue
        inner = partial(_in_format, table, path=path, news=news, unknown=unknown)
        if get_origin(annotation) is dict:
            tables = {name: one for name, one in value.items() if isinstance(one, dict)}
            made[key] = value | {name: inner(one, (*place, key, name)) for name, one in tables.items()}
        else:
            made[key] = inner(value, (*place, key))
    return made


def _are_numbers(value: Any) -> bool:
    listed = value if isinstance(value, list) else [value]
    return all(isinstance(one, int | float) and not isinstance(one, bool) for one in listed)


def _table_of(annotation: Any) -> type[BaseModel] | None:
    """Return the table that a key opens, also where it is optional or one of many; None for a plain value."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in get_args(annotation) if (found := _table_of(part))), None)


_WORDS = {  # pydantic's kinds of findings: message and remedy
    "missing": ("is missing", "Add it."),
    "greater_than": ("must be above {gt:g}", ""),
    "greater_than_equal": ("must be at least {ge:g}", ""),
    "less_than": ("must be below {lt:g}", ""),
    "less_than_equal": ("must be at most {le:g}", ""),
    "float_type": ("must be a number", "Write the number alone: its unit is in the name."),
    "int_type": ("must be a whole number", "Write the number alone: its unit is in the name."),
    "int_from_float": ("must be a whole number", ""),
    "string_type": ("must be text", "Put it in quotes."),
    "bool_type": ("must be true or false", "Write it without quotes."),
    "literal_error": ("must be {expected}", ""),
    "extra_forbidden": ("is not known", "Known are thickness_mm, modulus_ratio and poisson_ratio."),
    "list_type": ("must be a list such as [1.0, 2.0]", ""),
    "too_short": ("must hold {min_length} values", ""),
    "too_long": ("must hold {max_length} values", ""),
    "model_type": ("must be a table", "Open it with its name in [brackets]."),
    "dict_type": ("must be a table", "Open it with its name in [brackets]."),
    "date_type": ("must be a date such as 2026-11-21", ""),
    "value_error": ("{error}", ""),
}


def _translated(fault: ValidationError, path: Path) -> RecordingError:
    """Translate pydantic's first finding into an error of this library."""
    first = fault.errors()[0]
    kind, place = first["type"], first["loc"]
    what, remedy = _WORDS.get(kind, (first["msg"].replace("{", "("), ""))
    found = None if kind == "missing" or isinstance(first["input"], dict) else first["input"]
    # a finding about several keys has the table as its place
    whole = kind == "value_error" and isinstance(first["input"], dict)
    key = f"[{'.'.join(map(str, place))}]" if whole else _key(place)
    return RecordingError(f"{key} {what.format(**first.get('ctx', {}))}", where=path, value=found, remedy=remedy)


def _key(place: _Place) -> str:
    """Return a key as it is found in the file: [table.of.it] key, or key[index] in a list."""
    names = [part for part in place if isinstance(part, str)]
    index = "".join(f"[{part}]" for part in place if isinstance(part, int))
    return f"[{'.'.join(names[:-1])}] {names[-1]}{index}" if len(names) > 1 else f"{names[0]}{index}"


def _implausible(content: Mapping[str, Any], path: Path) -> Iterator[str]:
    for place, least, most, looks_like in _PLAUSIBLE:
        for found, value in _values(content, place, ()):
            if value > most:
                yield f"{path.name}: {_key(found)} = {value:g} is very large: is it in {looks_like}?"
            elif 0 < value < least:
                yield f"{path.name}: {_key(found)} = {value:g} is very small: is it in metres, or the inverse?"


def _values(content: Any, place: tuple[str, ...], found: _Place) -> Iterator[tuple[_Place, float]]:
    if not place:
        for value in content if isinstance(content, list) else [content]:
            if isinstance(value, int | float):
                yield found, value
    elif isinstance(content, dict):
        for key in content if place[0] == "*" else [place[0]]:
            if key in content:
                yield from _values(content[key], place[1:], (*found, key))
