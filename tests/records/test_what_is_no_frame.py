"""What is no frame is refused, and what would make one of it is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.records.maps import Frame

RGB = np.zeros((4, 6, 3), np.uint8)


@each(
    "given, remedy",
    [
        (Frame(RGB), "frame.rgb"),
        ([RGB, RGB], r"numpy.stack\(frames\)"),
        (Path("a.png"), "read_frame"),
        (RGB[..., 0], "Record in colour"),
        (RGB[..., :1], "Record in colour"),
        (np.zeros((4, 6, 4), np.uint8), r"rgb\[..., :3\]"),
        (RGB.transpose(2, 0, 1), r"transpose\(1, 2, 0\)"),
        (RGB.astype(np.uint16), "rgb >> 8"),
        (RGB / 255.0, r"\(255 \* rgb\)"),
        (RGB + 200.0, "grey levels from 0 to 255"),
    ],
)
def test_what_is_no_frame_is_told_how_to_become_one(given: Any, remedy: str) -> None:
    with pytest.raises(InputError, match=remedy):
        Frame(given)
