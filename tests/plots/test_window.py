"""The window on height maps, moved by events as a toolkit sends them."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backend_bases import FigureCanvasBase, KeyEvent, MouseButton, MouseEvent
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tactilevision.plots.viewer import Window, along
from tactilevision.records.maps import LIGHT, HeightMap
from tactilevision.records.measured import Floats

SCALE = (0.1, 0.2)
NAMES = ["a.png", "b.png", "c.png"]


def ramp(number: int) -> HeightMap:
    """Depth = number + 2 x + y, all in mm; one corner is not known."""
    y, x = np.mgrid[:20, :30]
    valid = np.ones((20, 30), np.bool_)
    valid[0, 0] = False
    return HeightMap(number + 2 * x * SCALE[0] + y * SCALE[1], valid, SCALE, name=NAMES[number])


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Window:
    monkeypatch.setattr(FigureCanvasBase, "draw_idle", lambda canvas: None)  # a toolkit draws when it is idle
    opened = Window(NAMES, ramp, number=1)
    FigureCanvasAgg(opened.figure).draw()  # type: ignore[no-untyped-call]
    return opened


def mouse(window: Window, kind: str, x_mm: float, y_mm: float) -> None:
    x, y = window.map.transData.transform((x_mm, y_mm))
    canvas: FigureCanvasBase = window.figure.canvas
    canvas.callbacks.process(kind, MouseEvent(kind, canvas, x, y, MouseButton.LEFT))


def key(window: Window, name: str) -> None:
    canvas = window.figure.canvas
    canvas.callbacks.process("key_press_event", KeyEvent("key_press_event", canvas, name))


def drawn(window: Window) -> tuple[Floats, Floats]:
    place, value = window.profile.lines[0].get_data()
    return np.asarray(place), np.asarray(value)


def test_a_drag_on_the_map_draws_the_profile_along_it(window: Window) -> None:
    mouse(window, "button_press_event", 0.5, 1.0)
    mouse(window, "motion_notify_event", 1.5, 2.0)
    mouse(window, "button_release_event", 2.5, 3.0)
    place, value = drawn(window)
    assert place[-1] == pytest.approx(np.sqrt(8), rel=1e-6)
    assert value == pytest.approx(1 + 2 * 0.5 + 1.0 + 3 * place / np.sqrt(2), rel=1e-6)
    assert window.map.lines[0].get_xdata() == pytest.approx([0.5, 2.5])


def test_a_click_and_a_drag_beside_the_map_leave_the_profile(window: Window) -> None:
    before = window.line
    mouse(window, "button_press_event", 0.5, 1.0)
    mouse(window, "button_release_event", 0.5, 1.0)
    mouse(window, "button_press_event", 30.0, 1.0)
    mouse(window, "motion_notify_event", 1.0, 1.0)
    mouse(window, "button_release_event", 1.0, 1.0)
    assert window.line == before


def test_keys_and_the_slider_go_through_the_frames(window: Window) -> None:
    key(window, "n")
    assert window.height.name == "c.png"
    key(window, "n")
    assert window.number == 2
    key(window, "b")
    assert window.number == 1
    assert window.slider is not None
    window.slider.set_val(0)
    assert window.map.get_title(loc="left") == "a.png: depth of the gel's surface"
    assert np.nanmax(np.asarray(window.map.images[0].get_array())) == pytest.approx(2 * 2.9 + 3.8)


def test_a_difference_is_to_the_marked_frame(window: Window) -> None:
    key(window, "d")  # none is marked: the first
    assert window.map.get_title(loc="left") == "b.png: depth minus that of a.png"
    key(window, "n")
    key(window, "m")
    key(window, "b")
    assert window.map.get_title(loc="left") == "b.png: depth minus that of c.png"
    shown = window.map.images[0].get_array()
    assert shown is not None
    assert np.asarray(shown)[1:] == pytest.approx(-1)
    assert np.ma.getmaskarray(shown)[0, 0]
    key(window, "d")
    assert window.map.get_title(loc="left") == "b.png: depth of the gel's surface"


def test_grey_pixels_are_named_and_the_surface_says_its_scale(window: Window) -> None:
    legend = window.map.get_legend()
    assert legend is not None
    assert "depth not known" in {text.get_text() for text in legend.get_texts()}
    assert "vertical scale" in window.surface.get_title()


def test_maps_of_two_sizes_have_no_difference_and_the_window_says_so() -> None:
    small = HeightMap(np.zeros((4, 5)), np.ones((4, 5), np.bool_), SCALE, name="small.tiff")
    window = Window(["a.png"], ramp, marked=small)
    assert "one size and scale" in window.help.get_text()
    assert not window.differs
    assert window.slider is None


def test_a_doubtful_map_and_one_of_which_nothing_is_known_are_drawn() -> None:
    nothing = HeightMap(np.zeros((4, 5)), np.zeros((4, 5), np.bool_), SCALE, name="n", flags=(LIGHT,))
    window = Window(["n"], lambda _: nothing)
    FigureCanvasAgg(window.figure).draw()  # type: ignore[no-untyped-call]
    assert "doubtful: light" in window.map.get_title(loc="left")
    assert np.isnan(drawn(window)[1]).all()


def test_a_profile_is_exact_on_a_plane_and_unknown_next_to_unknown_pixels() -> None:
    height = ramp(0)
    field = np.where(height.valid, height.depth_mm, np.nan)
    place, value = along(field, ((1.0, 0.0), (1.0, 3.8)), mm_per_px=SCALE)
    assert value == pytest.approx(2.0 + place)
    _, value = along(field, ((0.0, 0.0), (0.4, 0.0)), mm_per_px=SCALE)
    assert np.isnan(value[0])
    assert value[-1] == pytest.approx(0.8)


def test_on_the_screens_dots_no_words_cover_others(window: Window) -> None:
    FigureCanvasAgg(window.figure).draw()  # type: ignore[no-untyped-call]
    legend = window.map.get_legend()
    assert legend is not None
    title = window.surface.title
    for one, other in ((window.profile.xaxis.label, title), (window.map.xaxis.label, legend)):
        assert not one.get_window_extent().overlaps(other.get_window_extent())
