"""Names of presses and indenters as users have them: long, with tabs, or in letters that the font lacks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactilevision.plots.misfit import draw_presses
from tactilevision.plots.style import LONGEST_LABEL, save_figure
from tactilevision.records.misfit import ForceCurves, PressCurve

X = np.linspace(0.05, 0.5, 12)


@pytest.mark.parametrize("name", ["tab\there", "汉字", "A" * 10_000, "$x_{$", "<b>"])
def test_a_name_fits_its_figure_and_is_drawn_without_a_warning(name: str, tmp_path: Path) -> None:
    press = PressCurve(name, name, 2.5, X, X, X, np.array([0.9 * X]), ("load",) * 12)
    figure = draw_presses(ForceCurves(("plain law",), (press,), whole=True), (press,))
    save_figure(figure, tmp_path / "press.png")
    title = figure.axes[0].get_title(loc="left")
    assert "\t" not in title
    assert len(title) < 2 * LONGEST_LABEL + len("press  (, a = 2.5 mm)") + 1
