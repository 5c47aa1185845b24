"""Calm gel is read in means as soon as enough pictures of free gel are there, be they flats alone."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from lamp_room import SENSOR, ball, ball_pictures, flat, picture

from tactilevision.heightmap.build import build_reconstructor
from tactilevision.recording.model import BallPress, Recording
from tactilevision.records.measured import Bytes


def written(path: Path, rgb: Bytes) -> Path:
    cv2.imwrite(str(path), rgb[..., ::-1])
    return path


@pytest.mark.parametrize("flats", [pytest.param(3, marks=pytest.mark.slow), 6])
def test_four_flats_or_more_serve_where_no_press_tells_when_the_gel_is_free(flats: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    balls = tuple(
        BallPress(written(tmp_path / f"b{k}.png", shot.rgb), shot.radius_mm)
        for k, shot in enumerate(ball_pictures(8, rng))
    )
    pictures = tuple(written(tmp_path / f"f{k}.png", flat(rng)) for k in range(flats))
    found = build_reconstructor(Recording(tmp_path, "flats", SENSOR, flats=pictures, balls=balls))
    assert (found.grids is not None) == (flats >= 4)
    true, p, q = ball((0.5, 0.5), 1.5, 4.0)
    depth = found.rectified_map(picture(p, q, rng)).depth_mm
    assert depth.max() - np.median(depth[:4]) == pytest.approx(true.max(), rel=0.05)
