"""What recording.toml may say: every key with its unit and its bounds."""

from __future__ import annotations

import datetime
import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from tactilevision.door.limits import limit
from tactilevision.sensors import MAX_SCALE, MIN_SCALE

LAST_NS = 2**62  # ns since 1970: far beyond any date that a log holds


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("must be a finite number")
    if abs(value) > limit("MAX_NUMBER"):
        raise ValueError(f"must be below {limit('MAX_NUMBER'):g}")
    return value


def _pair(value: Any) -> Any:
    """One number stands for x and y alike."""
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


MAX_SIDE = 1_000_000  # px: no camera has as many in a row
Number = Annotated[float, AfterValidator(_finite)]
Positive = Annotated[float, AfterValidator(_finite), Field(gt=0)]
NotNegative = Annotated[float, AfterValidator(_finite), Field(ge=0)]
Poisson = Annotated[float, AfterValidator(_finite), Field(ge=0, le=0.5)]
Two = Annotated[list[Positive], BeforeValidator(_pair), Field(min_length=2, max_length=2)]
Scale = Annotated[float, AfterValidator(_finite), Field(ge=MIN_SCALE, le=MAX_SCALE)]
Scales = Annotated[list[Scale], BeforeValidator(_pair), Field(min_length=2, max_length=2)]
Three = Annotated[list[NotNegative], Field(min_length=3, max_length=3)]
Row = Annotated[list[Number], Field(min_length=3, max_length=3)]


class _Settings(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, frozen=True)


def _halved(table: _Settings) -> str:
    """What a radius that is missing would be, where the table states a diameter."""
    stated = (table.model_extra or {}).get("diameter_mm")
    return f", half of its diameter_mm = {stated}" if isinstance(stated, int | float) else ""


class GelSettings(_Settings):
    """[sensor.gel]"""

    thickness_mm: Positive
    thickness_std_mm: NotNegative = 0.0
    shape: Literal["disc", "rectangle", "unbounded"] | None = None
    radius_mm: Positive | None = None
    size_mm: Two | None = None
    poisson_ratio: Poisson | None = None
    poisson_ratio_std: NotNegative | None = None
    youngs_modulus_MPa: Positive | None = None
    youngs_modulus_std_MPa: NotNegative | None = Field(
        default=None, validation_alias=AliasChoices("youngs_modulus_std_MPa", "youngs_modulus_MPa_std")
    )

    @model_validator(mode="after")
    def _outline(self) -> Self:
        if self.shape == "disc" and self.radius_mm is None:
            raise ValueError(f'shape = "disc" needs radius_mm{_halved(self)}')
        if self.shape == "rectangle" and self.size_mm is None:
            raise ValueError('shape = "rectangle" needs size_mm = [x, y]')
        return self


class SensorSettings(_Settings):
    """[sensor]"""

    kind: str | None = None
    serial: str = ""
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
    """[log]: where an imported recording came from."""

    source: str = ""
    frames: str = ""
    wrench: str | None = None
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
    name: str = ""
    date: Annotated[datetime.date, BeforeValidator(_day)] | None = None
    sensor: SensorSettings = SensorSettings()
    force: ForceSettings = ForceSettings()
    depth: DepthSettings = DepthSettings()
    clock: ClockSettings = ClockSettings()
    log: LogSettings = LogSettings()
    indenter: dict[str, IndenterSettings] = {}
