"""Sensor in, frame in, height map out.

rectify -> slopes (photometric) -> steep walls round flat faces restored -> surface (Poisson) -> zero plane of the
untouched gel.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.depth_error import DepthError, untouched_std_mm
from tactilevision.errors import InputError
from tactilevision.free_gel import free_frames, settle, tare, untouched_of
from tactilevision.held_out_depth import held_out_depth, seen_gain_std
from tactilevision.likeness import UNTOLD, Likeness, some_frames, usual_of
from tactilevision.photometric import (
    PHOTOMETRIC,
    BallPicture,
    Calibration,
    calibrate_from_balls,
    load_method,
    load_network,
    make_reference,
)
from tactilevision.photometric.ball import Ball
from tactilevision.photometric.calm import CalmReader
from tactilevision.photometric.change import Planes
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.light import check_view, light_of, other_light
from tactilevision.photometric.method import CalibratedMethod, PhotometricMethod
from tactilevision.photometric.samples import far_from
from tactilevision.records import Bools, Bytes, Frame, HeightMap, Pair, Sensor, SlopeMap
from tactilevision.sensors import may_have_marks, rectify
from tactilevision.spread import spread_beside
from tactilevision.surface import integrate
from tactilevision.touched_reference import look_at_reference
from tactilevision.two_grids import TwoGrids
from tactilevision.walls import Wall, find_walls, restore, restore_windows
from tactilevision.weights import find_model
from tactilevision.zero_plane import ZeroPlane, find_zero_plane, flat_blocks, level, slope_of

if TYPE_CHECKING:
    from tactilevision.gpu.reader import TorchReader
    from tactilevision.recording import Recording

Mapped = tuple[npt.NDArray[np.floating[Any]], Bools, npt.NDArray[np.floating[Any]] | None, tuple[str, ...]]
DEFAULT = "polynomial"
MOST_WAVES = 8
# of the steepest slope that was calibrated: what a blurred picture shows of steeper ones is too little
READABLE = 0.8


class Reconstructor:
    """Turns the frames of one sensor into height maps. Not thread-safe: make one for each thread.

    `calibration` is what the method was made from, None for a method that came ready.
    """

    def __init__(
        self, sensor: Sensor, method: PhotometricMethod, *, calibration: Calibration | None = None
    ) -> None:
        self.sensor, self.method, self.calibration = sensor, method, calibration
        self.warnings: tuple[str, ...] = calibration.warnings if calibration else ()
        self.zero: ZeroPlane | None = None
        steepest = method.card.get("steepest_slope") if isinstance(method, CalibratedMethod) else None
        self.readable = READABLE * float(steepest) if steepest else None
        self.error = DepthError(method, sensor.mm_per_px) if isinstance(method, CalibratedMethod) else None
        self.grids: TwoGrids | None = None
        if isinstance(method, CalibratedMethod) and method.calm_reader:
            self.grids = TwoGrids(method.reference.shape, method.calm_reader.px, sensor.mm_per_px)
        self.elsewhere: TorchReader | None = None
        self.likeness = Likeness(method) if isinstance(method, CalibratedMethod) else None

    def height_map(self, frame: Frame) -> HeightMap:
        """Depth (H, W) float32 of a raw frame in the rectified picture, positive into the gel, 0 where untouched.

        Pixels whose colour says nothing (dark, saturated) are invalid; the surface is carried over them. A picture
        unlike the reference is flagged (likeness.py).
        Raises InputError for a frame that is not of this sensor, black or saturated.
        """
        surface, valid, std, flags = self._mapped(self.rectified(frame))
        return HeightMap(surface, valid, self.sensor.mm_per_px, std, frame.time_s, frame.name, flags)

    def rectified(self, frame: Frame) -> Bytes:
        """The rectified picture of a raw frame."""
        return rectify(self.sensor, frame.rgb)

    def rectified_map(self, rgb: Bytes) -> HeightMap:
        """The height map of a picture that is rectified already."""
        surface, valid, std, flags = self._mapped(rgb)
        return HeightMap(surface, valid, self.sensor.mm_per_px, std, flags=flags)

    def _mapped(self, rgb: Bytes) -> Mapped:
        """Depth, validity and deviation (H, W) each of a rectified picture, and its flags."""
        if self.grids and isinstance(self.method, CalibratedMethod) and self.method.calm_reader:
            return self._on_two_grids(rgb, self.method, self.method.calm_reader, self.grids)
        slopes, untouched, drift, steepest, surface = self._glance(rgb)
        walls = self._walls(slopes, steepest)
        if surface is None or walls:
            surface = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), self.sensor.mm_per_px)
        self.zero = self._zero_plane(surface, untouched, self.sensor.mm_per_px)
        level(surface, self.zero)
        std = self._std_mm(surface, steepest, lambda: slopes, walls=walls, drift=drift)
        valid = np.ones(surface.shape, np.bool_) if slopes.valid is None else slopes.valid
        return surface, valid, std, self.likeness.flags(drift, self.zero) if self.likeness else ()

    def _on_two_grids(self, rgb: Bytes, method: CalibratedMethod, reader: CalmReader, grids: TwoGrids) -> Mapped:
        """As `_mapped`, calm gel on a coarse grid; slopes pixel by pixel are made for what asks for them."""
        look = self.elsewhere.look(rgb) if self.elsewhere else reader.look(rgb)
        walls: list[Wall] = []
        if self.readable is not None and look.steepest >= self.readable:
            walls = restore_windows(look.fine, look.windows, look.valid, self.sensor.mm_per_px, self.readable)
        coarse = grids.coarse(look.coarse, look.windows, look.fine)
        self.zero = self._zero_plane(coarse, look.drift.untouched & method.told, grids.coarse_mm)
        level(coarse, self.zero)
        tilt = slope_of(self.zero, coarse.shape, grids.coarse_mm)
        surface = grids.whole(coarse, look.windows, look.fine, tilt=tilt)
        std = self._std_mm(surface, look.steepest, lambda: reader.whole(look), walls=walls, drift=look.drift)
        return surface, look.valid, std, self.likeness.flags(look.drift, self.zero) if self.likeness else ()

    def look(self, pictures: Sequence[Bytes]) -> None:
        """See by rectified pictures whether the reference is theirs, and free; warn, and flag maps, if not."""
        if self.likeness is not None:
            self.warnings += (*self.likeness.look(pictures), *look_at_reference(self, pictures))

    def _std_mm(
        self,
        depth: Planes,
        steepest: float,
        slopes: Callable[[], SlopeMap],
        *,
        walls: list[Wall],
        drift: Drift | None,
    ) -> Planes | None:
        if self.error is None or self.zero is None:
            return None
        hidden = slopes() if not walls and self.error.too_steep(steepest) else None
        return self.error.std_mm(depth, self.zero, slopes=hidden, walls=walls, drift=drift)

    def _walls(self, slopes: SlopeMap, steepest: float) -> list[Wall]:
        """The walls in `slopes`, which are restored there, in place."""
        if self.readable is None or steepest < self.readable:
            return []
        walls = find_walls(slopes, self.sensor.mm_per_px, self.readable)
        restore(slopes, walls, self.sensor.mm_per_px)
        return walls

    def _zero_plane(self, depth: npt.NDArray[Any], untouched: Bools, mm_per_px: Pair) -> ZeroPlane:
        gel = self.sensor.gel
        return find_zero_plane(depth, untouched, mm_per_px, thickness_mm=gel.thickness_mm if gel else None)

    def slope_map(self, frame: Frame) -> SlopeMap:
        """The slopes (H, W) that a raw frame shows, before any integration. Raises as height_map does."""
        rgb = self.rectified(frame)
        return (
            self.method.read(rgb).slopes if isinstance(self.method, CalibratedMethod) else self.method.slopes(rgb)
        )

    def follow(self, rgb: Bytes, share: float) -> None:
        """Move the reference towards a rectified picture of the untouched gel by `share` of their difference."""
        if isinstance(self.method, CalibratedMethod):
            self.method.follow(rgb, share)
            if self.elsewhere is not None:
                self.elsewhere.follow()

    def use(self, device: str) -> bool:
        """Read frames on torch's `device` from here on; False where torch cannot be told how."""
        from tactilevision.gpu.reader import TorchReader

        if isinstance(self.method, CalibratedMethod):
            with suppress(LookupError):
                self.elsewhere = TorchReader(self.method, self.sensor.mm_per_px, device)
                return True
        return False

    def _glance(self, rgb: Bytes) -> tuple[SlopeMap, Bools, Drift | None, float, npt.NDArray[Any] | None]:
        """Slopes, untouched blocks, the drift, the greatest |slope|, and the surface, where they are known."""
        if not isinstance(self.method, CalibratedMethod):
            slopes = self.method.slopes(rgb)
            return slopes, flat_blocks(slopes), None, np.inf, None
        reading, surface = self.elsewhere.read(rgb) if self.elsewhere else (self.method.read(rgb), None)
        untouched = reading.drift.untouched & self.method.told
        return reading.slopes, untouched, reading.drift, reading.steepest, surface


