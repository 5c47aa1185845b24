"""Records by place: pictures, slopes, depth with its flags, shear and traction."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError, library
from tactilevision.records.display import Displayed, Summary, figure, number
from tactilevision.records.measured import Array, Bools, Bytes, Floats, Pair
from tactilevision.records.wrench import Patch, Triple, Wrench

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cells = npt.NDArray[np.intp]  # numbers of patches by place
_UNKNOWN = (math.nan,) * 3  # N mm: a moment that is not known


@dataclass(frozen=True, slots=True, repr=False)
class Frame(Displayed):
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
                remedy=_remedy(rgb),
            )

    def summary(self) -> Summary:
        """Return size, time and the picture."""
        rows, columns, _ = self.rgb.shape
        time = f"{self.time_s:.3f} s" if math.isfinite(self.time_s) else ""
        return Summary(f"Frame {self.name}", {"size": f"{columns} x {rows} px", "time": time}, picture=self.rgb)


def as_frame(given: Frame | Bytes) -> Frame:
    """Return the frame, or make one of the pixels (H, W, 3) uint8 given. Raises InputError as Frame does."""
    return given if isinstance(given, Frame) else Frame(given)


def _remedy(given: Any) -> str:
    """Return how to make a frame of what was given instead."""
    if isinstance(given, Frame):
        return "Give its pixels: frame.rgb."
    if isinstance(given, list | tuple):
        return "Make one array of it: numpy.stack(frames) is a batch."
    if not isinstance(given, np.ndarray):
        return "Read a recording's frame with tactilevision.read_frame."
    if given.ndim == 2 or given.shape[-1:] == (1,):
        return "Record in colour: slopes cannot be read from grey pictures."
    if given.ndim == 4:
        return "Give one frame of the batch; a sensor has read_batch."
    if given.ndim == 3 and given.shape[-1] == 4:
        return "Drop the fourth channel: rgb[..., :3]."
    if given.ndim == 3 and given.shape[0] == 3 and given.shape[-1] != 3:
        return "Put colours last: rgb.transpose(1, 2, 0)."
    if given.dtype == np.uint16:
        return "Make 8 bits of 16: (rgb >> 8).astype(numpy.uint8)."
    if given.size and given.dtype.kind == "f" and given.max() <= 1.0:
        return "Scale it to grey levels: (255 * rgb).astype(numpy.uint8)."
    return "Convert it to grey levels from 0 to 255: rgb.astype(numpy.uint8)."


@dataclass(frozen=True, slots=True)
class SlopeMap:
    """Slope of the depth: `dz_dx`, `dz_dy` (H, W), mm per mm, z into the gel; `valid` (H, W) or None for all.

    `std` (H, W) is the standard deviation of either slope; None if the method gives none.
    """

    dz_dx: Array
    dz_dy: Array
    valid: Bools | None = None
    std: Array | None = None


Positions = Literal["deformed", "undeformed"]


@dataclass(frozen=True, slots=True, repr=False)
class HeightMap(Displayed):
    """Depth of the gel's surface.

    `depth_mm` (H, W), positive into the gel; `valid` (H, W): False where the depth is unknown, which is not 0;
    `mm_per_px` (x, y); `std_mm` (H, W), None if the method gives none. `flags` are keys of MEANING.
    `untouched_std_mm` (H, W) is the part of it that untouched gel shows; the rest is shared by a whole contact:
    the scale of its depth, its zero, the light.

    `colour_change` (h, w), one per block of the picture, is the difference of its colours from those of untouched
    gel in the present light, in standard deviations of noise. `inconsistent` (h, w), one per cell, is True where
    no slope has the colours seen (heightmap/inconsistent_light.py). None: not computed.

    `positions` is "deformed" where a pixel is the place at which the camera sees the surface now (all maps from
    pictures), or "undeformed" where it is the place of that material in the untouched gel (nodes of a
    finite-element model). At a depth of .3 mm the two differ by some 3.5 % in the force.
    """

    depth_mm: Array
    valid: Bools
    mm_per_px: Pair
    std_mm: Array | None = None
    time_s: float = float("nan")
    name: str = ""
    flags: tuple[str, ...] = ()
    positions: Positions = "deformed"
    colour_change: Array | None = None
    inconsistent: Bools | None = None
    untouched_std_mm: Array | None = None

    def __post_init__(self) -> None:
        if self.positions not in get_args(Positions):
            raise InputError(
                'positions are "deformed" or "undeformed"', where=f"HeightMap {self.name}", value=self.positions
            )
        if self.depth_mm.ndim != 2 or self.valid.shape != self.depth_mm.shape:
            raise InputError(
                "depth_mm and valid have one shape (H, W)",
                where="HeightMap",
                value=(self.depth_mm.shape, self.valid.shape),
            )
        if not all(0 < s < math.inf for s in self.mm_per_px):
            raise InputError(
                "a height map needs its scale in mm per pixel, x and y, above 0",
                where="HeightMap",
                value=self.mm_per_px,
                remedy="Set sensor.mm_per_px in recording.toml.",
            )

    def summary(self) -> Summary:
        """Return size, greatest depth with its deviation, the known share and flags, and the map as a picture."""
        import cv2

        known = np.where(self.valid, self.depth_mm, np.nan)
        place = int(np.nanargmax(known)) if self.valid.any() else 0
        std = None if self.std_mm is None else float(self.std_mm.flat[place])
        (rows, columns), (x, y) = self.depth_mm.shape, self.mm_per_px
        values = {
            "size": f"{columns} x {rows} px, {columns * x:.1f} x {rows * y:.1f} mm",
            "deepest": f"{number(float(known.flat[place]), std)} mm" + (f", std {std:.2g} mm" if std else ""),
            "known": f"{100 * self.valid.mean():.1f} % of the picture",
        }
        top = max(float(np.nanmax(known, initial=0.0)), 1e-3)
        grey = np.nan_to_num(255 * np.clip(known / top, 0, 1)).astype(np.uint8)
        picture = np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_CIVIDIS)[..., ::-1], dtype=np.uint8)
        return Summary(f"HeightMap {self.name}", values, tuple(f"{f}: {MEANING[f]}" for f in self.flags), picture)

    def plot(self, *, std: bool = False) -> Figure:
        """Draw the depth with a colour bar in mm and a scale bar; with `std` also its standard deviation."""
        return figure("plot_height", self, std=std)

    def to_xarray(self) -> Any:
        """Return an xarray.Dataset of `depth_mm` and, where it is known, `std_mm` over y and x (rows, columns).

        x and y are in mm from the pad's centre, right and down; a depth that is not known is NaN. Raises
        InputError where xarray is missing (extra `notebook`).
        """
        xarray = library("xarray", extra="notebook", where="to_xarray")
        fields = {"depth_mm": self.depth_mm, **({} if self.std_mm is None else {"std_mm": self.std_mm})}
        sides = zip("yx", self.depth_mm.shape, self.mm_per_px[::-1], strict=True)
        places = {n: (n, (np.arange(size) - (size - 1) / 2) * mm, {"units": "mm"}) for n, size, mm in sides}
        known = {
            name: (("y", "x"), np.where(self.valid, f, np.nan), {"units": "mm"}) for name, f in fields.items()
        }
        about = {"name": self.name, "time_s": self.time_s, "flags": list(self.flags)}
        return xarray.Dataset(known, coords=places, attrs=about)


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
class ShearMap:
    """Tangential displacement of the gel's surface since it was untouched, at places of the untouched frame.

    `u_x_mm`, `u_y_mm` (H, W): right and down; `valid` (H, W): False where unknown. `std_mm` is the standard
    deviation of either component, a number or (H, W); pixels within `correlation_px` share their error. `flags`
    name what limits the map (markers lost, ...).
    """

    u_x_mm: Array
    u_y_mm: Array
    valid: Bools
    mm_per_px: Pair
    std_mm: float | Array = 0.0
    correlation_px: float = 1.0
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.u_x_mm.ndim != 2 or not self.u_x_mm.shape == self.u_y_mm.shape == self.valid.shape:
            raise InputError(
                "u_x_mm, u_y_mm and valid have one shape (H, W)",
                where="ShearMap",
                value=(self.u_x_mm.shape, self.u_y_mm.shape, self.valid.shape),
            )


@dataclass(frozen=True, slots=True)
class TractionMap:
    """Traction of the indenter on the gel, MPa, (H, W) each; t_z > 0 presses into it.

    `resultant_N` (fx, fy, fz) and its standard deviation; `mm_per_px` (x, y) is the grid's own, `first_mm` the
    place of its top left node on the pad; `flags` name what limits the map (contact cut by the view's border,
    ...). `std_MPa` (3, H, W) is of t_x, t_y, t_z, NaN outside the contact; `moment_Nmm` (mx, my, mz) about the
    pad's centre, r x F; `covariance` (6, 6) of force and moment. `depth_mm` is the greatest depth of the contact,
    `model_std_N` the solver's own part of fz's std. NaN: not measured.

    `patches` are the contacts, of which the wrench is the sum; `patch_map` (H, W) has their numbers, 0 outside.
    Where nothing touches, `could_hide_N` is the upper 95 % limit of the normal force of an unseen contact.

    On a curved gel, t_x, t_y and t_z keep the picture's axes, (x, y) of a node is its place in the picture,
    `area_mm2` (H, W) the surface's area there and `normal` (3, H, W) its unit normal into the gel.
    """

    t_x: Floats
    t_y: Floats
    t_z: Floats
    mm_per_px: Pair
    resultant_N: Triple
    resultant_std_N: Triple
    flags: tuple[str, ...] = ()
    first_mm: Pair = (float("nan"), float("nan"))
    std_MPa: Floats | None = None
    moment_Nmm: Triple | None = None
    moment_std_Nmm: Triple | None = None
    depth_mm: float = float("nan")
    time_s: float = float("nan")
    name: str = ""
    model_std_N: float = float("nan")
    covariance: Floats | None = None
    patches: tuple[Patch, ...] = ()
    patch_map: Cells | None = None
    could_hide_N: float = float("nan")
    area_mm2: Floats | None = None
    normal: Floats | None = None

    @property
    def pressure(self) -> Floats:
        """Return the traction (H, W) along the surface's normal, MPa; without shear too."""
        if self.normal is None:
            return self.t_z
        along = self.normal[2] * self.t_z + np.nan_to_num(self.normal[0] * self.t_x + self.normal[1] * self.t_y)
        return np.asarray(np.where(np.isnan(self.t_x), self.t_z / self.normal[2], along))

    @property
    def wrench(self) -> Wrench:
        """Return force and moment about the pad's centre in one."""
        moment, moment_std = self.moment_Nmm or _UNKNOWN, self.moment_std_Nmm or _UNKNOWN
        return Wrench(self.resultant_N, self.resultant_std_N, moment, moment_std, self.covariance)

    @property
    def nodal_N(self) -> Floats:
        """Return the force (3, H, W) of each node, N: traction times area."""
        area = self.mm_per_px[0] * self.mm_per_px[1] if self.area_mm2 is None else self.area_mm2
        return np.stack([self.t_x, self.t_y, self.t_z]) * area


