"""Calibrated light in the cache, under a hash of the pictures and of the sensor that it was made from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy.typing as npt

from tactilevision.files.cache import kept
from tactilevision.files.documents import parse_json
from tactilevision.files.writing import as_json
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import Calibration
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.reference import Reference
from tactilevision.photometric.storage import pack_method, unpack_method
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Sensor

ABOUT = "calibration.json"  # name of the file with balls, errors and warnings
WHERE = Path("the cache of calibrated light")


def kept_light(
    sensor: Sensor,
    fit: str,
    reference: Reference,
    *,
    pictures: Sequence[BallPicture],
    free: Sequence[Bytes],
    make: Callable[[], Reconstructor],
) -> Reconstructor:
    """Return the reconstructor that `make` calibrates: restored from the cache, else made and kept.

    `fit` is the method's name; `pictures` and the `free` frames (H, W, 3) are rectified. The first use is restored
    from the same bytes as every later one.
    """
    digest = sha256()
    seen: list[npt.NDArray[Any]] = [reference.rgb, *(picture.rgb for picture in pictures), *free]
    for rgb in seen:
        digest.update(repr((rgb.shape, rgb.dtype)).encode())
        digest.update(rgb.tobytes())
    balls = [(one.radius_mm, one.centre_px, one.contact_radius_px, one.name) for one in pictures]
    seen_by = replace(sensor, rectification=None)  # the pictures are rectified
    key = fit, repr(seen_by), reference.marks is None, balls, digest.hexdigest()
    return _restored(kept("light", key, make=lambda: _packed(make())), sensor, reference)


def _packed(made: Reconstructor) -> dict[str, bytes]:
    calibration, method = made.calibration, made.referenced
    assert calibration is not None
    assert method is not None
    about = {
        "balls": [None if ball is None else asdict(ball) for ball in calibration.balls],
        "direction_error_deg": calibration.direction_error_deg,
        "slope_error": calibration.slope_error,
        "calibration_warnings": calibration.warnings,
        "warnings": made.warnings,
    }
    return {f"method{suffix}": content for suffix, content in pack_method(method, small=False).items()} | {
        ABOUT: as_json(about).encode()
    }


def _restored(files: Mapping[str, bytes], sensor: Sensor, reference: Reference) -> Reconstructor:
    card = MethodCard.from_json(parse_json(files["method.json"], where=WHERE))
    method = unpack_method(card, files["method.npz"], files.get("method.onnx"), where=WHERE)
    about = parse_json(files[ABOUT], where=WHERE)
    balls = tuple(None if one is None else _ball(one) for one in about["balls"])
    calibration = Calibration(
        replace(method, reference=reference),
        balls,
        about["direction_error_deg"],
        about["slope_error"],
        tuple(about["calibration_warnings"]),
    )
    return Reconstructor(sensor, method, calibration=calibration, warnings=tuple(about["warnings"]))


def _ball(stored: Mapping[str, object]) -> Ball:
    return Ball(**{**stored, "centre_px": tuple(stored["centre_px"])})  # type: ignore[arg-type]
