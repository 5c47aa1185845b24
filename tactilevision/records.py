"""The frozen records that all rooms share, and the one place that states signs, axes, orders and units.

Units are mm, N, MPa (N/mm²), s throughout, so no conversion factor appears inside the library.
Axes: z into the gel, x to the right, y down, in the rectified frame as the camera shows it. Arrays of
pictures are indexed [row = y, column = x]; places are written (x, y). A place in pixels has (0, 0) at the
centre of the top left pixel; a place on the pad in mm has (0, 0) at the centre of the rectified frame.
Seen from the camera this can be a left-handed set: convert with care for anything outside.
Depth is positive into the gel and 0 where it is untouched; the rise beside a contact is negative.
Force is what the indenter does to the gel: fz > 0 presses into it, fx and fy act along x and y.
Colours are in the order red, green, blue.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with what is not known about it.

    `value` is None where the data cannot fix it; `why` then says so, and `interval95` still holds the
    range that the stated assumptions allow.
    """

    value: float | None
    std: float | None
    interval95: Pair | None
    unit: str
    why: str = ""

    def as_json(self) -> dict[str, Any]:
        """The form of every result file: value, std, interval95, unit, and why, where there is one."""
        interval = None if self.interval95 is None else list(self.interval95)
        content = {"value": self.value, "std": self.std, "interval95": interval, "unit": self.unit}
        return content | ({"why": self.why} if self.why else {})


@dataclass(frozen=True, slots=True)
class Gel:
    """The gel pad: thickness, outline and what is known of it beforehand. Bonded to a rigid base."""

    thickness_mm: float
    thickness_std_mm: float = 0.0
    shape: Literal["disc", "rectangle", "unbounded"] = "unbounded"
    radius_mm: float | None = None
    size_mm: Pair | None = None
    poisson_ratio: float | None = None
    poisson_ratio_std: float | None = None
    youngs_modulus_MPa: float | None = None
    youngs_modulus_std_MPa: float | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """A camera looking at a gel.

    `mm_per_px` is (x, y) in the rectified frame of `width_px` by `height_px`. `rectification` is
    (map_x, map_y), float32 (height, width) each: rectified[y, x] = raw[map_y, map_x]; None where frames
    come rectified already. `has_markers` says that the gel carries printed or cut marks.
    """

    kind: str
    width_px: int
    height_px: int
    mm_per_px: Pair
    gel: Gel | None = None
    rectification: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]] | None = None
    has_markers: bool = False
    serial: str = ""


@dataclass(frozen=True, slots=True)
class Indenter:
    """A rigid body that is pressed into the gel.

    `height_mm` is the height of its face over the bevel's nearest edge, as machined; `bevel` the side on
    which the bevel lies in the rectified frame (top is smaller y). `bevel_distance_mm` runs from the axis to
    the bevel's nearest edge, `bevel_angle_deg` is its slope, falling away from that edge. None: not stated.
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
class Press:
    """One press as the protocol has it. NaN: not recorded. `extra` keeps columns that have no field here."""

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
class Frame:
    """One picture: `rgb` (H, W, 3) uint8, its time on the camera's clock, and its name in the recording."""

    rgb: Bytes
    time_s: float = float("nan")
    name: str = ""

    def __post_init__(self) -> None:
        rgb: Any = self.rgb
        kind = (rgb.ndim, rgb.shape[-1:], rgb.dtype) if isinstance(rgb, np.ndarray) else ()
        if kind != (3, (3,), np.uint8):
            raise InputError(
                "a frame is an array (H, W, 3) of uint8, colours in the order red, green, blue",
                where=self.name or "Frame",
                value=f"{rgb.shape} {rgb.dtype}" if kind else type(rgb).__name__,
                remedy="Read it with tactilevision.recording, or convert it first.",
            )


@dataclass(frozen=True, slots=True)
class SlopeMap:
    """Slope of the depth: `dz_dx`, `dz_dy` (H, W), mm per mm, z into the gel; `valid` (H, W) or None for all.

    `std` (H, W) or None is the standard deviation of either slope, where the method knows it.
    """

    dz_dx: npt.NDArray[np.floating[Any]]
    dz_dy: npt.NDArray[np.floating[Any]]
    valid: Bools | None = None
    std: npt.NDArray[np.floating[Any]] | None = None


@dataclass(frozen=True, slots=True)
class HeightMap:
    """Depth of the gel's surface.

    `depth_mm` (H, W), positive into the gel; `valid` (H, W): where False the depth is not known, which is
    not the same as 0; `mm_per_px` (x, y); `std_mm` (H, W) or None where the method does not know it. `flags` say
    what makes the map as a whole doubtful (flags.py).
    """

    depth_mm: npt.NDArray[np.floating[Any]]
    valid: Bools
    mm_per_px: Pair
    std_mm: npt.NDArray[np.floating[Any]] | None = None
    time_s: float = float("nan")
    name: str = ""
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.depth_mm.ndim != 2 or self.valid.shape != self.depth_mm.shape:
            raise InputError("depth_mm and valid are (H, W) alike", where="HeightMap",
                             value=(self.depth_mm.shape, self.valid.shape))  # fmt: skip
        if not all(0 < s < math.inf for s in self.mm_per_px):
            raise InputError("a height map needs its scale in mm per pixel, x and y, above 0", where="HeightMap",
                             value=self.mm_per_px, remedy="Set sensor.mm_per_px in recording.toml.")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Footprint:
    """Where the indenter's face touches the gel.

    `mask` (H, W); `centre_mm` on the pad (x, y) and its standard deviation; `radius_mm` of the fitted circle;
    `tilt` = (d depth/dx, d depth/dy) of the face; `depth_mm` of the face at the centre; `residual_mm` the rms
    distance of the edge points from the circle.
    """

    mask: Bools
    centre_mm: Pair
    centre_std_mm: float
    radius_mm: float
    radius_std_mm: float
    tilt: Pair
    tilt_std: float
    depth_mm: float
    depth_std_mm: float
    residual_mm: float