# Flags of a height map as a whole, and what each of them means.

MOVED = "moved"
LIGHT = "light"
BORDER = "border"
REFERENCE = "reference"
BALLS = "balls"
BEYOND_BALLS = "beyond_balls"
UNFIT = "unfit"
ASSUMED_SCALE = "assumed_scale"
INCONSISTENT = "inconsistent_light"
SHADOW = "shadow"
STEEP = "steep"
MEANING = {
    UNFIT: "the light's calibration fails on balls that it has not used: neither direction nor depth of a "
    "contact can be trusted",
    MOVED: "the picture is shifted against its reference: depth may be wrong everywhere",
    REFERENCE: "the reference itself shows a contact, or the gel has changed there since: depth is wrong "
    "there, and may be everywhere if the light was calibrated with it",
    BALLS: "the light was calibrated on balls in less than half of the picture, along one side at least: depth "
    "elsewhere is extrapolated",
    BEYOND_BALLS: "the contact is beyond the outermost balls of the light's calibration: its depth is "
    "extrapolated, and the stated deviation grows with the distance; press balls there",
    ASSUMED_SCALE: "no ball calibrated the scale of the depth, which is that of a usual light: at times 40 % "
    "off or, where no network for the sensor is ready, by a factor of two or three",
    LIGHT: "most of the picture differs from the reference by more than drift: another light, a picture that "
    "has moved, or contact over much of it",
    INCONSISTENT: "in places no slope has the colours seen, or gel rises further than theory allows: a shadow, "
    "a lamp that changed there, or a light outside the method's model; depth there is uncertain",
    SHADOW: "gel within 5 depths of a steep wall may be in the shadow of a lamp and then falls too steeply, as "
    "its deviation states; a deep flat face may be read up to half too deep, unless certified faces taught its "
    "wall",
    STEEP: "slopes are steeper than any calibrated, and belong to no round flat face: depth behind "
    "them is too small; calibrate with smaller balls, or deeper presses of them",
    BORDER: "a contact reaches the picture's border: it is cut off, or light comes from outside",
}

FALSE = frozenset({UNFIT, MOVED, LIGHT})  # flags of maps of which no depth can be trusted


def add(flags: tuple[str, ...], more: Iterable[str]) -> tuple[str, ...]:
    """Return both sets of flags, each once, in the order of MEANING."""
    both = {*flags, *more}
    return tuple(flag for flag in MEANING if flag in both)


def flag_messages(counts: Mapping[str, int], frames: int) -> list[str]:
    """Return a line for each flag: how many of the `frames` have it, and what it means."""
    return [f"{count} of {frames} frames are flagged {flag!r}: {MEANING[flag]}" for flag, count in counts.items()]
