"""Films can be read again, frame for frame; GIF stands in where no codec is found."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tactilevision.errors import InputError
from tactilevision.plots import viewer as film
from tactilevision.plots.height import draw_difference, draw_height, draw_normals
from tactilevision.plots.viewer import Shot, draw_film, write_film
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Bytes


def shot(depth_mm: float, time_s: float) -> Shot:
    y, x = np.mgrid[:60, :80]
    depth = np.where(np.hypot(x - 40, y - 30) < 15, depth_mm, 0.0)
    valid = np.ones_like(depth, dtype=bool)
    valid[:5, :5] = False
    return Shot(np.full((60, 80, 3), 120, np.uint8), HeightMap(depth, valid, (0.1, 0.1), time_s=time_s), depth_mm)


SHOTS = [shot(0.1 * k, 0.05 * k) for k in range(6)]


def pictures() -> list[Bytes]:
    return list(draw_film(SHOTS, title="press 7"))


def test_a_film_has_a_picture_for_each_frame_and_they_differ(tmp_path: Path) -> None:
    made = pictures()
    assert len(made) == 6
    assert all(np.abs(a.astype(int) - b).max() > 50 for a, b in pairwise(made))
    path = write_film(tmp_path / "a.mp4", made)
    if path.suffix == ".gif":
        pytest.skip("no codec on this machine")
    read = cv2.VideoCapture(str(path))
    found = []
    while (got := read.read())[0]:
        found.append(got[1][..., ::-1])
    assert len(found) == 6
    assert np.abs(found[3].astype(float) - made[3]).mean() < 4


def test_without_a_codec_it_is_a_gif(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "CODEC", "none")
    path = write_film(tmp_path / "a.mp4", pictures())
    assert [one.name for one in tmp_path.iterdir()] == ["a.gif"]
    with Image.open(path) as gif:
        assert getattr(gif, "n_frames", 1) == 6


def test_no_frames_make_no_film() -> None:
    with pytest.raises(InputError, match="no frames"):
        draw_film([])


def test_normals_overlay_and_difference_are_drawn_with_holes(tmp_path: Path) -> None:
    first, second = SHOTS[1], SHOTS[4]
    tilted = draw_normals(second.height)
    assert "Tilt" in tilted.axes[0].get_title(loc="left")
    assert len(tilted.axes[0].collections) == 1, "arrows"
    strip = draw_height(second.height, second.rgb)
    assert len(strip.axes) == 5
    change = draw_difference(first.height, second.height).axes[0].images[0]
    assert float(np.nanmax(np.asarray(change.get_array()))) == pytest.approx(0.3)
    assert change.get_clim()[0] == -change.get_clim()[1]
