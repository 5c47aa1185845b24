"""The surface in perspective says by how much its depth is exaggerated, within the picture."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from tactilevision.errors import InputError
from tactilevision.plots.height import (
    draw_difference,
    draw_height,
    draw_normals,
    draw_overlay,
    draw_surface,
    draw_terms,
)
from tactilevision.records.maps import LIGHT, HeightMap


def test_the_scale_is_told_within_the_picture() -> None:
    y, x = np.mgrid[:24, :32]
    depth = 0.3 * np.exp(-((x - 16) ** 2 + (y - 12) ** 2) / 20)
    figure = draw_surface(HeightMap(depth, np.ones_like(depth, bool), (0.5, 0.5), name="a"))
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
    title = figure.axes[0].get_title(loc="left")
    assert title.startswith("a: surface")
    assert "vertical scale" in title
    (words,) = [text for text in figure.findobj() if getattr(text, "get_text", lambda: "")() == title]
    box = words.get_window_extent()
    assert figure.bbox.y0 <= box.y0
    assert box.y1 <= figure.bbox.y1


def test_no_picture_of_a_doubtful_map_goes_without_saying_so() -> None:
    depth = np.tile(np.linspace(0.0, 0.2, 16), (12, 1))
    height = HeightMap(depth, np.ones_like(depth, bool), (0.5, 0.5), name="a", flags=(LIGHT,))
    rgb = np.zeros((12, 16, 3), np.uint8)
    figures = (
        draw_height(height),
        draw_surface(height),
        draw_overlay(rgb, height),
        draw_normals(height),
        draw_difference(height, height, title="a minus b"),
    )
    for figure in figures:
        assert "doubtful: light" in figure.axes[0].get_title(loc="left") + figure.axes[0].get_title()


def test_maps_of_two_sizes_or_scales_have_no_difference() -> None:
    one, wide = (HeightMap(np.zeros(shape), np.ones(shape, bool), (0.5, 0.5)) for shape in ((8, 6), (8, 9)))
    fine = HeightMap(np.zeros((8, 6)), np.ones((8, 6), bool), (0.5, 0.4))
    for other in (wide, fine):
        with pytest.raises(InputError, match="one size and scale"):
            draw_difference(one, other)


def test_titles_of_maps_with_many_flags_stay_inside_their_pictures() -> None:
    y, x = np.mgrid[:40, :60].astype(float)
    depth = 0.4 * np.exp(-((x - 30) ** 2 + (y - 20) ** 2) / 60)
    flags = ("assumed_scale", "light", "inconsistent_light", "steep")
    height = HeightMap(depth, np.ones(depth.shape, bool), (0.1, 0.1), name="reconstruct_10.png", flags=flags)
    rgb = np.full((40, 60, 3), 90, np.uint8)
    for figure in (
        draw_overlay(rgb, height),
        draw_difference(height, height, title="reconstruct_10.png minus reconstruct_9.png"),
        draw_terms(height, {"depth scale": 0.1 * depth, "zero plane": np.full(depth.shape, 0.01)}),
    ):
        FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
        title = figure.axes[0].get_title(loc="left")
        (name,) = [one.get_window_extent() for one in figure.findobj(Text) if one.get_text() == title]
        assert name.x1 < figure.bbox.x1
        assert name.y1 < figure.bbox.y1