def build_reconstructor(recording: Recording, method: str | PhotometricMethod | None = None) -> Reconstructor:
    """A reconstructor calibrated on the recording's own flats and ball presses.

    It warns where the recording's frames lie beside the reference, or show a contact in it. `method` is a name in
    PHOTOMETRIC, the path of a saved method, or a ready one; a ready one is used against the recording's flats
    where there are some. None: DEFAULT on the recording's balls or, without any, the method trained beforehand
    for this kind of sensor, which its warnings then say. Raises InputError or RecordingError where the reference
    is missing or cannot be used.
    """
    found = _built(recording, method)
    found.look([*some_frames(recording), *free_frames(recording)])
    return found


def _built(recording: Recording, method: str | PhotometricMethod | None) -> Reconstructor:
    from tactilevision.recording import read_image

    sensor = recording.sensor
    flats = [rectify(sensor, read_image(path, white_level=recording.white_level)) for path in recording.flats]
    if isinstance(method, str) and method not in PHOTOMETRIC:
        return _saved(method, sensor, flats)
    if method is None and not recording.balls:
        return _uncalibrated(recording, flats)
    if method is not None and not isinstance(method, str):
        return with_flats(sensor, method, flats) if flats else Reconstructor(sensor, method)
    fit = PHOTOMETRIC[method or DEFAULT]
    reference = make_reference(flats, may_have_marks=may_have_marks(sensor))
    pictures = [
        BallPicture(
            rectify(sensor, read_image(ball.path, white_level=recording.white_level)),
            ball.ball_radius_mm,
            ball.centre_px,
            ball.contact_radius_px,
            ball.path.name,
        )
        for ball in recording.balls
    ]
    calibration = calibrate_from_balls(reference, pictures, sensor.mm_per_px, fit=fit)
    return tuned(sensor, calibration, pictures, free_frames(recording))


