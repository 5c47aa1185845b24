"""The lamps of a recording's sensor, from its own ball presses."""

from __future__ import annotations

import numpy as np

from tactilevision.photometric.ball.samples import ball_samples, join
from tactilevision.photometric.illumination.colour_change import ColourChange
from tactilevision.photometric.illumination.lamps import Lamps, fit_lamps
from tactilevision.reconstruct.reconstructor import Reconstructor
from tactilevision.recording import Recording, read_image
from tactilevision.sensors import rectify

MAX_SAMPLES = 300  # samples of one ball
BEST_MISFIT = 3.0  # stated deviations: balls that fit worse are lit by something else than three near lamps


def find_lamps(recording: Recording, reconstructor: Reconstructor) -> Lamps | None:
    """Three lamps that explain the balls, or those of the method's file; None where neither tells them.

    Raises InputError where a ball's picture can no longer be read.
    """
    method, calibration = reconstructor.referenced, reconstructor.calibration
    kept: Lamps | None = getattr(method, "lamps", None)
    if kept is not None:
        return kept
    if method is None or calibration is None or len(recording.balls) != len(calibration.balls):
        return None
    change, rng, parts = ColourChange(method.reference), np.random.default_rng(0), []
    for number, (record, ball) in enumerate(zip(recording.balls, calibration.balls, strict=True)):
        if ball is None:
            continue
        picture = rectify(recording.sensor, read_image(record.path, white_level=recording.white_level))
        changes, _, valid = change.measure(picture)
        mm_per_px = recording.sensor.mm_per_px
        parts.append(
            ball_samples(changes, ball, mm_per_px=mm_per_px, number=number, most=MAX_SAMPLES, valid=valid, rng=rng)
        )
    if not parts:
        return None
    balls = join(parts)
    lamps = fit_lamps(
        balls.change,
        balls.slopes,
        place=balls.place,
        reference=method.reference,
        mm_per_px=recording.sensor.mm_per_px,
    )
    return lamps if lamps is not None and lamps.misfit < BEST_MISFIT else None
