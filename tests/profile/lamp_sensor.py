"""A sensor of the small renderer as a profile, and as the folder of pictures that a profile is made from."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from tactilevision.photometric.method import CalibratedMethod
from tactilevision.profile.model import Profile
from tactilevision.profile.sensor import stated_material, with_compliance
from tactilevision.profile.storage import write_profile
from tactilevision.recording.write import write_image
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Gel, Indenter, Sensor

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import BALL_MM, SENSOR, SHAPE, ball, flat, picture, presses, room_calibration

__all__ = [
    "GEL",
    "PUNCH",
    "SHAPE",
    "TOML",
    "flat",
    "free",
    "method",
    "picture",
    "pressed",
    "profile",
    "saved",
    "write_ball_folder",
    "write_frames",
]

GEL = Gel(3.0, poisson_ratio=0.48, poisson_ratio_std=0.01, youngs_modulus_MPa=0.2, youngs_modulus_std_MPa=0.004)
PUNCH = Indenter("A1", radius_mm=2.5)
TOML = """\
[sensor]
kind = "custom"
mm_per_px = 0.08
width_px = 240
height_px = 180
[sensor.gel]
thickness_mm = 3.0
shape = "unbounded"
youngs_modulus_MPa = 0.2
youngs_modulus_std_MPa = 0.004
poisson_ratio = 0.48
poisson_ratio_std = 0.01
"""


@lru_cache
def method() -> CalibratedMethod:
    return room_calibration(8).method


@lru_cache
def profile() -> Profile:
    """A custom sensor without rectification, its gel described, E and nu stated."""
    sensor: Sensor = replace(SENSOR, gel=GEL, serial="07")
    size = SHAPE[1], SHAPE[0]
    made = Profile(
        sensor,
        method(),
        free(),
        size,
        "2026-11-21",
        "nothing",
        "lamp room",
        calibration=stated_material(GEL),
        indenters={"A1": PUNCH},
        warnings=("made for tests",),
    )
    return with_compliance(made)


def saved(folder: Path) -> Path:
    return write_profile(profile(), folder / "lamp.tvs")


def free(seed: int = 3) -> Bytes:
    return flat(np.random.default_rng(seed))


def pressed(seed: int = 4, contact_mm: float = 1.5) -> Bytes:
    _, p, q = ball((0.5, 0.5), contact_mm, BALL_MM)
    return picture(p, q, np.random.default_rng(seed))


def write_ball_folder(root: Path, *, balls: int = 8) -> Path:
    """flat/, ball/ and ball.csv as the folder `reference` of a recording has them, and sensor.toml beside."""
    rng = np.random.default_rng(1)
    for number in range(4):
        write_image(root / "flat" / f"{number}.png", flat(rng))
    for number, (at, contact) in enumerate(presses(balls, rng)):
        write_image(root / "ball" / f"{number}.png", picture(*ball(at, contact, BALL_MM)[1:], rng))
    rows = "".join(f"{number}.png,{BALL_MM}\n" for number in range(balls))
    (root / "ball.csv").write_text("frame,ball_radius_mm\n" + rows)
    (root / "sensor.toml").write_text(TOML)
    return root


def write_frames(folder: Path) -> Path:
    """A bare folder: free gel first, then two presses."""
    for number, rgb in enumerate((free(), pressed(), pressed(5, 1.8))):
        write_image(folder / f"{number}.png", rgb)
    return folder
