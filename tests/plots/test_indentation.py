"""Points are drawn whatever their force: curves taken as they are hold readings of nought and below it."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from tactilevision.plots.calibration import FittedLine, PointCloud, draw_fit


def test_forces_of_nought_and_below_are_drawn_with_their_bars() -> None:
    depth_mm, force_N = np.array([0.002, 0.1, 0.3]), np.array([-0.004, 0.0, 1.2])
    std = np.full(3, 0.004)
    cloud = PointCloud(depth_mm, std, force_N, std, force_N, 3.0, np.ones(3, dtype=bool))
    line = FittedLine("A1", depth_mm, force_N, std, 3.0)
    stiffness = draw_fit(cloud, [line]).axes[1]
    bars = [bar for bar in stiffness.collections if isinstance(bar, LineCollection)]
    heights = [float(np.ptp(np.asarray(ends)[:, 1])) for bar in bars for ends in bar.get_segments()]
    assert np.isfinite(heights).all()
    upright = [height for height in heights if height > 0.0]
    assert upright[0] == pytest.approx(2 * 1.96 * 0.004 / 0.1, abs=1e-6), "the first is too shallow for P/w"
