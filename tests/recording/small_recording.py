"""A small, sound recording to be spoilt: ten frames of 32 x 24, two presses, forces at 100 Hz."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactilevision.recording.write import write_image
from tactilevision.records.measured import Bytes

SETTINGS = """\
format = 1
name = "small"
date = 2026-11-21

[sensor]
kind = "custom"
mm_per_px = 0.06
width_px = 32
height_px = 24

[sensor.gel]
thickness_mm = 3.0
shape = "disc"
radius_mm = 15.0

[force]
std_N = [0.01, 0.01, 0.02]
rate_Hz = 100.0

[clock]
offset_s = 0.0

[indenter.A1]
radius_mm = 2.5
height_mm = 0.15
bevel = "right"
"""


def picture(seed: int = 0, width: int = 32, height: int = 24) -> Bytes:
    """A coloured picture that no codec can confuse with another."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def write_small(root: Path) -> Path:
    """Write the whole folder; returns it."""
    for index in range(10):
        write_image(root / "frames" / f"f{index}.png", picture(index))
    write_image(root / "reference/flat/untouched.png", picture(20))
    write_image(root / "reference/ball/b1.png", picture(21))
    (root / "reference/ball.csv").write_text("frame,ball_radius_mm\nb1.png,3.0\n")
    (root / "frames.csv").write_text("frame,time_s\n" + "".join(f"f{i}.png,{i / 10}\n" for i in range(10)))
    rows = "".join(f"{i / 100},0.1,-0.1,{i % 50 / 50}\n" for i in range(100))
    (root / "forces.csv").write_text("time_s,fx_N,fy_N,fz_N\n" + rows)
    (root / "presses.csv").write_text("press,indenter,start_s,end_s\n1,A1,0.1,0.4\n2,A1,0.5,0.9\n")
    (root / "recording.toml").write_text(SETTINGS)
    return root


def edit(path: Path, old: str, new: str) -> None:
    """Replace text that is known to be there."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