def tuned(
    sensor: Sensor, calibration: Calibration, pictures: Sequence[BallPicture], free: Sequence[Bytes]
) -> Reconstructor:
    """The reconstructor of a calibration, made to fit rectified frames of the free gel, its errors measured.

    How far untouched gel is from flat is told, place by place, by the `free` frames where there are enough of
    them, else by the ball pictures.
    """
    gain = seen_gain_std(calibration.method, pictures, calibration.balls, sensor.mm_per_px)
    card = {**calibration.method.card, "sensor": sensor.kind, "seen_gain_std": gain}
    card |= held_out_depth(calibration, pictures, sensor.mm_per_px, seen_gain=gain)
    card["spread"] = _spread(sensor, calibration, pictures)
    method = dataclasses.replace(calibration.method, card=card)
    settled = settle(dataclasses.replace(method, reference=tare(method, free)), free)
    if settled.quiet is method.quiet:
        waves_mm = untouched_rms_mm(Reconstructor(sensor, method), pictures, calibration.balls)
        settled = dataclasses.replace(settled, card={**card, "untouched_depth_rms_mm": waves_mm})
    else:
        reader = Reconstructor(sensor, settled)
        flat = [reader.rectified_map(rgb).depth_mm for rgb in untouched_of(method, free)]
        std_mm = np.round(untouched_std_mm(flat), 6).tolist()
        settled = dataclasses.replace(settled, card={**settled.card, "untouched_std_mm": std_mm})
    usual = usual_of(Reconstructor(sensor, settled), [*(picture.rgb for picture in pictures), *free])
    settled = dataclasses.replace(settled, card={**settled.card, "usual": usual})
    return Reconstructor(sensor, settled, calibration=calibration)


