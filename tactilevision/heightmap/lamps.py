"""Fit the lamps of a sensor to its ball presses."""

from __future__ import annotations

from dataclasses import replace
from typing import cast
from weakref import WeakKeyDictionary

import numpy as np

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_samples import ball_samples, join
from tactilevision.photometric.calibrate import Calibration
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.illumination.glossy_lamps import fit_glossy_lamps
from tactilevision.photometric.illumination.lamps import BEST_MISFIT, Lamps, fit_lamps
from tactilevision.photometric.method import CalibratedMethod, ReferencedMethod
from tactilevision.recording.model import BallPress, Recording
from tactilevision.recording.pictures import read_reference
from tactilevision.records.measured import Floats
from tactilevision.sensors.rectification import rectify

MAX_SAMPLES = 300  # samples of one ball
# of each reconstructor the balls, the method and the lamps that they told: several steps ask, and it takes seconds
_FOUND: WeakKeyDictionary[Reconstructor, tuple[tuple[BallPress, ...], ReferencedMethod, Lamps | None]] = (
    WeakKeyDictionary()
)


def find_lamps(recording: Recording, reconstructor: Reconstructor) -> Lamps | None:
    """Lamps that explain the balls, or those of the method's file; None where neither tells them.

    With the same lamps `refined` for lengths of shadows, where balls tell them.
    Raises InputError where a ball's picture can no longer be read.
    """
    method, calibration = reconstructor.referenced, reconstructor.calibration
    kept: Lamps | None = getattr(method, "lamps", None)
    if kept is not None:
        return kept
    if method is None or calibration is None or len(recording.balls) != len(calibration.balls):
        return None
    before = _FOUND.get(reconstructor)
    if before is None or before[0] is not recording.balls or before[1] is not method:
        before = _FOUND[reconstructor] = (recording.balls, method, _of_balls(recording, method, calibration))
    return before[2]


def _of_balls(recording: Recording, method: ReferencedMethod, calibration: Calibration) -> Lamps | None:
    """The lamps that the pictures of balls tell."""
    change, rng, parts, heights = ColourChange(method.reference), np.random.default_rng(0), [], []
    mm_per_px = recording.sensor.mm_per_px
    for number, (record, ball) in enumerate(zip(recording.balls, calibration.balls, strict=True)):
        if ball is None:
            continue
        picture = rectify(recording.sensor, read_reference(recording, record.path))
        changes, _, valid = change.measure(picture)
        parts.append(
            ball_samples(changes, ball, mm_per_px=mm_per_px, number=number, most=MAX_SAMPLES, valid=valid, rng=rng)
        )
        heights.append(_height_mm(ball, parts[-1].slopes, mm_per_px[0]))
    if not parts:
        return None
    balls, seen = join(parts), method.reference
    lamps = fit_lamps(balls.change, balls.slopes, place=balls.place, reference=seen, mm_per_px=mm_per_px)
    if lamps is None or not lamps.misfit < BEST_MISFIT:
        return None
    if lamps.doubtful:
        return lamps
    refined = fit_glossy_lamps(
        balls.change,
        balls.slopes,
        height_mm=np.concatenate(heights),
        place=balls.place,
        reference=seen,
        mm_per_px=mm_per_px,
        like=lamps,
    )
    return replace(lamps, refined=refined if refined and refined.misfit < BEST_MISFIT else None)


def with_lamps(recording: Recording, reconstructor: Reconstructor, method: ReferencedMethod) -> ReferencedMethod:
    """The method with the lamps that its balls tell, by which shadows are undone in frames that show them."""
    lamps = find_lamps(recording, reconstructor)
    return method if lamps is None else replace(cast(CalibratedMethod, method), lamps=lamps)


def _height_mm(ball: Ball, slopes: Floats, mm_per_px: float) -> Floats:
    """How high (N,) the gel stands where a ball has these slopes (N, 2): by Hertz a^2/R in the middle."""
    contact_mm, radius_mm = ball.contact_radius_px * mm_per_px, ball.radius_mm
    down = 1.0 - 1.0 / np.sqrt(1.0 + np.sum(slopes**2, axis=1))
    return np.asarray(contact_mm**2 / radius_mm - radius_mm * down)
