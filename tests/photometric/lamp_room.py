"""A small renderer for these tests alone: three point lamps over a matt gel, analytic slopes, no gamma."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from shared_scenes import shared

from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import make_reference
from tactilevision.records.measured import Bytes, Floats
from tactilevision.sensors import get_sensor

MM_PER_PX = 0.08
SHAPE = (180, 240)
SENSOR = get_sensor("custom", width_px=SHAPE[1], height_px=SHAPE[0], mm_per_px=MM_PER_PX)
BALL_MM = 4.0
LAMPS = ((-30.0, -4.0, 18.0), (22.0, -24.0, 20.0), (10.0, 30.0, 17.0))  # mm from the centre, z towards the camera
TINTS = np.array([[0.9, 0.15, 0.1], [0.12, 0.8, 0.2], [0.1, 0.2, 0.95]])  # lamp, channel


@lru_cache
def places() -> tuple[Floats, Floats]:
    """x, y (H, W) in mm from the picture's centre."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    return (x - (SHAPE[1] - 1) / 2) * MM_PER_PX, (y - (SHAPE[0] - 1) / 2) * MM_PER_PX


@lru_cache
def rays(lamp: tuple[float, float, float]) -> tuple[Floats, Floats]:
    """From every pixel to a lamp (3, H, W), and the cube of how far that is."""
    x, y = places()
    ray = np.stack([lamp[0] - x, lamp[1] - y, np.full_like(x, lamp[2])])
    return ray, np.sqrt((ray**2).sum(axis=0)) ** 3


def picture(
    p: Floats,
    q: Floats,
    rng: np.random.Generator,
    *,
    gain: float | Floats = 1.0,
    noise: float = 0.7,
    stray_grey: float = 15.0,
    bright: float = 1.0,
    lamps: Sequence[float] = (1.0, 1.0, 1.0),
    at: Sequence[tuple[float, float, float]] = LAMPS,
    tints: Floats = TINTS,
) -> Bytes:
    """The frame (H, W, 3) of a gel of slopes p, q; of its light `stray_grey` does not come from the lamps.

    `lamps` is what each still gives of its light; `at` and `tints` are their places and colours.
    """
    normal = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p**2 + q**2)
    light = np.zeros((*SHAPE, 3))
    for lamp, tint, still in zip(at, tints, lamps, strict=True):
        ray, cubed = rays(lamp)
        shade = np.maximum((normal * ray).sum(axis=0), 0.0) / cubed * lamp[2] ** 2
        light += still * shade[..., None] * tint
    grey = stray_grey + 150.0 * bright * gain * light + rng.normal(0.0, noise, light.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def flat(rng: np.random.Generator, *, gain: float | Floats = 1.0) -> Bytes:
    return picture(np.zeros(SHAPE), np.zeros(SHAPE), rng, gain=gain)


def ball(centre_mm: tuple[float, float], contact_mm: float, radius_mm: float) -> tuple[Floats, Floats, Floats]:
    """Depth and slopes of a ball's cap that goes over into an exponential flank with the same slope."""
    x, y = places()
    x, y = x - centre_mm[0], y - centre_mm[1]
    r = np.hypot(x, y)
    root = np.sqrt(radius_mm**2 - contact_mm**2)
    edge, length = contact_mm / root, 0.35 * contact_mm
    cap = np.sqrt(np.maximum(radius_mm**2 - r**2, 1e-9)) - root + edge * length
    beside = edge * length * np.exp(-(r - contact_mm) / length)
    rate = np.where(
        r <= contact_mm,
        1 / np.maximum(np.sqrt(np.maximum(radius_mm**2 - r**2, 1e-9)), 1e-9),
        edge * np.exp(-np.maximum(r - contact_mm, 0) / length) / np.maximum(r, 1e-9),
    )
    return np.where(r <= contact_mm, cap, beside), -rate * x, -rate * y


def in_px(centre_mm: tuple[float, float]) -> tuple[float, float]:
    """A place in mm as (x, y) in pixels."""
    return centre_mm[0] / MM_PER_PX + (SHAPE[1] - 1) / 2, centre_mm[1] / MM_PER_PX + (SHAPE[0] - 1) / 2


def presses(count: int, rng: np.random.Generator) -> list[tuple[tuple[float, float], float]]:
    """Centres and contact radii (mm), spread over the picture."""
    half = (7.0, 4.8)
    return [
        ((float(rng.uniform(-1, 1) * half[0]), float(rng.uniform(-1, 1) * half[1])), float(rng.uniform(1.2, 2.0)))
        for _ in range(count)
    ]


def ball_pictures(count: int, rng: np.random.Generator, *, gain: float | Floats = 1.0) -> list[BallPicture]:
    """Balls of BALL_MM pressed all over the picture, to calibrate from."""
    shots = presses(count, rng)
    return [
        BallPicture(picture(*ball(at, contact, BALL_MM)[1:], rng, gain=gain), BALL_MM) for at, contact in shots
    ]


def dots(shift_px: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Brightness (H, W) of a gel with dots of two pixels' radius, 14 px apart."""
    y, x = np.indices(SHAPE, dtype=np.float64)
    x, y = (x - shift_px[0]) % 14 - 7, (y - shift_px[1]) % 14 - 7
    return 1.0 - 0.6 / (1.0 + np.exp((np.hypot(x, y) - 2.0) / 0.4))


def with_dots(rgb: Bytes, shift_px: tuple[float, float] = (0.0, 0.0)) -> Bytes:
    return np.rint(rgb * dots(shift_px)[..., None]).astype(np.uint8)


@shared
def room_calibration(balls: int) -> Calibration:
    """The polynomial of so many ball presses of this light."""
    rng = np.random.default_rng(1)
    shots = ball_pictures(balls, rng)
    reference = make_reference([flat(rng) for _ in range(3)])
    return calibrate_from_balls(reference, shots, mm_per_px=SENSOR.mm_per_px, fit=PHOTOMETRIC["polynomial"])
