"""The sample that Mitsuba drew: it reads as any recording does, and its shadows lie where its truth puts them."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from each import each

from benchmarks.rendered.camera import build_camera
from benchmarks.rendered.families import draw_rig
from tactilevision.recording.images import read_image
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Floats
from tactilevision.synthetic.gel import Prescribed
from tactilevision.synthetic.lights import visibility

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "rendered_shadows"
MAX_BYTES = 6_000_000


@cache
def truth() -> dict[str, Any]:
    return tomllib.loads((SAMPLE / "truth.toml").read_text())


@cache
def recording() -> Recording:
    return read_recording(SAMPLE)


def depth_mm(name: str) -> Floats:
    with np.load(SAMPLE / "truth" / f"{name}.npz", allow_pickle=False) as stored:
        return np.asarray(stored["depth_mm"], dtype=np.float64)


def picture(path: Path) -> Floats:
    return read_image(path).astype(np.float64)


def test_it_is_small_and_whole() -> None:
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file()) < MAX_BYTES
    assert len(recording().balls) == 12
    assert len(recording().frame_names) == 1 + len(truth()["step"]) == 9
    assert not list(SAMPLE.rglob("*.jpg"))
    for ball in recording().balls:
        assert read_image(ball.path).shape == (320, 427, 3)


def test_its_truth_has_the_depths_that_it_states() -> None:
    for i, step in enumerate(truth()["step"], start=1):
        assert depth_mm(f"frame_{i:05d}").max() == pytest.approx(step["face_mm"], abs=0.001)
    for i, ball in enumerate(truth()["ball"]):
        depth, cap = depth_mm(f"ball_{i:02d}"), ball["contact_radius_mm"]
        height = ball["radius_mm"] - np.sqrt(ball["radius_mm"] ** 2 - cap**2)
        assert depth.max() > height  # the gel also sinks where the ball leaves it


def test_it_is_of_the_family_that_may_be_learned_from() -> None:
    assert truth()["rig"]["family"] == "train"
    rig = draw_rig("train", truth()["rig"]["seed"])
    assert [list(lamp.centre_mm) for lamp in rig.lamps] == [lamp["centre_mm"] for lamp in truth()["rig"]["lamps"]]


@each("number", [3, 4, 7, 8])
def test_each_lamp_s_colour_is_short_where_that_lamp_is_hidden(number: int) -> None:
    rig = draw_rig("train", truth()["rig"]["seed"])
    grid = build_camera(rig, Path()).grid
    flat = np.mean([picture(path) for path in sorted((SAMPLE / "reference" / "flat").iterdir())], axis=0)
    shown = picture(SAMPLE / "frames" / f"{number:05d}.png")
    height = depth_mm(f"frame_{number:05d}")
    shares = visibility(rig.lamps, Prescribed(height, grid), grid)
    slope = np.hypot(*np.gradient(height, rig.mm_per_px))
    level = cv2.erode((slope < 0.1).astype(np.uint8), np.ones((3, 3))) > 0
    for lamp, share in zip(rig.lamps, shares, strict=True):
        channel = int(np.argmax(lamp.colour))
        fall = (flat - shown)[..., channel] / flat[..., channel]
        hidden, lit = level & (share < 0.1), level & np.logical_and.reduce([one > 0.99 for one in shares])
        assert abs(float(np.median(fall[lit]))) < 0.02
        if hidden.sum() > 50:
            assert float(np.median(fall[hidden])) > 0.15
    assert min(float(share.min()) for share in shares) < 0.05
