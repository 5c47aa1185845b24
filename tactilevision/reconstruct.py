"""Sensor in, frame in, height map out.

rectify -> slopes (photometric) -> surface (Poisson) -> zero plane of the untouched gel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric import PHOTOMETRIC, BallPicture, Calibration, calibrate_from_balls, make_reference
from tactilevision.photometric.method import CalibratedMethod, PhotometricMethod
from tactilevision.records import Bools, Bytes, Frame, HeightMap, Sensor, SlopeMap
from tactilevision.sensors import rectify
from tactilevision.surface import integrate
from tactilevision.zero_plane import ZeroPlane, find_zero_plane, level

if TYPE_CHECKING:
    from tactilevision.recording import Recording

SLOPE_BLOCKS = 600


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

    def height_map(self, frame: Frame) -> HeightMap:
        """Depth (H, W) float32 of a raw frame in the rectified picture, positive into the gel, 0 where untouched.

        Pixels whose colour says nothing (dark, saturated) are invalid; the surface is carried over them.
        Raises InputError for a frame that is not of this sensor, black or saturated.
        """
        slopes, untouched = self._read(rectify(self.sensor, frame.rgb))
        surface = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), self.sensor.mm_per_px)
        gel = self.sensor.gel
        self.zero = find_zero_plane(
            surface, untouched, self.sensor.mm_per_px, thickness_mm=gel.thickness_mm if gel else None
        )
        level(surface, self.zero)
        valid = np.ones(surface.shape, np.bool_) if slopes.valid is None else slopes.valid
        return HeightMap(surface, valid, self.sensor.mm_per_px, time_s=frame.time_s, name=frame.name)

    def _read(self, rgb: Bytes) -> tuple[SlopeMap, Bools]:
        if isinstance(self.method, CalibratedMethod):
            reading = self.method.read(rgb)
            size = reading.drift.untouched.shape[::-1]
            told = cv2.resize(self.method.calm, size, interpolation=cv2.INTER_AREA) > 0.95
            return reading.slopes, reading.drift.untouched & told
        slopes = self.method.slopes(rgb)
        return slopes, _flat_blocks(slopes)


def _flat_blocks(slopes: SlopeMap) -> Bools:
    """Blocks (h, w) of the picture where the mean slope does not stand out."""
    height, width = slopes.dz_dx.shape
    block = max(4, int(np.sqrt(height * width / SLOPE_BLOCKS)))
    size = (max(2, width // block), max(2, height // block))
    p, q = (
        cv2.resize(np.asarray(s, np.float32), size, interpolation=cv2.INTER_AREA)
        for s in (slopes.dz_dx, slopes.dz_dy)
    )
    steep = np.hypot(p - np.median(p), q - np.median(q))
    return np.asarray(steep < 4.0 * np.median(steep) + 1e-3)


def build_reconstructor(recording: Recording, method: str | PhotometricMethod = "polynomial") -> Reconstructor:
    """A reconstructor calibrated on the recording's own flats and ball presses.

    `method` is a name in PHOTOMETRIC, or a ready method (for instance of `photometric.load_method`), which then is
    used against the recording's flats where it can be. Raises InputError or RecordingError where the
    reference is missing or cannot be used.
    """
    from tactilevision.recording import read_image

    sensor = recording.sensor
    flats = [rectify(sensor, read_image(path, white_level=recording.white_level)) for path in recording.flats]
    if not isinstance(method, str):
        return with_flats(sensor, method, flats) if flats else Reconstructor(sensor, method)
    if method not in PHOTOMETRIC:
        raise InputError(
            "no photometric method of that name",
            where="build_reconstructor",
            value=method,
            remedy="Known are " + ", ".join(PHOTOMETRIC) + ".",
        )
    reference = make_reference(flats)
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
    calibration = calibrate_from_balls(reference, pictures, sensor.mm_per_px, fit=PHOTOMETRIC[method])
    return Reconstructor(sensor, calibration.method, calibration=calibration)


def with_flats(sensor: Sensor, method: PhotometricMethod, flats: Sequence[Bytes]) -> Reconstructor:
    """A reconstructor of a ready method against rectified pictures of the untouched gel as it is today."""
    if isinstance(method, CalibratedMethod):
        return Reconstructor(sensor, method.with_reference(make_reference(flats)))
    return Reconstructor(sensor, method)
