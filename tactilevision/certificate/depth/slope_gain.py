"""What the slopes behind a depth may be off by, as the photometric method's card states it."""

from __future__ import annotations

import numpy as np

from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.method import as_referenced
from tactilevision.uncertainty.depth_scale import gain_std

UNKNOWN_GAIN = 0.1  # relative std of slopes where no card states it
MIN_GAIN = 0.01  # relative std that no ring of slopes undercuts; benchmarks.nu_from_frames
RING_SHARE = 0.25  # of the picture, and so of the balls, that a ring averages
BALL_SLOPE = 0.3  # mm/mm, a slope that most light calibrations hold


def ring_gain_std(method: object) -> float:
    """Relative std of slopes averaged over a ring: the balls' scatter over the balls that such a ring averages."""
    card = _card(method)
    if card.balls is None:
        return UNKNOWN_GAIN
    single = _relative_error(method) if card.held_out_gain_std is None else card.held_out_gain_std
    return max(MIN_GAIN, single / float(np.sqrt(max(RING_SHARE * float(card.balls), 1.0))))


def ball_slope(method: object) -> float:
    """Steepest slope (mm/mm) that the light was calibrated with."""
    steepest = _card(method).steepest_slope
    return BALL_SLOPE if steepest is None else steepest


def shared_depth_std(track: PressTrack, method: object) -> float:
    """Relative std of a face's reconstructed depth that all presses share; NaN where no map states one.

    The height map's std counts the scale of a single ball as unsure. What all presses share is the scale's mean
    over the balls that it was made from.
    """
    face, height = track.footprint, track.face_map
    if face is None or height.std_mm is None:
        return float("nan")
    inside = face.mask & height.valid & (height.depth_mm > 0)
    if not inside.any():
        return float("nan")
    whole = float(np.median(height.std_mm[inside] / height.depth_mm[inside]))
    card = _card(method)
    single, balls = gain_std(card, 0.0), max(float(card.balls or 1), 1.0)
    rest = max(whole**2 - single**2, 0.0)
    return float(np.sqrt(rest + single**2 / balls))


def _card(method: object) -> MethodCard:
    referenced = as_referenced(method)
    return MethodCard() if referenced is None else referenced.card


def _relative_error(method: object) -> float:
    return float(getattr(method, "relative_error", UNKNOWN_GAIN))
