"""Six ways in which light drifts, seen by a camera whose stray light is uneven: what light_drift reads besides.

Lamps fade alike, each on its own, or the whole picture does, stray light included; each level or under a lean over
the picture. Punches press gels of Poisson's ratio, friction and edge of their own.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from tactilevision.records.measured import Pair
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import BallPress, Singles
from tactilevision.synthetic.punch import PunchPress, PunchProfile, punch_profile

KINDS = tuple((what, leans) for leans in (False, True) for what in ("alike", "own", "whole"))
FADED: Pair = (0.04, 0.08)  # of the light, up or down
LEAN: Pair = (0.1, 0.3)  # of that, from the middle to the border
STRAY, REACH_MM = 0.015, (8.0, 20.0)  # of white, at most, about a place of its own in each channel
POISSON, FRICTION, EDGE_MM = (0.45, 0.495), (0.1, 0.8), (0.03, 0.08)
LATER_S = 100.0  # when the lamps have got as far


def uneven(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera with more stray light in some place in each channel."""
    stray = camera.stray.copy()
    for channel in range(3):
        at, reach = rng.uniform(-1.0, 1.0, 2) * _half(camera), rng.uniform(*REACH_MM)
        away = camera.grid.distance((float(at[0]), float(at[1])))
        stray[..., channel] += np.float32(rng.uniform(0.0, STRAY)) * np.exp(-np.square(away / reach))
    return dataclasses.replace(camera, stray=stray)


def drifted(
    camera: Camera, press: BallPress | PunchPress, what: str, *, leans: bool, rng: np.random.Generator
) -> Singles:
    """Light (H, W, 3) of a press after `what` has drifted, "alike", "own" or "whole"."""
    count = len(camera.lights)
    fades = rng.uniform(*FADED, count) * rng.choice([-1.0, 1.0], count)
    phases, period_s = np.arange(count) * 2.1, camera.drift[1]
    swing = np.sin(2 * np.pi * LATER_S / period_s + phases) - np.sin(phases)
    lamps = {"alike": np.full(count, fades[0]), "own": fades, "whole": np.zeros(count)}[what]
    light = dataclasses.replace(camera, drift=(lamps / swing, period_s)).ideal(press, LATER_S)
    gain = np.full(light.shape[:2], 1.0 + (fades[0] if what == "whole" else 0.0))
    if leans:
        angle, size = rng.uniform(0.0, 2 * np.pi), abs(fades[0]) * rng.uniform(*LEAN)
        x, y = (place / half for place, half in zip(camera.grid.places(), _half(camera), strict=True))
        gain *= 1.0 + size * (np.cos(angle) * x + np.sin(angle) * y)
    return np.asarray(light * gain[..., None], np.float32)


def drawn_gel(radius_mm: float, thickness_mm: float, rng: np.random.Generator) -> PunchProfile:
    """A gel under a punch, its Poisson's ratio, friction and edge drawn."""
    ratio, friction, edge_mm = (float(rng.uniform(*bounds)) for bounds in (POISSON, FRICTION, EDGE_MM))
    return punch_profile(ratio, radius_mm, thickness_mm, friction=friction, edge_radius_mm=edge_mm)


def _half(camera: Camera) -> Pair:
    """Half the picture's width and height, mm."""
    return float(camera.grid.x_mm[-1]), float(camera.grid.y_mm[-1])
