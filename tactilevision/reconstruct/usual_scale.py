"""Are balls as large as they are stated? Alike ones do not tell each other, a usual light of their sensor does.

Slopes of balls stated k times too large are 1/k of what the picture shows. A ready network, which knows no ball,
reads them at .82 to 1.32 times the stated ones on eight real sensors, so at 1.6 to 2.6 times where a diameter is
stated for the radius. Under another light it reads less, .56 times on the simulated sample, never more: too little
says nothing of the radius.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactilevision.photometric.ball.detection import Ball, ball_slopes
from tactilevision.photometric.ball.samples import INSIDE, radii_from
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.records import Bytes, Floats, Pair

MAX_PICTURES = 8  # that are read, spread evenly
MIN_ALIKE = 0.7  # cosine between slopes read and stated, the median over balls
MAX_GAIN = 1.5  # 2.5 deviations of eight real sensors' scales, which scatter by 16 %


def usual_scale_warnings(
    network: PhotometricMethod,
    pictures: Sequence[Bytes],
    *,
    balls: Sequence[Ball | None],
    mm_per_px: Pair,
    kind: str,
) -> tuple[str, ...]:
    """A warning where `balls` slope far more than stated, read by the `network` of a `kind` of sensor.

    None where the network points elsewhere than the balls: then it is no such sensor, or a mirrored picture.
    """
    known = [(rgb, ball) for rgb, ball in zip(pictures, balls, strict=True) if ball is not None]
    if not known:
        return ()
    some = np.unique(np.linspace(0, len(known) - 1, min(MAX_PICTURES, len(known))).astype(int))
    read = np.array([_products(network, *known[number], mm_per_px=mm_per_px) for number in some])
    both, found, stated = read.T
    if np.median(both / np.sqrt(found * stated)) < MIN_ALIKE:
        return ()
    gain = float(np.median(both / stated))
    if gain < MAX_GAIN:
        return ()
    return (
        f"by the light of a usual {kind} the balls' slopes are {gain:.2g} times the stated ones: is a diameter "
        "stated for ball_radius_mm, or is it another kind of sensor? Depth is off by as much",
    )


def _products(network: PhotometricMethod, rgb: Bytes, ball: Ball, *, mm_per_px: Pair) -> Floats:
    """Sums under one ball (3,): slopes read times stated ones, read ones squared, stated ones squared."""
    read = network.slopes(rgb)
    inside = radii_from(ball, read.dz_dx.shape, mm_per_px=mm_per_px) < INSIDE
    under = rows, columns = np.nonzero(inside if read.valid is None else inside & read.valid)
    places: Floats = (np.array([columns, rows]).T - ball.centre_px) * mm_per_px
    x, y = places.T
    contact_mm = ball.contact_radius_px * mm_per_px[0]
    stated = np.stack(ball_slopes(x, y, contact_mm=contact_mm, radius_mm=ball.radius_mm))
    found = np.stack([read.dz_dx[under], read.dz_dy[under]])
    return np.array([np.sum(found * stated), np.sum(found**2), np.sum(stated**2)]) + 1e-12
