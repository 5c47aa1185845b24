"""Convert frames to height maps.

rectify -> slopes (photometric) -> steep walls round flat faces restored -> surface (Poisson) -> zero plane of the
untouched gel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import RLock
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import unfit_warnings
from tactilevision.heightmap.deviation import DepthError, MapEvidence
from tactilevision.heightmap.deviation_terms import shades
from tactilevision.heightmap.inconsistent_light import Inconsistency, LightCheck, stands_out
from tactilevision.heightmap.poisson import integrate
from tactilevision.heightmap.reference_match import DEFAULT_BASELINE, ReferenceMatch, check_reference
from tactilevision.heightmap.two_grid_poisson import TwoGridPoisson
from tactilevision.heightmap.walls import PunchEdge, WallLaw, find_punch_edges, restore, restore_windows
from tactilevision.heightmap.zero_plane import (
    ZeroPlane,
    find_zero_plane,
    flat_blocks,
    level,
    slope_of,
)
from tactilevision.photometric.calibrate import Calibration
from tactilevision.photometric.colour_change import Planes
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.method import ReferencedMethod, as_referenced
from tactilevision.photometric.multiresolution import TiledEvaluator
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.photometric.windows import Patch
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import (
    DEEPER,
    INCONSISTENT,
    SHADOW,
    STEEP,
    Frame,
    HeightMap,
    SlopeMap,
    add,
    as_frame,
)
from tactilevision.records.measured import Bools, Bytes, Pair
from tactilevision.records.rig import Sensor
from tactilevision.sensors.rectification import rectify

Mapped = tuple[npt.NDArray[np.floating[Any]], Bools, npt.NDArray[np.floating[Any]] | None, tuple[str, ...]]
# of the steepest slope that was calibrated: what a blurred picture shows of steeper ones is too little
READABLE = 0.8
MIN_CHECKED_MM = 0.08  # mm: in maps that are flatter nothing false is worth the time to look for it


class _Turn:
    """A lock, since a map is made in arrays that the next one is made in; a copy of it is another lock."""

    def __init__(self) -> None:
        self.lock = RLock()

    def __reduce__(self) -> tuple[type[_Turn], tuple[()]]:
        return _Turn, ()


class Reconstructor:
    """Turns the frames of one sensor into height maps, one at a time: threads that share one wait for each other.

    `calibration` is what the method was made from, None for a method that came ready. `taught` is what certified
    faces taught of walls, None where none did.
    """

    def __init__(
        self, sensor: Sensor, method: PhotometricMethod, *, calibration: Calibration | None = None
    ) -> None:
        self.sensor, self.method, self.calibration = sensor, method, calibration
        self.turn = _Turn()
        self.warnings: tuple[str, ...] = calibration.warnings if calibration else ()
        self.zero: ZeroPlane | None = None
        self.evidence: MapEvidence | None = None
        self.referenced = as_referenced(method)
        self.warnings += unfit_warnings(self.referenced.card) if self.referenced else ()
        steepest = self.referenced.card.steepest_slope if self.referenced else None
        self.readable = READABLE * steepest if steepest else np.inf
        self.error = DepthError(self.referenced, sensor.mm_per_px) if self.referenced else None
        self.grids: TwoGridPoisson | None = None
        if self.referenced and (tiled := self.referenced.tiled_evaluator):
            self.grids = TwoGridPoisson(self.referenced.reference.shape, tiled.px, sensor.mm_per_px)
        self.taught: TaughtWalls | None = getattr(self.referenced, "walls", None)
        self.reference_match = ReferenceMatch(self.referenced) if self.referenced else None
        self.light_check: LightCheck | None = None
        self.inconsistency: Inconsistency | None = None
        self.frame_size_px: tuple[int, int] | None = None  # of raw frames, where it is known

    def height_map(self, frame: Frame | Bytes) -> HeightMap:
        """Depth (H, W) float32 of a raw frame in the rectified picture, positive into the gel, 0 where untouched.

        `frame` may be its pixels alone, (H, W, 3) uint8, red first.
        Pixels whose colour says nothing (dark, saturated) are invalid; the surface is carried over them. A picture
        unlike the reference is flagged (heightmap/reference_match.py).
        Raises InputError for a frame that is not of this sensor, black or saturated.
        """
        frame = as_frame(frame)
        return self.rectified_map(self.rectified(frame), time_s=frame.time_s, name=frame.name)

    def rectified(self, frame: Frame | Bytes) -> Bytes:
        """The rectified picture of a raw frame. Raises InputError for one of another size."""
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

    def rectified_map(self, rgb: Bytes, *, time_s: float = float("nan"), name: str = "") -> HeightMap:
        """The height map of a picture that is rectified already."""
        with self.turn.lock:
            surface, valid, std, flags = self._flagged(rgb)
            drift = self.evidence.drift if self.evidence else None
            where = self.inconsistency.inconsistent if self.inconsistency else None
        change = drift.normalised_residual if drift else None
        return HeightMap(
            surface,
            valid,
            self.sensor.mm_per_px,
            std,
            time_s,
            name,
            flags,
            colour_change=change,
            inconsistent=where,
        )

    def match_residuals(self, rgb: Bytes) -> tuple[float, ...]:
        """Misfit (no unit) and deviation of the zero plane in mm of a rectified picture (H, W, 3)."""
        with self.turn.lock:
            self.rectified_map(rgb)
            return self.reference_match.residuals if self.reference_match else tuple(DEFAULT_BASELINE.values())

    def _flagged(self, rgb: Bytes) -> Mapped:
        """As `_mapped`; a map that is deeper than the gel is thick says so."""
        gel = self.sensor.gel
        surface, valid, std, flags = self._mapped(rgb, law=WallLaw(self.readable, self.taught))
        if gel is not None and surface.max() > gel.thickness_mm:
            flags = add(flags, (DEEPER,))
        if stands_out(surface) or (self.inconsistency is not None and self.inconsistency.flagged):
            flags = add(flags, (INCONSISTENT,))
        if self.evidence and any(shades(edge) for edge in self.evidence.edges):
            flags = add(flags, (SHADOW,))
        if self.error and self.evidence and self.error.hides_much(surface, self.evidence):
            flags = add(flags, (STEEP,))
        return surface, valid, std, flags

    def _mapped(self, rgb: Bytes, *, law: WallLaw) -> Mapped:
        """Depth, validity and deviation (H, W) each of a rectified picture, its flags; walls by a `law`."""
        if self.grids and self.referenced and (tiled := self.referenced.tiled_evaluator):
            return self._on_two_grids(rgb, self.referenced, tiled, self.grids, law=law)
        slopes, untouched, drift, steepest, lost = self._evaluate_tiled(rgb)
        walls = self._walls(slopes, steepest, law)
        surface = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), self.sensor.mm_per_px)
        self.zero = self._zero_plane(surface, untouched, self.sensor.mm_per_px)
        level(surface, self.zero)
        std = self._std_mm(surface, steepest, lambda: slopes, walls=walls, drift=drift, lost_share=lost)
        valid = np.ones(surface.shape, np.bool_) if slopes.valid is None else slopes.valid
        return surface, valid, std, self._match_flags(drift)

    def _on_two_grids(
        self,
        rgb: Bytes,
        method: ReferencedMethod,
        reader: TiledEvaluator,
        grids: TwoGridPoisson,
        *,
        law: WallLaw,
    ) -> Mapped:
        """As `_mapped`, gentle gel on a coarse grid; slopes pixel by pixel are made for what asks for them."""
        tiles = reader.read_tiles(rgb)
        walls: list[PunchEdge] = []
        if tiles.steepest >= law.limit:
            walls = restore_windows(
                tiles.fine, tiles.windows, valid=tiles.valid, mm_per_px=self.sensor.mm_per_px, law=law
            )
        coarse = grids.coarse(tiles.coarse, tiles.windows, fine=tiles.fine)
        self.zero = self._zero_plane(coarse, tiles.drift.untouched, grids.coarse_mm)
        level(coarse, self.zero)
        tilt = slope_of(self.zero, coarse.shape, mm_per_px=grids.coarse_mm)
        surface = grids.whole(coarse, tiles.windows, fine=tiles.fine, tilt=tilt)
        std = self._std_mm(
            surface,
            tiles.steepest,
            lambda: reader.full_map(tiles),
            walls=walls,
            drift=tiles.drift,
            lost_share=tiles.lost_share,
        )
        return surface, tiles.valid, std, self._match_flags(tiles.drift)

    def _match_flags(self, drift: Drift | None) -> tuple[str, ...]:
        return self.reference_match.flags(drift, self.zero) if self.reference_match and self.zero else ()

    def depth_terms(self, height: HeightMap) -> dict[str, npt.NDArray[np.float32]]:
        """Deviation (h, w) mm by term (uncertainty/) of the `height` map, which must be the last that was made.

        On a grid of every nth pixel, n = `error.every`; empty for a method that states no deviation.
        """
        if self.error is None or self.evidence is None:
            return {}
        return self.error.terms_mm(height.depth_mm, self.evidence)

    def look(self, pictures: Sequence[Frame | Bytes]) -> None:
        """See by rectified pictures, in order, whether the reference is theirs, and free; warn and flag if not."""
        if (match := self.reference_match) is not None:
            frames = [as_frame(one) for one in pictures]
            pixels = [frame.rgb for frame in frames]
            before = self.calibration.method.reference if self.calibration else None
            said = match.check_scene(frames, before=before) + match.check_shift(pixels)
            self.warnings += said + check_reference(match, self.rectified_map, pictures=pixels)

    def _std_mm(
        self,
        depth: Planes,
        steepest: float,
        slopes: Callable[[], SlopeMap],
        *,
        walls: list[PunchEdge],
        drift: Drift | None,
        lost_share: Patch | None = None,
    ) -> Planes | None:
        if self.error is None or self.zero is None:
            return None
        hidden = slopes() if not walls and self.error.too_steep(steepest) else None
        self.inconsistency = self._check_light(depth, drift)
        unexplained = self.inconsistency.depth_mm if self.inconsistency else None
        self.evidence = MapEvidence(self.zero, hidden, walls, drift, lost_share, unexplained)
        return self.error.std_mm(depth, self.evidence)

    def _check_light(self, depth: Planes, drift: Drift | None) -> Inconsistency | None:
        """What of the frame read last the light does not explain; None of a map too flat to look.

        None, too, of a method whose balls did not tell the light's law: one of before, or by two colours alone.
        """
        low, high, *_ = cv2.minMaxLoc(depth)
        method = self.referenced
        if method is None or drift is None or max(-low, high) < MIN_CHECKED_MM:
            return None
        if method.light_law is None and method.card.balls:
            return None
        if self.light_check is None:
            self.light_check = LightCheck(method, self.sensor.mm_per_px)
        return self.light_check(drift)

    def _walls(self, slopes: SlopeMap, steepest: float, law: WallLaw) -> list[PunchEdge]:
        """The walls in `slopes`, which are restored there, in place."""
        if not law.limit <= steepest < np.inf:
            return []
        walls = find_punch_edges(slopes, self.sensor.mm_per_px, law=law)
        restore(slopes, walls, mm_per_px=self.sensor.mm_per_px)
        return walls

    def _zero_plane(self, depth: npt.NDArray[Any], untouched: Bools, mm_per_px: Pair) -> ZeroPlane:
        gel, trusted = self.sensor.gel, self.referenced.trusted_blocks if self.referenced else None
        thickness = gel.thickness_mm if gel else None
        return find_zero_plane(depth, untouched, mm_per_px=mm_per_px, thickness_mm=thickness, trusted=trusted)

    def slope_map(self, frame: Frame | Bytes) -> SlopeMap:
        """The slopes (H, W) that a raw frame shows, before any integration. Raises as height_map does."""
        rgb = self.rectified(frame)
        with self.turn.lock:
            return self.referenced.read(rgb).slopes if self.referenced else self.method.slopes(rgb)

    def follow(self, rgb: Bytes, share: float) -> None:
        """Move the reference towards a rectified picture of the untouched gel by `share` of their difference."""
        if self.referenced:
            self.referenced.follow(rgb, share)
            self.light_check = None

    def _evaluate_tiled(self, rgb: Bytes) -> tuple[SlopeMap, Bools, Drift | None, float, Patch | None]:
        """Slopes, untouched blocks, drift, greatest |slope| and `lost_share`, where they are known."""
        if self.referenced is None:
            slopes = self.method.slopes(rgb)
            return slopes, flat_blocks(slopes), None, np.inf, None
        reading = self.referenced.read(rgb)
        return reading.slopes, reading.drift.untouched, reading.drift, reading.steepest, reading.lost_share
