"""Reference pictures: the untouched gel, and balls pressed into it here and there."""

from __future__ import annotations

import numpy as np

from tactilevision.records import Bytes, Pair
from tactilevision.synthetic.ball import BallPress
from tactilevision.synthetic.camera import Imaging
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.options import GelOptions

_AVERAGED = 16  # frames in one reference picture: the gel stands still, so one averages


def picture_still(camera: Imaging, surface: BallPress | Flat, *, rng: np.random.Generator) -> Bytes:
    """A reference picture: the mean of several frames, raw geometry, (H, W, 3) uint8."""
    return camera.expose(camera.ideal(surface), rng, averaged=_AVERAGED)


def plan_balls(
    count: int, radii_mm: tuple[float, ...], *, half_mm: Pair, gel: GelOptions, rng: np.random.Generator
) -> tuple[BallPress, ...]:
    """Ball presses over the whole field, by a sequence that fills it evenly (R2), radii in turn."""
    start = rng.random(2)
    steps = np.array([0.7548776662466927, 0.5698402909980532])
    balls = []
    for i in range(count):
        place = ((start + i * steps) % 1.0) * 2 - 1
        place = np.sign(place) * np.abs(place) ** 1.25  # closer together where the presses are
        radius = radii_mm[i % len(radii_mm)]
        contact = float(radius * rng.uniform(0.35, 0.58))
        x, y = place * (np.asarray(half_mm) - 1.0 - contact)
        balls.append(BallPress(radius, contact, gel.thickness_mm, gel.poisson_ratio, (float(x), float(y))))
    return tuple(balls)
