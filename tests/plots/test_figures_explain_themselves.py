"""Figures of reports: legible when shown 500 px wide, each colour explained, units on the axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from each import each
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection
from matplotlib.colors import to_rgb, to_rgba_array
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

from tactilevision.contact.bevel import Growth, Onset
from tactilevision.plots import (
    calibration as indentation,
    calibration as joint,
    diagnosis,
    misfit,
    style,
    validation,
)
from tactilevision.plots.calibration import draw_press
from tactilevision.plots.viewer import Shot, _Stage
from tactilevision.press.bevel_contact import ContactEvent
from tactilevision.press.certificate import Evidence
from tactilevision.records import misfit as misfit_records
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.maps import Footprint, HeightMap
from tactilevision.records.measured import Estimate

SHOWN_PX = 500
LEAST_PX = 8.0  # height of a letter's body that is read without effort
UNITS = (
    "(",
    "/",
    "ν",
    "press",
    "frame",
    "effect",
    "loading",
)  # ratios, counts and names have no unit
OLD_WORDS = ("touch", "floor", "ruler")

X = np.linspace(0.05, 0.5, 12)
ONES, HALF = np.ones(12), np.full(12, 0.05)


def height_map() -> HeightMap:
    y, x = np.mgrid[:30, :40]
    depth = np.where(np.hypot(x - 20, y - 15) < 8, 0.3, 0.0)
    return HeightMap(depth, x > 3, (0.1, 0.1), name="a", time_s=1.0)


def press(height: HeightMap | None, *, certain: bool = True) -> Figure:
    onset = Onset(0.3, 0.01, 1.0, 0.1, Growth(), 0.01, 100.0, 1.0)
    event = None if height is None or not certain else ContactEvent(0.3, 0.01, 0.3, "bevel", onset)
    signal = None if height is None else 1e-3 * X
    footprint = Footprint(
        np.ones((30, 40), dtype=bool), (0.0, 0.0), 0.01, 0.8, 0.01, (0.0, 0.0), 0.01, 0.3, 0.01, 0.01
    )
    window = ((1.0, -0.5), (1.2, 0.5))
    forces = np.column_stack([X, X, X])
    evidence = Evidence("1", 0, "a", footprint, height, window, X, X, signal, event, 0.3, X, forces)
    return draw_press(evidence, CertifiedPoint("1", "A1", 0.3, 1.0), rgb=np.zeros((30, 40, 3), np.uint8))


def fit() -> Figure:
    used = np.arange(12) > 2
    cloud = indentation.PointCloud(
        X, 0.01 * ONES, X, 0.01 * ONES, X, 3.0, used, radius_mm=np.where(X > 0.3, 2.0, 1.0)
    )
    lines = [indentation.FittedLine(name, X, X, HALF, 3.0) for name in ("a = 1 mm", "a = 2 mm")]
    return indentation.draw_fit(cloud, lines)


def estimate(value: float) -> Estimate:
    return Estimate(value, 0.05 * value, (0.9 * value, 1.1 * value), "MPa")


def material() -> Figure:
    curve = [(0.4, 0.25), (0.45, 0.22), (0.5, 0.18)]
    return indentation.draw_material(curve, estimate(0.2), estimate(0.45))


def history() -> Figure:
    return indentation.draw_history(["a", "b"], [estimate(0.2), estimate(0.3)], moved=[False, True])


def ageing() -> Figure:
    moduli = [estimate(0.2), Estimate(None, None, (0.1, 0.3), "MPa", "open")] * 6
    ends = ("2026-01-05", "2026-03-23")
    return indentation.draw_ageing(X, -X, 0.1 * ONES, line=(-X, -X - 0.1, 0.1 - X), modulus=moduli, dates=ends)


def joint_region() -> Figure:
    curve = np.column_stack([np.linspace(0.43, 0.4999, 20), np.linspace(0.23, 0.18, 20)])
    region = np.array([[0.465, 0.21], [0.485, 0.2], [0.485, 0.19]])
    routes = [("bulge", (0.468, 0.484), True), ("beta", (0.40, 0.42), False)]
    return joint.draw_joint(curve, region, best=(0.475, 0.2), routes=routes)


def curves() -> misfit_records.ForceCurves:
    modelled = np.array([X + HALF, X])
    phase = ("load",) * 12
    presses = [
        misfit_records.PressCurve(f"p{k}", "A", radius, X, X, X, modelled, phase)
        for k, radius in enumerate((1.0, 2.0))
    ]
    return misfit_records.ForceCurves(("plain law", "+ creep"), tuple(presses), whole=True)


def press_rows() -> Figure:
    shown = curves()
    return misfit.draw_presses(shown, shown.presses)


def test_a_law_through_every_sample_is_drawn_without_a_warning() -> None:
    press = misfit_records.PressCurve("p", "A", 2.5, X, X, X, np.array([X]), ("load",) * 12)
    exact = misfit_records.ForceCurves(("plain law",), (press,), whole=True)
    low, high = misfit.draw_presses(exact, exact.presses).axes[2].get_ylim()
    assert low < 0 < high


def strips() -> Figure:
    mean = np.array([[1e-3, 2e-3, 3e-3], [0.0, 0.0, 0.0]])
    told = [
        ("w", "the depth", "mm", ()),
        ("wait", "the wait", "log10 s", ()),
        ("way", "loading or unloading", "", ("load", "hold")),
    ]
    shown = [
        misfit_records.Strip(
            name,
            said,
            unit,
            levels,
            np.repeat([0.0, 0.5, 1.0], 4),
            np.array([0.0, 0.5, 1.0]),
            mean,
            np.full((2, 3), 1e-3),
            (0.33, 3.3e-4),
            (0.5, 0.5),
        )
        for name, said, unit, levels in told
    ]
    residual = np.array([1e-3 * X, -1e-3 * X])
    return misfit.draw_strips(
        misfit_records.ResidualStrips(("plain law", "+ creep"), tuple(shown), residual, X, 2e-3)
    )


def error_fall() -> Figure:
    names = ("plain law", *(f"+ {letter}" for letter in "abcde"))
    return misfit.draw_error_fall(
        misfit_records.ErrorFall(names, (5e-3, 4e-3, 3e-3, 2e-3, 1e-3, 1e-3), 1e-3, (5e-4, 2e-3), True)
    )


def offsets() -> Figure:
    own_um, odd = np.array([1.0, -1.0, 8.0]), (False, False, True)
    return diagnosis.draw_offsets(diagnosis.Offsets(("a", "b", "c"), own_um, odd, 1))


def overlay() -> Figure:
    means, reach = np.array([X, HALF, X]), np.array([HALF, HALF, HALF])
    own = misfit_records.Strip("w", "the depth", "mm", (), X, X, means, reach, (), ())
    return diagnosis.draw_overlay(own, "depth zero")


def sighting() -> Figure:
    seen = diagnosis.Sighting(
        0.8 * ONES, ONES, X > 0.2, (("certified depth (mm)", X), ("time (min)", X), ("press", X))
    )
    return diagnosis.draw_sighting(seen)


def validated() -> Figure:
    error = np.where(X > 0.4, np.nan, 0.1)
    series = [validation.Series(name, X, error) for name in ("sticking", "sliding")]
    panels = [validation.Panel(name, X, X, series) for name in ("Linear", "Neo-Hooke")]
    return validation.draw_validation(panels, "depth (mm)", title="Depths")


FIGURES: dict[str, Callable[[], Figure]] = {
    "press": lambda: press(height_map()),
    "press without a picture": lambda: press(None),
    "fit": fit,
    "material": material,
    "history": history,
    "ageing": ageing,
    "joint": joint_region,
    "presses": press_rows,
    "overview": lambda: misfit.draw_overview(curves(), 3.0),
    "strips": strips,
    "waterfall": error_fall,
    "moduli": lambda: misfit.draw_moduli(["plain law", "+ creep"], [estimate(0.2), estimate(0.21)]),
    "offsets": offsets,
    "confusability": lambda: diagnosis.draw_confusability(["a", "b"], np.array([[0.0, 4], [5, 0]])),
    "overlay": overlay,
    "sighting": sighting,
    "residual map": lambda: diagnosis.draw_residual_map(1e-3 * np.outer(X, X), X, count=3),
    "validation": validated,
    "film": lambda: _Stage([Shot(np.zeros((30, 40, 3), np.uint8), height_map(), 1.0)] * 2, "press 7").figure,
}


@pytest.fixture(scope="module")
def drawn() -> dict[str, Figure]:
    return {name: draw() for name, draw in FIGURES.items()}


def shown(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.axison]


def words(figure: Figure) -> list[Text]:
    return [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]


@each("name", FIGURES)
def test_text_is_legible_at_500_px(name: str, drawn: dict[str, Figure]) -> None:
    figure = drawn[name]
    width_in = figure.get_figwidth()
    assert width_in <= style.WIDTH_IN
    assert [
        t.get_text() for t in words(figure) if float(t.get_fontsize()) / 72 * SHOWN_PX / width_in < LEAST_PX
    ] == []


def test_the_words_over_a_panel_end_where_it_ends(drawn: dict[str, Figure]) -> None:
    drawn["strips"].draw_without_rendering()
    for axes in shown(drawn["strips"]):
        own = {axes.get_title(place) for place in ("left", "center", "right")} - {""}
        (title,) = (text for text in axes.get_children() if isinstance(text, Text) and text.get_text() in own)
        assert title.get_window_extent().x1 < axes.get_window_extent().x1


@each("name", FIGURES)
def test_every_axis_says_what_it_is_and_in_which_unit(name: str, drawn: dict[str, Figure]) -> None:
    for axes in shown(drawn[name]):
        for axis in (axes.xaxis, axes.yaxis):
            label, ticks = axis.get_label_text(), [tick.get_text() for tick in axis.get_ticklabels()]
            is_number = any(tick.lstrip("−-").replace(".", "").isdigit() for tick in ticks)
            assert label or not is_number, ticks
            assert not label or any(unit in label for unit in UNITS), label


@each("name", FIGURES)
def test_every_colour_and_area_is_explained(name: str, drawn: dict[str, Figure]) -> None:
    figure = drawn[name]
    legends = [*figure.legends, *(one for one in (axes.get_legend() for axes in figure.axes) if one is not None)]
    said = {text.get_text() for legend in legends for text in legend.get_texts()}
    said_colours = {to_rgb(text.get_color()) for text in words(figure)}
    for axes in shown(figure):
        if axes.get_label() == "<colorbar>":
            continue
        handles, labels = axes.get_legend_handles_labels()
        assert set(labels) <= said
        explained = {colour for handle in handles for part in parts(handle) for colour in colours(part)}
        for artist in (*axes.lines, *axes.collections, *axes.patches):
            if not is_reference(artist) and not (name == "waterfall" and isinstance(artist, Patch)):
                assert set(colours(artist)) <= explained | said_colours, f"{name}: {artist}"


def is_reference(artist: Artist) -> bool:
    """A zero line or a scale bar, which says itself what it is: grey, black or white, and level."""
    if not isinstance(artist, Line2D) or artist.get_color() not in (style.GREY, "black", "white"):
        return False
    y = np.asarray(artist.get_ydata(), dtype=float)
    return y.size == 2 and y[0] == y[1]


def parts(handle: Artist | Container) -> Sequence[Artist]:
    """The artists of a legend's handle: errorbars and bars are containers of some."""
    return handle.get_children() if isinstance(handle, Container) else [handle]


