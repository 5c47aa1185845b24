"""What a face at the border of the view is told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from each import each

from tactilevision.press.rejection import _border


@each(
    "x_mm, words",
    [
        (0.0, None),
        (2.45, "within 0.05 mm of the view's border"),
        (2.501, "reaches 0.001 mm beyond"),
        (3.87, "1.37 mm beyond the view's border"),
    ],
)
def test_a_face_is_told_how_far_it_is_from_the_border_or_beyond(x_mm: float, words: str | None) -> None:
    face = SimpleNamespace(radius_mm=2.5, centre_mm=(x_mm, 0.0))
    map_ = SimpleNamespace(depth_mm=np.zeros((80, 100)), mm_per_px=(0.1, 0.1))
    evidence: Any = SimpleNamespace(track=SimpleNamespace(footprint=face, face_map=map_), distance_mm=None)
    unused: Any = None
    finding = _border(evidence, unused, unused)
    assert (finding is None) if words is None else (finding is not None and words in finding.text)
