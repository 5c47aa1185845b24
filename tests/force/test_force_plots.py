"""Force figures are drawn whole from maps with and without shear."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from planted_forces import GEL, MATERIAL, SCALE, hertz, measured

from tactilevision.force.calibrated import Sensitivity
from tactilevision.force.field import ForceField
from tactilevision.plots.force import draw_force, draw_resultants, draw_sensitivity
from tactilevision.plots.style import save_png


@pytest.mark.parametrize("sheared", [True, False])
def test_a_force_map_says_each_axis_and_its_deviation(tmp_path: Path, sheared: bool) -> None:
    height, shear = measured(hertz(2.0, (1.0, 0.5), (0.1, 0.0, 0.5)))
    found = ForceField(GEL, MATERIAL, SCALE)(height, shear if sheared else None)
    figure = draw_force(found, height, shear if sheared else None)
    titles = [axes.get_title(loc="left") for axes in figure.axes[:4]]
    assert any("along z" in title and "±" in title for title in titles)
    assert any("not measured" in title for title in titles) != sheared
    save_png(figure, tmp_path / "force.png")
    assert (tmp_path / "force.png").stat().st_size > 10_000


def test_resultants_are_drawn_beside_what_was_measured() -> None:
    time = np.linspace(0, 1, 20)
    force = np.column_stack([time, -time, 2 * time])
    figure = draw_resultants(time, force, 0.1 * np.abs(force), force + 0.01)
    assert [axes.get_ylabel() for axes in figure.axes] == ["fx (N)", "fy (N)", "fz (N)"]
    assert all(len(axes.lines) == 2 for axes in figure.axes)
    assert all(len(axes.lines) == 1 for axes in draw_resultants(time, force, force).axes)


def test_a_bar_reaches_as_far_as_the_force_moves() -> None:
    found = ForceField(GEL, MATERIAL, SCALE)(*measured(hertz(2.0, (0.0, 0.0), (0.0, 0.0, 0.5))))
    low, high = (np.asarray(found.resultant_N) * s for s in (0.9, 1.1))
    figure = draw_sensitivity(found, [Sensitivity("youngs_modulus", "MPa", (0.18, 0.22), np.stack([low, high]))])
    (bar,) = figure.axes[0].patches
    place = bar.get_path().get_extents(bar.get_patch_transform())
    assert (place.x0, place.x1) == pytest.approx((-10, 10))