def colours(artist: Artist) -> Iterator[tuple[float, float, float]]:
    """The colours that an artist shows; areas by their face."""
    if isinstance(artist, Line2D):
        yield to_rgb(artist.get_color())
    elif isinstance(artist, LineCollection):
        yield from (to_rgb(c) for c in to_rgba_array(artist.get_edgecolor()))
    elif isinstance(artist, Patch):
        yield to_rgb(artist.get_facecolor())
    elif isinstance(artist, Collection) and artist.get_array() is None:
        faces, edges = artist.get_facecolor(), artist.get_edgecolor()
        yield from (to_rgb(c) for c in to_rgba_array(faces if len(np.asarray(faces)) else edges))


@each("name", FIGURES)
def test_words_are_those_of_the_manual(name: str, drawn: dict[str, Figure]) -> None:
    said = " ".join(text.get_text() for text in words(drawn[name])).lower()
    assert [word for word in OLD_WORDS if word in said] == []


def test_pixels_of_unknown_depth_have_a_legend_entry(drawn: dict[str, Figure]) -> None:
    labels = [text.get_text() for text in drawn["press"].legends[0].get_texts()]
    assert {"depth not known", "punch face", "window on the bevel", "contact event"} <= set(labels)
    assert len(labels) == len(set(labels))
    assert any(isinstance(one, AxesImage) for axes in drawn["press"].axes for one in axes.images)


