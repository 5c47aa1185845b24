"""Frames of real sensors, read where they are at hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from each import each

from tactilevision.recording.folder import read_folder
from tactilevision.recording.pictures import iter_frames
from tactilevision.records.maps import Frame

REAL = Path(__file__).parents[2] / ".." / "shared" / "real"

# folder, size (width, height), how many
SETS = [
    ("gelslim3_mcubelab/markerless", (427, 320), 56),
    ("gelslim3_mcubelab/markers", (427, 320), 40),
    ("gelslim_heightmap/test_data", (427, 320), 17),
    ("taxim_gelsight_mini", (640, 480), 25),
]


@each("name, size, count", SETS)
def test_real_frames_stream_in_colour(name: str, size: tuple[int, int], count: int, tmp_path: Path) -> None:
    folder = REAL / name
    if not folder.is_dir():
        pytest.skip("the real frames are not at hand")
    toml = tmp_path / "sensor.toml"
    toml.write_text(f"[sensor]\nkind = 'custom'\nmm_per_px = 0.06\nwidth_px = {size[0]}\nheight_px = {size[1]}\n")
    recording = read_folder(folder, sensor=toml)
    frames = list(iter_frames(recording))
    assert len(frames) == count
    for frame in frames:
        assert isinstance(frame, Frame)
        assert frame.rgb.shape == (size[1], size[0], 3)
        means = frame.rgb.reshape(-1, 3).mean(axis=0)
        assert np.ptp(means) > 1, "three lights of different colours do not average to grey"
