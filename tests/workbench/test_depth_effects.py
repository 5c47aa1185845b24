"""Effects of the depth on the page: the depth moves, not the force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_bench import do, of_data
from test_sight import points

from calibration.workbench.curve_views import certificate_view, curve_view, tried_view
from calibration.workbench.views import state_view

GAIN = "photometric_gain"


def test_a_gain_of_the_picture_moves_the_depth_and_stands_next_to_the_force(tmp_path: Path) -> None:
    made = of_data(points(np.full(15, 0.8), 0.05), tmp_path, listed=(GAIN,))
    card = next(one for one in state_view(made)["cards"] if one["key"] == GAIN)
    assert card["of"] == "the reconstructed depth"
    assert card["fall"]["share"] > 0.9
    label = made.opened.data.presses.label[0]
    assert certificate_view(made.shown, 0, label)["factor"] == pytest.approx(1)
    shown = do(made, "add", GAIN)
    before, after = (np.array(one["read"]) for one in curve_view(shown)["depth"]["sets"])
    certified = np.array(curve_view(shown)["depth"]["sets"][0]["certified"])
    assert np.median(before / certified) == pytest.approx(0.8, abs=0.03)
    assert np.median(after / certified) == pytest.approx(1, abs=0.03)
    assert certificate_view(shown, 0, label)["factor"] == pytest.approx(1 / 0.8, rel=0.05)
    moved = tried_view(shown, f"{GAIN}.gain", 0.0)
    np.testing.assert_allclose(moved["depth"], before, rtol=1e-4)
    assert moved["unit"] == "µm"
    do(made, "sides", "base model\nnow")
    rows = {name: cells for name, *cells in state_view(made)["sides"]["rows"]}
    assert rows["effects"] == ["none", "photometric gain"]
    assert {"error of the force", "error of the depth"} <= rows.keys()
    assert len(set(rows["error of the depth"])) == 2