def _spread(sensor: Sensor, calibration: Calibration, pictures: Sequence[BallPicture]) -> float:
    """How far errors of slope reach beside a contact, by laws that never saw a third of the balls."""
    method = calibration.method
    others = [dataclasses.replace(method, law=law) for law in calibration.other_laws]
    maps = [partial(_depth, Reconstructor(sensor, made)) for made in (method, *others)]
    gain = np.array(method.card["place_gain_std"]) / method.card["place_gain_borne_out"]
    return spread_beside(maps, pictures, balls=calibration.balls, gain=gain, mm_per_px=sensor.mm_per_px)


def _depth(reader: Reconstructor, rgb: Bytes) -> npt.NDArray[Any]:
    return reader.rectified_map(rgb).depth_mm


def _saved(name: str, sensor: Sensor, flats: Sequence[Bytes]) -> Reconstructor:
    path = Path(name)
    if path.with_suffix(".npz").is_file():
        method = load_method(path)
        _check_kind(method.card, sensor)
        return with_flats(sensor, method, flats) if flats else Reconstructor(sensor, method)
    if path.with_suffix(".onnx").is_file():
        return _without_balls(sensor, path, flats)
    raise InputError("no photometric method of that name, nor a saved one there", where="method", value=name,
                     remedy="Known are " + ", ".join(PHOTOMETRIC) + ".")  # fmt: skip


def _uncalibrated(recording: Recording, flats: Sequence[Bytes]) -> Reconstructor:
    sensor = recording.sensor
    path = find_model(_family(sensor.kind))
    if path is None or not flats:
        missing = "ball presses to calibrate the light from" if flats else "picture of the untouched gel"
        raise InputError(
            f"no {missing}", where=recording.path / "reference" / ("ball" if flats else "flat"),
            value=f"sensor {sensor.kind}", remedy="Add them to the recording, or name a saved method.",
        )  # fmt: skip
    found = _without_balls(sensor, path, flats)
    found.warnings = (f"no ball presses: depth rests on the light of a usual {sensor.kind}, not of this one",)
    return found


def _without_balls(sensor: Sensor, path: Path, flats: Sequence[Bytes]) -> Reconstructor:
    reference = make_reference(flats, may_have_marks=may_have_marks(sensor))
    method = load_network(path, reference)
    _check_kind(method.card, sensor)
    found = Reconstructor(sensor, method)
    found.likeness = Likeness(method, usual=UNTOLD)
    if "light" in method.card:  # else it was made for any light
        found.warnings = other_light(method.card["light"], reference, method.relative_error)
    return found


def _check_kind(card: Mapping[str, Any], sensor: Sensor) -> None:
    """A method of one kind of light says nothing of another; a custom sensor is its owner's affair."""
    kinds = _family(str(card.get("sensor", "custom"))), _family(sensor.kind)
    if "custom" not in kinds and kinds[0] != kinds[1]:
        raise InputError("the method was made for another sensor", where="method", value=f"{kinds[0]}, the "
                         f"recording's is {kinds[1]}", remedy="Train one on this sensor's balls.")  # fmt: skip


def _family(kind: str) -> str:
    """Sensors that differ in their marks alone share their light."""
    return kind.removesuffix("_markers")


def untouched_rms_mm(
    reconstructor: Reconstructor, pictures: Sequence[BallPicture], balls: Sequence[Ball | None]
) -> float:
    """How far from flat untouched gel comes out: the median over ball pictures, away from the ball, mm."""
    found = []
    for picture, ball in list(zip(pictures, balls, strict=True))[:MOST_WAVES]:
        if ball is not None:
            height = reconstructor.rectified_map(picture.rgb)
            away = far_from(ball, height.depth_mm.shape, reconstructor.sensor.mm_per_px) & height.valid
            if away.any():
                found.append(float(np.sqrt(np.mean(np.square(height.depth_mm[away])))))
    return float(np.median(found)) if found else 0.0


def with_flats(sensor: Sensor, method: PhotometricMethod, flats: Sequence[Bytes]) -> Reconstructor:
    """A reconstructor of a ready method against rectified pictures of the untouched gel as it is today.

    Warns where the method was made in another light. Raises InputError where it was made for another view.
    """
    if not isinstance(method, CalibratedMethod):
        return Reconstructor(sensor, method)
    reference = make_reference(flats, may_have_marks=may_have_marks(sensor))
    check_view(method.reference.shape, reference.shape)
    found = Reconstructor(sensor, method.with_reference(reference))
    found.warnings = other_light(light_of(method.reference), reference, method.relative_error)
    return found
