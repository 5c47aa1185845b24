"""How far errors reach beside a contact: in proportion to what leaving out balls changes there."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tactilevision.heightmap.build import leakage_share
from tactilevision.heightmap.zero_plane import USUAL_THICKNESS_MM
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.records.measured import Bytes, Floats

STEP, GAIN = 0.1, np.full((3, 4), 0.02)
BALL = Ball((60.0, 45.0), 20.0, 4.0)
PICTURE = BallPicture(np.zeros((90, 120, 3), np.uint8), 4.0)


def depth(_: Bytes) -> Floats:
    y, x = np.indices((90, 120), dtype=np.float64)
    return np.asarray(0.5 * np.exp(-((x - 60.0) ** 2 + (y - 45.0) ** 2) / 400.0))


def test_a_planted_change_comes_back() -> None:
    planted = (0.004, -0.003, 0.001)
    maps = [depth, *(lambda rgb, k=k: depth(rgb) + k for k in planted)]
    found = leakage_share(maps, [PICTURE, PICTURE], balls=[BALL, None], gain=GAIN, mm_per_px=(STEP, STEP))
    y, x = np.indices((90, 120), dtype=np.float64)
    away_mm = STEP * (np.hypot(x - 60.0, y - 45.0) - 20.0)
    reach = USUAL_THICKNESS_MM / STEP
    near = cv2.GaussianBlur(np.square(0.02 * depth(PICTURE.rgb)), (0, 0), reach)
    beside = (away_mm > 0.15 * 20.0 * STEP) & (away_mm < USUAL_THICKNESS_MM)
    assert found == pytest.approx(2.0 / 3.0 * sum(k**2 for k in planted) / near[beside].mean(), rel=1e-3)


def test_without_balls_it_is_what_is_nearby() -> None:
    assert leakage_share([depth, depth], [PICTURE], balls=[None], gain=GAIN, mm_per_px=(STEP, STEP)) == 1.0