@dataclass(frozen=True, slots=True)
class ForceSeries:
    """Force against time on the F/T sensor's clock: `time_s` (T,), `force_N` (T, 3), `std_N` (3,) of one reading.

    `torque_Nm` (T, 3) and `temperature_C` (T,) where they were recorded.
    """

    time_s: Floats
    force_N: Floats
    std_N: tuple[float, float, float]
    torque_Nm: Floats | None = None
    temperature_C: Floats | None = None


@dataclass(frozen=True, slots=True)
class CertifiedPoint:
    """Depth and force of one press at the moment that certifies them.

    `accepted` is False with a `reason` (one of REASONS) where the press cannot be trusted; its numbers, as
    far as they exist, are kept. `depth_uncorrected_mm` takes the depth for the machined height;
    `depth_mm` accounts for the gel that rises to meet the bevel. `extra` keeps further columns of points.csv.
    """

    press: str
    indenter: str
    depth_mm: float
    fz_N: float
    depth_std_mm: float = float("nan")
    fz_std_N: float = float("nan")
    fx_N: float = float("nan")
    fy_N: float = float("nan")
    time_s: float = float("nan")
    depth_uncorrected_mm: float = float("nan")
    rest_s: float = float("nan")
    speed_mm_s: float = float("nan")
    x_mm: float = float("nan")
    y_mm: float = float("nan")
    accepted: bool = True
    reason: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)


REASONS = (
    "tangential",
    "tilt",
    "footprint",
    "bevel_not_touched",
    "dropped_frames",
    "saturated",
    "short_rest",
    "border",
)


@dataclass(frozen=True, slots=True)
class Curve:
    """One whole press on one clock.

    `time_s`, `depth_mm` (T,), `force_N` (T, 3), `phase` (T,) of "free", "load", "hold", "unload" or "";
    `z_mm` (T,) the motion stage, where there is one. Rows of phase "free" are air before and after contact.
    """

    press: str
    time_s: Floats
    depth_mm: Floats
    force_N: Floats
    phase: npt.NDArray[np.str_]
    z_mm: Floats | None = None
    extra: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Material:
    """A linear elastic, isotropic gel. `covariance` (2, 2) is of (youngs_modulus_MPa, poisson_ratio)."""

    youngs_modulus_MPa: float
    poisson_ratio: float
    covariance: Floats | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.youngs_modulus_MPa) and self.youngs_modulus_MPa > 0):
            raise InputError("Young's modulus lies above 0 MPa", where="Material", value=self.youngs_modulus_MPa)
        if not 0 <= self.poisson_ratio < 0.5:
            raise InputError("Poisson's ratio lies in [0, 0.5)", where="Material", value=self.poisson_ratio,
                             remedy="For an incompressible gel take 0.4999.")  # fmt: skip


@dataclass(frozen=True, slots=True)
class ShearMap:
    """Tangential displacement of the gel's surface since it was untouched, at places of the untouched frame.

    `u_x_mm`, `u_y_mm` (H, W): right and down; `valid` (H, W): where False it is not known. `std_mm` is the
    standard deviation of either component, one number or (H, W); pixels within `correlation_px` share their error.
    `flags` name what limits the map (markers lost, ...).
    """

    u_x_mm: npt.NDArray[np.floating[Any]]
    u_y_mm: npt.NDArray[np.floating[Any]]
    valid: Bools
    mm_per_px: Pair
    std_mm: float | npt.NDArray[np.floating[Any]] = 0.0
    correlation_px: float = 1.0
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.u_x_mm.ndim != 2 or not self.u_x_mm.shape == self.u_y_mm.shape == self.valid.shape:
            raise InputError(
                "u_x_mm, u_y_mm and valid are (H, W) alike",
                where="ShearMap",
                value=(self.u_x_mm.shape, self.u_y_mm.shape, self.valid.shape),
            )


@dataclass(frozen=True, slots=True)
class TractionMap:
    """Traction of the indenter on the gel, MPa, (H, W) each; t_z > 0 presses into it.

    `resultant_N` (fx, fy, fz) and its standard deviation; `mm_per_px` (x, y) is the grid's own, `first_mm`
    the place of its top left node on the pad; `flags` name what limits the map (contact cut by the view's
    border, ...). `std_MPa` (3, H, W) is of t_x, t_y, t_z, NaN outside the contact; `moment_Nmm` (mx, my, mz)
    about the pad's centre, r x F in the axes x, y, z. Where a measured force was given, `mismatch_N` is the
    force found without it minus the measured one, and `mismatch_sigma` its largest component over the
    standard deviation expected of it. `depth_mm` is the greatest depth of what touches.
    What was not measured is NaN.
    """

    t_x: Floats
    t_y: Floats
    t_z: Floats
    mm_per_px: Pair
    resultant_N: tuple[float, float, float]
    resultant_std_N: tuple[float, float, float]
    flags: tuple[str, ...] = ()
    first_mm: Pair = (float("nan"), float("nan"))
    std_MPa: Floats | None = None
    moment_Nmm: tuple[float, float, float] | None = None
    moment_std_Nmm: tuple[float, float, float] | None = None
    mismatch_N: tuple[float, float, float] | None = None
    mismatch_sigma: float | None = None
    depth_mm: float = float("nan")
    time_s: float = float("nan")
    name: str = ""
