"""Force figures are drawn whole from maps with and without shear."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from planted_forces import GEL, MATERIAL, SCALE, hertz, measured

from tactilevision.force.calibrated import Sensitivity
from tactilevision.force.comparison import AT_ITS_END, NO_READING, residuals, summary
from tactilevision.force.field import CUT, NO_CONTACT, ForceField
from tactilevision.force.frame import NOTHING, FrameForce, table
from tactilevision.plots.force import draw_force, draw_residuals, draw_resultants, draw_sensitivity
from tactilevision.plots.style import save_figure
from tactilevision.records.rig import Press


@pytest.mark.parametrize("sheared", [True, False])
def test_a_force_map_says_each_axis_and_its_deviation(tmp_path: Path, sheared: bool) -> None:
    height, shear = measured(hertz(2.0, (1.0, 0.5), (0.1, 0.0, 0.5)))
    found = ForceField(GEL, MATERIAL, SCALE)(height, shear if sheared else None)
    figure = draw_force(found, height, shear=shear if sheared else None)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert any("fz" in title and "±" in title for title in titles)
    assert any("not measured" in title for title in titles) != sheared
    save_figure(figure, tmp_path / "force.png")
    assert (tmp_path / "force.png").stat().st_size > 10_000


def test_resultants_are_drawn_beside_what_was_measured() -> None:
    force = [(0.1 * k, -0.1 * k, 0.2 * k) for k in range(20)]
    read = [(0.1 * k, -0.1 * k, 0.21 * k) for k in range(20)]
    rows = [FrameForce(str(k), 0.1 * k, force[k], (0.02, 0.02, 0.02), measured_N=read[k]) for k in range(20)]
    figure = draw_resultants(rows, [Press("7", "A1", 0.5, 1.5)])
    assert [axes.get_ylabel() for axes in figure.axes] == ["fz (N)", "fx (N)", "fy (N)"]
    assert all(len(axes.lines) == 2 for axes in figure.axes)
    assert not any(axes.get_legend() for axes in figure.axes), "no legend over what is drawn"
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert said == ["fz from the picture", "F/T sensor", "fx from the picture", "fy from the picture"]
    assert "7" in [text.get_text() for text in figure.axes[0].texts]
    alone = draw_resultants([replace(row, resultant_N=(np.nan, np.nan, 1.0), measured_N=NOTHING) for row in rows])
    assert [axes.get_ylabel() for axes in alone.axes] == ["fz (N)"], "what is not known is not drawn as zero"
    assert len(alone.axes[0].lines) == 1


def test_a_line_does_not_cross_a_pause() -> None:
    times = [0.0, 0.1, 0.2, 60.0, 60.1, 60.2]
    figure = draw_resultants([FrameForce(str(t), t, (0.0, 0.0, 1.0), (0.1,) * 3) for t in times])
    lines = figure.axes[0].lines
    assert len(lines) == 2
    assert np.ptp(np.concatenate([line.get_xdata() for line in lines])) < 2, "and the pause takes little room"


def test_residuals_are_drawn_against_all_that_was_recorded() -> None:
    rows = [
        FrameForce(
            str(k),
            float(k),
            (0.0, 0.0, 1.0 + 0.1 * k),
            (0.1,) * 3,
            depth_mm=0.1 * k,
            place_mm=(0.0, 1.0),
            measured_N=(0.0, 0.3, 1.0 + 0.12 * k),
            press=str(k // 3),
            reading_clipped=k == 8,
        )
        for k in range(9)
    ]
    found = residuals(rows)
    assert found is not None
    assert found.residual_N[:, 2] == pytest.approx(-0.02 * np.arange(9))
    assert found.direction_deg == pytest.approx(90)
    assert found.usable.tolist() == [True] * 8 + [False]
    figure = draw_residuals(found)
    assert len(figure.axes) == 6
    said = summary(found)["z"]
    assert said["frames"] == 8
    assert said["inside_interval95"] == 1
    assert said["rms_N"] == pytest.approx(0.02 * np.sqrt(np.mean(np.arange(8) ** 2)))
    assert residuals([replace(row, flags="no contact") for row in rows]) is None
    noisy = residuals(rows, reading_std_N=(0.1, 0.1, 0.2))
    assert noisy is not None
    assert noisy.std_N[0] == pytest.approx(np.sqrt([0.02, 0.02, 0.05])), "the reading scatters as well"


def test_each_frame_that_is_not_compared_has_a_reason() -> None:
    plain = FrameForce("0", 0.0, (0.1, 0.1, 1.0), (0.1,) * 3, measured_N=(0.1, 0.1, 1.0))
    odd = [
        replace(plain, reading_clipped=True),
        replace(plain, flags=CUT),
        replace(plain, measured_N=NOTHING),
        replace(plain, flags=NO_CONTACT),
    ]
    found = residuals([plain, plain, *odd])
    assert found is not None
    assert found.touched == 5
    assert found.left_out == {AT_ITS_END: 1, CUT: 1, NO_READING: 1}
    assert int(found.usable.sum()) + sum(found.left_out.values()) == found.touched
    assert len(found.usable) == 4


def test_a_bar_reaches_as_far_as_the_force_moves() -> None:
    found = ForceField(GEL, MATERIAL, SCALE)(*measured(hertz(2.0, (0.0, 0.0), (0.0, 0.0, 0.5))))
    low, high = (np.asarray(found.resultant_N) * s for s in (0.9, 1.1))
    figure = draw_sensitivity(found, [Sensitivity("youngs_modulus", "MPa", (0.18, 0.22), np.stack([low, high]))])
    bar, whole = figure.axes[0].patches
    place = bar.get_path().get_extents(bar.get_patch_transform())
    assert (place.x0, place.x1) == pytest.approx((-10, 10))
    assert whole.get_path().get_extents(whole.get_patch_transform()).width > 0


def test_a_time_since_1970_is_whole_in_the_table() -> None:
    row = FrameForce("0", 1.7e9 + 3.0892, (0.0, 0.0, 1.0), (0.1,) * 3)
    assert float(table([row]).splitlines()[1].split(",")[1]) == row.time_s
