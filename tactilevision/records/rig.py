"""Records of the rig and its protocol: gel, sensor, indenter, press."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import radians, tan
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from tactilevision.errors import InputError
from tactilevision.records.measured import Pair, Picture
from tactilevision.records.ranges import Ranged, check_ranges

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, slots=True)
class Gel:
    """The gel pad, flat and bonded to a rigid base: thickness, outline and prior knowledge of its material.

    A disc has `radius_mm`, a rectangle `size_mm` (x, y). Raises InputError for an outline without its size, and
    for a shape that is not solved, such as a dome or a wedge.
    """

    thickness_mm: float
    thickness_std_mm: float = 0.0
    shape: Literal["disc", "rectangle", "unbounded"] = "unbounded"
    radius_mm: float | None = None
    size_mm: Pair | None = None
    poisson_ratio: float | None = None
    poisson_ratio_std: float | None = None
    youngs_modulus_MPa: float | None = None
    youngs_modulus_std_MPa: float | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        sizes = {"disc": ("radius_mm", self.radius_mm), "rectangle": ("size_mm", self.size_mm), "unbounded": None}
        if self.shape not in sizes:
            raise InputError(
                "a gel of this shape is not solved",
                where="gel",
                value=self.shape,
                remedy='Flat pads are: "disc", "rectangle" or "unbounded".',
            )
        asked = sizes[self.shape]
        if asked is not None and asked[1] is None:
            raise InputError(f"a gel of this shape needs {asked[0]}", where="gel", value=self.shape)


@dataclass(frozen=True, slots=True)
class Sensor(Ranged):
    """A camera looking at a gel.

    `mm_per_px` is (x, y) in the rectified frame of `width_px` by `height_px`. `rectification` is (map_x, map_y),
    float32 (height, width) each: rectified[y, x] = raw[map_y, map_x]; None if frames are rectified already.
    `has_markers`: the gel carries printed or cut marks.
    """

    kind: str
    width_px: int
    height_px: int
    mm_per_px: Pair
    gel: Gel | None = None
    rectification: tuple[Picture, Picture] | None = None
    has_markers: bool = False
    serial: str = ""


@dataclass(frozen=True, slots=True)
class Indenter(Ranged):
    """A rigid body that is pressed into the gel.

    `height_mm` is the height of its face over the bevel's nearest edge, as machined; `bevel` the bevel's side in
    the rectified frame (top is smaller y), `bevel_distance_mm` the distance of that edge from the axis,
    `bevel_angle_deg` the slope with which the bevel falls away from it. None: not stated.
    """

    name: str
    shape: Literal["flat_cylinder", "sphere", "cone"] = "flat_cylinder"
    radius_mm: float = float("nan")
    radius_std_mm: float = 0.0
    height_mm: float | None = None
    height_std_mm: float = 0.0
    bevel: Literal["right", "left", "top", "bottom"] | None = None
    bevel_distance_mm: float | None = None
    bevel_angle_deg: float | None = None
    edge_radius_mm: float | None = None
    half_angle_deg: float | None = None


@dataclass(frozen=True, slots=True)
class Press(Ranged):
    """One press of the protocol. NaN: not recorded. `extra` holds columns that have no field here."""

    press: str
    indenter: str
    start_s: float
    end_s: float
    target_depth_mm: float = float("nan")
    x_mm: float = float("nan")
    y_mm: float = float("nan")
    rest_s: float = float("nan")
    speed_mm_s: float = float("nan")
    hold_s: float = float("nan")
    temperature_C: float = float("nan")
    date: str = ""
    time_of_day_s: float = float("nan")
    lubricated: float = float("nan")
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ShadowZone:
    """Gel nearer to a steep wall than K of its depths, which a lamp at elevation e may not reach: K = 1/tan(e).

    `lowest_deg` is the elevation of the lowest lamp's lower edge, seen from gel beyond the wall. Lamps of such
    sensors stand 15 to 35 degrees above the middle of the gel; from behind a punch their lower edges are seen some
    degrees lower. `reach_std` is the standard deviation of K. In path-traced pictures slopes are
    biased up to `clear` depths, presumably by light that is reflected between wall and gel.
    """

    lowest_deg: float = 11.3
    reach_std: float = 1.0
    clear_sigma: float = 3.0

    @property
    def reach(self) -> float:
        """K, depths beyond the wall."""
        return 1 / tan(radians(self.lowest_deg))

    @property
    def clear(self) -> float:
        """K plus `clear_sigma` of its standard deviations."""
        return self.reach + self.clear_sigma * self.reach_std


SHADOW_ZONE = ShadowZone()


Record = TypeVar("Record", bound="DataclassInstance")


def stated(record: Record, **values: Any) -> Record:
    """Return the record with those of the values that are stated, not None."""
    return replace(record, **{name: value for name, value in values.items() if value is not None})