def test_a_press_without_a_contact_event_shows_none() -> None:
    said = [axes.get_title("left") for axes in press(height_map(), certain=False).axes]
    assert "Frame of the press" in said
    assert not any("event" in title for title in said)


def test_a_label_with_dollar_signs_is_text(tmp_path: Path) -> None:
    @style.house_look
    def draw() -> None:
        figure, axes = style.new_figure(2, 2)
        axes[0].set_title("press $x_{$")
        figure.savefig(tmp_path / "a.png")

    draw()
    assert (tmp_path / "a.png").stat().st_size > 0


def test_an_axis_s_name_stands_clear_of_its_numbers() -> None:
    """Forces of .25 and .50 N once stood under the axis's name."""
    shown = curves()
    small = tuple(replace(one, measured_N=0.6 * X, modelled_N=0.6 * one.modelled_N) for one in shown.presses)
    figure = misfit.draw_presses(shown, small)
    figure.draw_without_rendering()
    for axes in figure.axes:
        name = axes.yaxis.label.get_window_extent()
        numbers = [one for one in axes.get_yticklabels() if one.get_text()]
        assert not [one.get_text() for one in numbers if one.get_window_extent().overlaps(name)]
        assert name.x0 > 0


@pytest.mark.parametrize(("low", "high"), [(0.033, 0.045), (0.1, 20.0), (3.0, 700.0)])
def test_an_axis_of_logarithms_has_numbers_however_short(low: float, high: float) -> None:
    _, (axes,) = style.new_figure(3.0, 2.0)
    misfit.label_covariate(axes, "the speed", "log10 mm/s", levels=(), values=np.log10([low, high]))
    assert len(axes.get_xticks()) >= 2
