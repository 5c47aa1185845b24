"""The picture of E and nu together: what is drawn is what was handed in."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.plots.calibration import WORDS, draw_joint

CURVE = np.column_stack([np.linspace(0.43, 0.4999, 20), np.linspace(0.23, 0.18, 20)])
REGION = np.array([[0.465, 0.21], [0.485, 0.2], [0.485, 0.19], [0.465, 0.2]])


def test_the_region_the_best_value_and_every_route_are_drawn() -> None:
    routes = [("bulge", (0.468, 0.484), True), ("beta", (0.40, 0.42), False)]
    figure = draw_joint(CURVE, REGION, best=(0.475, 0.2), routes=routes)
    (axes,) = figure.axes
    labels = [line.get_label() for line in axes.lines]
    assert WORDS["bulge"] in labels
    assert any("off the picture" in str(label) and "0.400 to 0.420" in str(label) for label in labels)
    left, right = axes.get_xlim()
    assert left < 0.465
    assert right > 0.485
    bottom, top = axes.get_ylim()
    assert bottom < 0.19
    assert top > 0.21
    (place,) = [line for line in axes.lines if line.get_marker() == "o"]
    assert (place.get_xdata()[0], place.get_ydata()[0]) == pytest.approx((0.475, 0.2))  # type: ignore[index]
    (arrow,) = [line for line in axes.lines if line.get_marker() == "<"]
    inside = (float(np.asarray(arrow.get_xdata(), dtype=float)[0]) - left) / (right - left)
    assert 0 < inside < 0.03, "it points to where the interval lies"


@pytest.mark.parametrize("nu", [0.48, 0.0, 0.4999])
def test_a_nu_that_is_stated_without_doubt_is_drawn_too(nu: float) -> None:
    curve = np.column_stack([np.linspace(nu - 0.04 if nu else 0.0, 0.4999, 7), np.linspace(0.23, 0.18, 7)])
    region = np.array([[nu, 0.21], [nu, 0.19]])
    (axes,) = draw_joint(curve, region, best=(nu, 0.2), routes=[("prior", (nu, nu), True)]).axes
    left, right = axes.get_xlim()
    assert left <= nu < right
    assert not any("off the picture" in str(line.get_label()) for line in axes.lines)
