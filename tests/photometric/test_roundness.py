"""Round contacts are told from others by slopes that point to one axis, wherever that lies."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.heightmap.self_calibration import TERMS, Contact, round_equations
from tactilevision.photometric.methods.polynomial import design
from tactilevision.records.measured import Floats

LIGHT = np.array([[0.9, 0.3], [-0.7, 0.6], [0.1, -0.8]])  # change of three colours with the two slopes
LAW = np.zeros((2, len(TERMS)))
for colour in range(3):
    LAW[:, TERMS.tolist().index([colour, 0])] = np.linalg.pinv(LIGHT)[:, colour]


def dent(stretch: float, axis: tuple[float, float]) -> Contact:
    """An elliptical dent, `stretch` times as long as wide, seen with little noise."""
    rng = np.random.default_rng(7)
    outward = rng.uniform(-0.7, 0.7, (400, 2))
    away = outward - axis
    slopes = -0.5 * away / np.array([stretch**2, 1.0])
    change = slopes @ LIGHT.T + 0.002 * rng.standard_normal((400, 3))
    place = np.zeros((400, 2))
    return Contact(np.zeros((0, 2 * len(TERMS))), design(change, place, TERMS), change, place, outward)


def residual(rows: Floats, law: Floats) -> float:
    return float(np.sqrt(np.sum((rows @ law.ravel()) ** 2)))


@pytest.mark.parametrize("axis", [(0.0, 0.0), (0.2, -0.15)])
def test_a_round_dent_asks_for_the_law_that_reads_it_right(axis: tuple[float, float]) -> None:
    rows = round_equations(dent(1.0, axis), LAW)
    assert rows is not None
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    assert residual(rows, turn @ LAW) > 5.0 * residual(rows, LAW)


def test_a_long_dent_is_not_taken_as_round() -> None:
    assert round_equations(dent(2.0, (0.0, 0.0)), LAW) is None
