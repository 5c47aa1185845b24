"""Names of presses and indenters as users have them: long, with tabs, or in letters that the font lacks."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from each import each

from calibration.report.figures import FigureChoice, keep_every_press
from tactilevision.plots import style, style as letters
from tactilevision.plots.misfit import draw_presses
from tactilevision.plots.style import LONGEST_LABEL, as_label, font_of, save_figure
from tactilevision.records.misfit import ForceCurves, PressCurve

X = np.linspace(0.05, 0.5, 12)


@each("name", ["tab\there", "汉字", "🤖", "A" * 10_000, "$x_{$", "<b>"])
def test_a_name_fits_its_figure_and_is_drawn_without_a_warning(name: str, tmp_path: Path) -> None:
    press = PressCurve(name, name, 2.5, X, X, X, np.array([0.9 * X]), ("load",) * 12)
    figure = draw_presses(ForceCurves(("plain law",), (press,), whole=True), (press,))
    save_figure(figure, tmp_path / "press.png")
    title = figure.axes[0].get_title(loc="left")
    assert "\t" not in title
    assert "汉" not in title or font_of("汉")
    assert len(title) < 2 * LONGEST_LABEL + len("press  (, a = 2.5 mm)") + 1


def test_a_letter_is_drawn_in_another_font_that_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(letters, "font_of", lambda letter: "FreeSans" if letter == "б" else "")
    figure, (axes,) = style.new_figure(3.0, 2.0)
    axes.set_title("a б")
    letters.choose_fonts(figure)
    assert axes.get_title() == "a б"
    assert len(axes.title.get_fontfamily()) > 1


def test_a_letter_that_no_font_has_is_written_as_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(letters, "font_of", lambda letter: "" if letter.isascii() or letter in "שלום" else None)
    assert letters.legible("a\U000f0000\tb") == "aU+F0000 b"
    assert letters.legible("e\u0301 שלום") == "e\u0301 שלום"


def test_long_names_that_differ_at_either_end_stay_different() -> None:
    names = [f"{day}_silicone_pad_flat_punch_run_{run}" for day in ("mon", "tue") for run in ("001", "002")]
    shown = {as_label(name) for name in names}
    assert len(shown) == len(names)
    assert {len(name) for name in shown} == {LONGEST_LABEL}


def test_a_caption_names_presses_in_full() -> None:
    """A page wraps long words; a figure cannot."""
    names = [f"2026-11-24_sensor_a_punch_3_mm_run_{run:03d}" for run in (1, 2)]
    presses = tuple(PressCurve(n, n, 2.5, X, X, X, np.array([0.9 * X]), ("load",) * 12) for n in names)
    folder: Any = SimpleNamespace(
        choice=FigureChoice(presses="all"), keep=lambda figure, name, *, caption: caption
    )
    curves = ForceCurves(("plain law",), presses, whole=True)
    (caption,) = keep_every_press(curves, folder, lambda done, total, what="": None)
    assert set(names) <= set(str(caption).split("Presses ")[1].replace(". Black", " Black").split(" "))
