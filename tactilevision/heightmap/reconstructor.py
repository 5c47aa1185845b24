"""Convert frames to height maps, stage by stage.

rectify -> slopes (photometric) -> steep walls round flat faces restored -> surface (Poisson) -> zero plane of the
untouched gel -> deviation -> flags.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import scale_is_assumed, unfit_warnings
from tactilevision.heightmap.deviation import ASSUMED_STEEP_SHARE, DepthError, Surface, shades
from tactilevision.heightmap.inconsistent_light import Inconsistency, LightCheck, rises_too_much
from tactilevision.heightmap.poisson import TwoGridPoisson, integrate
from tactilevision.heightmap.reference_match import ReferenceMatch, check_reference
from tactilevision.heightmap.reference_view import check_three_lights, has_one_hue
from tactilevision.heightmap.torn_frames import TearCheck
from tactilevision.heightmap.walls import PunchEdge, WallLaw, restore_windows
from tactilevision.heightmap.zero_plane import ZeroPlane, find_zero_plane, flat_blocks, level, slope_of
from tactilevision.photometric.calibrate import Calibration
from tactilevision.photometric.method import CalibratedMethod, SlopeReading
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import INCONSISTENT, SHADOW, STEEP, Frame, HeightMap, SlopeMap, add, as_frame
from tactilevision.records.measured import Bools, Bytes, Pair, Picture
from tactilevision.records.rig import Sensor
from tactilevision.sensors import deepest_mm
from tactilevision.sensors.rectification import rectify

# of the steepest slope that was calibrated: what a blurred picture shows of steeper ones is too little
READABLE = 0.8
MIN_CHECKED_MM = 0.08  # mm: flatter maps are not checked for inconsistent light
AS_CALIBRATED: Any = object()  # of a field: what the method and its calibration say


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """What one picture shows: its `height` map with flags, and what that rests on."""

    height: HeightMap
    surface: Surface
    inconsistency: Inconsistency | None
    error: DepthError | None

    @property
    def slopes(self) -> SlopeMap:
        """Slopes (H, W), walls restored."""
        return self.surface.reading.slopes

    @property
    def zero(self) -> ZeroPlane:
        """Return the plane of the untouched gel, from which depth counts."""
        return self.surface.zero

    @property
    def edges(self) -> Sequence[PunchEdge]:
        """Return the walls of flat faces that were restored."""
        return self.surface.walls

    def terms_mm(self) -> dict[str, Picture]:
        """Return the deviation (h, w) mm by term (heightmap/deviation.py), on a grid of every nth pixel.

        n = `error.every`; empty for a method that states no deviation.
        """
        unexplained_mm = self.inconsistency.depth_mm if self.inconsistency else None
        return {} if self.error is None else self.error.terms_mm(self.surface, unexplained_mm)


@dataclass(frozen=True, eq=False)
class Reconstructor:
    """Turns the frames of one sensor into height maps. A frozen record: threads and processes may share one.

    `calibration` is that of the method, None for a ready-made method. `taught` is the wall law's correction by
    certified faces, None without any; `match` compares pictures with the reference, None without one;
    `frame_size_px` of raw frames, where it is known. A variant is made by `varied`.
    """

    sensor: Sensor
    method: PhotometricMethod
    calibration: Calibration | None = None
    taught: TaughtWalls | None = AS_CALIBRATED
    match: ReferenceMatch | None = AS_CALIBRATED
    warnings: tuple[str, ...] = AS_CALIBRATED
    frame_size_px: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        method = self.referenced
        known: Mapping[str, Any] = {
            "taught": None if method is None else method.walls,
            "match": None if method is None else ReferenceMatch(method),
            "warnings": (self.calibration.warnings if self.calibration else ())
            + (() if method is None else unfit_warnings(method.card)),
        }
        for name, value in known.items():
            if getattr(self, name) is AS_CALIBRATED:
                object.__setattr__(self, name, value)

    def varied(self, **changes: Any) -> Reconstructor:
        """Return a copy with other fields; what only sensor and method determine is not computed again."""
        if "method" in changes:
            changes = {"taught": AS_CALIBRATED, "match": AS_CALIBRATED} | changes
        varied = replace(self, **changes)
        if not changes.keys() & {"sensor", "method"}:
            varied.__dict__.update({name: self.__dict__[name] for name in MADE_ONCE if name in self.__dict__})
        return varied

    def warned(self, *warnings: str) -> Reconstructor:
        """Return the same with more warnings."""
        return self.varied(warnings=(*self.warnings, *warnings))

    def independent(self) -> Reconstructor:
        """Return a copy whose reference may `follow` the gel while this one stays."""
        if self.referenced is None or self.match is None:
            return self
        method = replace(self.referenced)
        return self.varied(method=method, match=replace(self.match, method=method))

    # What only sensor and method determine, made once.

    @cached_property
    def referenced(self) -> CalibratedMethod | None:
        """Return the method, where it has a reference."""
        return self.method if isinstance(self.method, CalibratedMethod) else None

    @cached_property
    def readable(self) -> float:
        """Return the steepest slope that is read reliably."""
        card = self.referenced.card if self.referenced else None
        if card is None or not card.steepest_slope:
            return np.inf
        return (ASSUMED_STEEP_SHARE if scale_is_assumed(card) else READABLE) * card.steepest_slope

    @cached_property
    def error(self) -> DepthError | None:
        """Return the deviation of depths; None for a method that states none."""
        return DepthError(self.referenced, self.sensor.mm_per_px) if self.referenced else None

    @cached_property
    def grids(self) -> TwoGridPoisson | None:
        """Return the integrator on a coarse grid; None where slopes are read pixel by pixel."""
        if self.referenced is None or (tiled := self.referenced.tiled_evaluator) is None:
            return None
        return TwoGridPoisson(self.referenced.reference.shape, tiled.px, self.sensor.mm_per_px)

    @cached_property
    def tear_check(self) -> TearCheck:
        """Return the check for torn pictures."""
        return TearCheck(self.sensor)

    @cached_property
    def has_one_hue(self) -> bool:
        """Return whether the reference may be lit by one light."""
        return self.referenced is not None and has_one_hue(self.referenced.reference.rgb)

    @cached_property
    def light_check(self) -> LightCheck | None:
        """Return the check for unexplained light; None where balls did not determine the method's law."""
        method = self.referenced
        if method is None or (method.light_law is None and method.card.balls):
            return None
        return LightCheck(method, self.sensor.mm_per_px)

    # The path of a frame.

    def height_map(self, frame: Frame | Bytes) -> HeightMap:
        """Return depth (H, W) float32 mm of a raw frame, rectified, positive into the gel, 0 where untouched.

        `frame` may be its pixels alone, (H, W, 3) uint8, red first.
        Pixels without usable colour (dark, saturated) are invalid; the surface is interpolated there. A picture
        that does not match the reference is flagged (heightmap/reference_match.py).
        Raises InputError for a frame that is not of this sensor, black, saturated, torn, or deeper than its gel.
        """
        return self.read(frame).height

    def rectified_map(self, rgb: Bytes, *, time_s: float = float("nan"), name: str = "") -> HeightMap:
        """Return the height map of a rectified picture."""
        return self.read_rectified(rgb, time_s=time_s, name=name).height

    def read(self, frame: Frame | Bytes) -> Reading:
        """Return the height map of a raw frame and what it rests on. Raises as height_map does."""
        frame = as_frame(frame)
        return self.read_rectified(self.rectified(frame), time_s=frame.time_s, name=frame.name)

    def read_rectified(self, rgb: Bytes, *, time_s: float = float("nan"), name: str = "") -> Reading:
        """Return the reading of a rectified picture (H, W, 3), as `read`."""
        return self.assessed(self._surface(rgb), time_s=time_s, name=name)

    def assessed(self, surface: Surface, *, time_s: float = float("nan"), name: str = "") -> Reading:
        """Return the reading of a `surface`, with its deviation and flags. Raises as height_map does."""
        self._check_whole(surface, name)
        return self._reading(surface, time_s, name)

    def _reading(self, surface: Surface, time_s: float, name: str) -> Reading:
        found, error, frame = self._inconsistency(surface), self.error, surface.reading.frame
        height = HeightMap(
            surface.depth_mm,
            surface.reading.valid,
            self.sensor.mm_per_px,
            None if error is None else error.std_mm(surface, found.depth_mm if found else None),
            time_s,
            name,
            self._flags(surface, found),
            colour_change=frame.drift.normalised_residual if frame else None,
            inconsistent=found.inconsistent if found else None,
            untouched_std_mm=None if error is None else error.untouched_std_mm,
        )
        return Reading(height, surface, found, error)

    def depth_map(self, frame: Frame) -> tuple[HeightMap, Bytes, Callable[[], HeightMap]]:
        """Return a raw frame's map without deviation and flags, the rectified picture, and what adds those two.

        Raises as height_map does.
        """
        rgb, scale = self.rectified(frame), self.sensor.mm_per_px
        surface = self.surface(rgb, frame.name)
        depth = HeightMap(surface.depth_mm, surface.reading.valid, scale, None, frame.time_s, frame.name)
        return depth, rgb, lambda: self._reading(surface, frame.time_s, frame.name).height

    def surface(self, rgb: Bytes, name: str = "") -> Surface:
        """Return the surface of a rectified picture, without deviation and flags. Raises as height_map does."""
        surface = self._surface(rgb)
        self._check_whole(surface, name)
        return surface

    def rectified(self, frame: Frame | Bytes) -> Bytes:
        """Return the rectified picture of a raw frame. Raises InputError for one of another size."""
        frame = as_frame(frame)
        size, known = (frame.rgb.shape[1], frame.rgb.shape[0]), self.frame_size_px
        if known is not None and size != known:
            raise InputError(
                "the frame has another size than those that the sensor was calibrated on",
                where=frame.name or "frame",
                value=f"{size[0]} x {size[1]} px",
                remedy=f"Hand over frames of {known[0]} x {known[1]} px, as the camera gave them then.",
            )
        return rectify(self.sensor, frame.rgb)

    def _surface(self, rgb: Bytes) -> Surface:
        """Return slopes, walls, depth and zero plane of a rectified picture, gentle gel on a coarse grid."""
        scale, law = self.sensor.mm_per_px, WallLaw(self.readable, self.taught)
        reading = self._slopes(rgb)
        untouched = reading.frame.drift.untouched if reading.frame else flat_blocks(reading.slopes)
        walls: list[PunchEdge] = []
        if law.limit <= reading.steepest < np.inf:
            walls = restore_windows(reading.fine, reading.windows, valid=reading.valid, mm_per_px=scale, law=law)
        if self.grids is None or reading.coarse is None:
            depth = integrate(SlopeMap(*reading.fine[0]), scale)
            zero = self._zero_plane(depth, untouched, scale)
            level(depth, zero)
            return Surface(depth, zero, walls, reading)
        coarse = self.grids.coarse(reading.coarse, reading.windows, fine=reading.fine)
        zero = self._zero_plane(coarse, untouched, self.grids.coarse_mm)
        level(coarse, zero)
        tilt = slope_of(zero, coarse.shape, mm_per_px=self.grids.coarse_mm)
        depth = self.grids.whole(coarse, reading.windows, fine=reading.fine, tilt=tilt)
        return Surface(depth, zero, walls, reading)

    def _slopes(self, rgb: Bytes) -> SlopeReading:
        if self.referenced:
            return (self.referenced.tiled_evaluator or self.referenced).read(rgb)
        found = self.method.slopes(rgb)
        whole = slice(0, rgb.shape[0]), slice(0, rgb.shape[1])
        valid = np.ones(found.dz_dx.shape, np.bool_) if found.valid is None else found.valid
        return SlopeReading([whole], [np.stack([found.dz_dx, found.dz_dy])], valid)

    def _zero_plane(self, depth: npt.NDArray[Any], untouched: Bools, mm_per_px: Pair) -> ZeroPlane:
        gel, trusted = self.sensor.gel, self.referenced.trusted_blocks if self.referenced else None
        thickness = gel.thickness_mm if gel else None
        return find_zero_plane(depth, untouched, mm_per_px=mm_per_px, thickness_mm=thickness, trusted=trusted)

    def _inconsistency(self, surface: Surface) -> Inconsistency | None:
        """Return what the light does not explain in a picture; None for too flat a map."""
        if surface.reading.frame is None or self.light_check is None:
            return None
        low, high, *_ = cv2.minMaxLoc(surface.depth_mm)
        return None if max(-low, high) < MIN_CHECKED_MM else self.light_check(surface.reading.frame)

    def _check_whole(self, surface: Surface, name: str) -> None:
        """Raise InputError for a picture that is torn or under one light, and a map deeper than its gel allows."""
        low, high, *_ = cv2.minMaxLoc(surface.depth_mm)
        frame = surface.reading.frame
        if max(-low, high) < MIN_CHECKED_MM:
            return
        if frame is not None and self.has_one_hue:
            check_three_lights(frame.reference.reference.rgb, [frame.rgb])
        if frame is not None and (row := self.tear_check(frame)) is not None:
            what = f"the picture is torn at row {row}: above and below it are of two moments"
            remedy = "Exclude the frame; read the camera into a buffer that is not written at the same time."
            raise InputError(what, where=name or "frame", remedy=remedy)
        if high > (allowed := deepest_mm(self.sensor)):
            deep = f"{high:.2g} mm deep, more than the {allowed:.2g} mm that this gel allows"
            what = f"the picture is damaged, or of another view or sensor: its map would be {deep}"
            remedy = "Exclude the frame, or correct thickness_mm."
            raise InputError(what, where=name or "frame", remedy=remedy)

    def sound_surface(self, rgb: Bytes) -> Surface | None:
        """Return the surface of a rectified picture; None for one that is rejected."""
        with suppress(InputError):
            return self.surface(rgb)
        return None

    def sound_map(self, rgb: Bytes) -> HeightMap | None:
        """Return the height map of a rectified picture; None for one that is rejected."""
        with suppress(InputError):
            return self.rectified_map(rgb)
        return None

    def _flags(self, surface: Surface, inconsistency: Inconsistency | None) -> tuple[str, ...]:
        """Return the flags of the map as a whole."""
        depth = surface.depth_mm
        flags = self.match.flags(surface.reading.frame, surface.zero) if self.match else ()
        found = {
            INCONSISTENT: (inconsistency is not None and inconsistency.doubtful) or rises_too_much(depth),
            SHADOW: any(map(shades, surface.walls)),
            STEEP: self.error is not None and self.error.hides_much(surface),
        }
        return add(flags, filter(found.get, found))

    # Before and between frames.

    def slope_map(self, frame: Frame | Bytes) -> SlopeMap:
        """Return the slopes (H, W), mm/mm, of a raw frame before integration. Raises as height_map does."""
        rgb = self.rectified(frame)
        return self.referenced.read(rgb).slopes if self.referenced else self.method.slopes(rgb)

    def look(self, pictures: Sequence[Frame | Bytes]) -> Reconstructor:
        """Return a copy that flags maps where `pictures` contradict the reference, or this shows a contact.

        `pictures` are rectified, in order of time; rejected ones do not count. The copy warns of each fault.
        """
        if self.match is None:
            return self
        frames = [as_frame(one) for one in pictures]
        frames = [frame for frame in frames if self.sound_surface(frame.rgb)] or frames
        pixels = [frame.rgb for frame in frames]
        before = self.calibration.method.reference if self.calibration else None
        match, scene = self.match.with_scene(frames, before=before)
        match, shift = match.with_shift(pixels)
        match, contact = check_reference(match, self.rectified_map, pictures=pixels)
        return self.varied(match=match).warned(*scene, *shift, *contact)

    def follow(self, rgb: Bytes, share: float) -> None:
        """Move the reference towards a rectified picture of the untouched gel by `share` of their difference.

        For one that is `independent`, and not while another thread reads with it.
        """
        if self.referenced:
            self.referenced.follow(rgb, share)
            self.__dict__.pop("light_check", None)


MADE_ONCE = ("referenced", "readable", "error", "grids", "tear_check", "has_one_hue", "light_check")
