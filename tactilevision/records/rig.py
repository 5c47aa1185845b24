"""Records of the rig and its protocol: gel, sensor, indenter, press."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import radians, tan
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

from tactilevision.errors import InputError, check_known
from tactilevision.records.measured import Pair, Picture
from tactilevision.records.ranges import Ranged, check_ranges

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


FLAT = ("disc", "rectangle", "unbounded")
Shape = Literal["disc", "rectangle", "unbounded", "dome", "cylinder", "curved", "wedge", "mesh"]


@dataclass(frozen=True, slots=True)
class GelLayer(Ranged):
    """A layer of a gel: its modulus over that of the gel, and its Poisson's ratio, None for the gel's."""

    thickness_mm: float
    modulus_ratio: float = 1.0
    poisson_ratio: float | None = None


@dataclass(frozen=True, slots=True)
class Gel:
    """The gel, bonded to a rigid base: thickness at the picture's centre, shape, prior knowledge of its material.

    The outline in the picture is round with `radius_mm`, or `size_mm` (x, y). `curvature_mm` is the radius of the
    seen surface along x and along y; a dome has one, a cylinder is straight along its `axis`. The `base` follows
    the surface at a constant thickness ("curved"), or is "flat". A wedge has `thickness_ends_mm` at its sides of
    smaller and greater coordinate, and is straight along its `axis`. `layers` are listed from the seen surface
    inward; the last one fills the rest. A "mesh" is read from the file `mesh` in `mesh_unit`, with the sets `seen`
    and `bonded`. `camera_mm` is the distance of the camera's pinhole, on the axis x = y = 0, from z = 0; None for
    parallel rays. A flat gel does not use it.

    Raises InputError for a shape without its size, or one that is not known.
    """

    thickness_mm: float
    thickness_std_mm: float = 0.0
    shape: Shape = "unbounded"
    radius_mm: float | None = None
    size_mm: Pair | None = None
    poisson_ratio: float | None = None
    poisson_ratio_std: float | None = None
    youngs_modulus_MPa: float | None = None
    youngs_modulus_std_MPa: float | None = None
    curvature_mm: Pair | None = None
    base: Literal["curved", "flat"] = "curved"
    axis: Literal["x", "y"] = "y"
    thickness_ends_mm: Pair | None = None
    layers: tuple[GelLayer, ...] = ()
    mesh: str | None = None
    mesh_unit: Literal["mm", "m", "inch"] = "mm"
    seen: str = "seen"
    bonded: str = "bonded"
    camera_mm: float | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        for name, known in (
            ("base", ("curved", "flat")),
            ("axis", ("x", "y")),
            ("mesh_unit", ("mm", "m", "inch")),
        ):
            check_known(getattr(self, name), known, what=f"{name} is not known", where="gel")
        missing = missing_size(self)
        if missing:
            raise InputError(missing, where="gel", value=self.shape)
        if self.shape not in get_args(Shape):
            raise InputError(
                "a gel of this shape is not solved",
                where="gel",
                value=self.shape,
                remedy=f'Known are {", ".join(get_args(Shape))}; any other shape is a "mesh".',
            )

    @property
    def is_flat(self) -> bool:
        """Whether it is one flat layer of one thickness and material."""
        return self.shape in FLAT and not self.layers


def missing_size(gel: Any) -> str:
    """Return what a gel's shape needs and lacks, "" for nothing: of a Gel, or settings with its names."""
    outline = (("radius_mm", "size_mm"),)
    asked: Mapping[str, tuple[tuple[str, ...], ...]] = {
        "disc": (("radius_mm",),),
        "rectangle": (("size_mm",),),
        "dome": (("curvature_mm",), *outline),
        "cylinder": (("curvature_mm",), ("size_mm",)),
        "curved": (("curvature_mm",), ("size_mm",)),
        "wedge": (("thickness_ends_mm",), ("size_mm",)),
        "mesh": (("mesh",),),
    }
    for names in asked.get(gel.shape, ()):
        if all(getattr(gel, name) is None for name in names):
            return f"a gel of this shape needs {' or '.join(names)}"
    return ""


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
