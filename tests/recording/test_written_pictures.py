"""A written picture keeps the colours that photometry reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactilevision.recording.images import read_image
from tactilevision.recording.write import write_image


def test_jpeg_keeps_colours_at_full_resolution(tmp_path: Path) -> None:
    """Columns of red and blue in turn: with colours at half resolution both would read as one purple."""
    rgb = np.zeros((16, 16, 3), np.uint8)
    rgb[:, 0::2, 0] = 200
    rgb[:, 1::2, 2] = 200
    write_image(tmp_path / "a.jpg", rgb, jpeg_quality=98)
    back = read_image(tmp_path / "a.jpg").astype(int)
    assert np.abs(back - rgb).max() < 30
