"""What a card says of depth: exact for an exact ball, and silent on what lies beside it."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.held_out_depth import dent_mm
from tactilevision.photometric.ball import Ball


@pytest.mark.parametrize("scale", [(0.06, 0.06), (0.05, 0.07)])
def test_the_dent_of_a_ball_is_its_own(scale: tuple[float, float]) -> None:
    ball = Ball((80.3, 61.8), 1.5 / scale[0], 3.0)
    y, x = np.indices((130, 170), dtype=np.float64)
    r = np.hypot((x - 80.3) * scale[0], (y - 61.8) * scale[1])
    depth = np.sqrt(np.maximum(9.0 - r**2, 0.0)) + 0.7
    depth[r > 1.6] = -5.0
    found, true = dent_mm(depth, ball, scale)
    assert found == pytest.approx(true, rel=1e-12)
    assert true == pytest.approx(3.0 - np.sqrt(9.0 - 1.35**2), rel=0.03)
    assert dent_mm(0.9 * depth, ball, scale)[0] == pytest.approx(0.9 * true, rel=1e-12)
