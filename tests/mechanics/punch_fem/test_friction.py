"""Between tabulated frictions: the monotone cubic against scipy's, and which blocks it asks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tactilevision.mechanics.flat_contact import friction_place
from tactilevision.mechanics.tables.blocks import Block
from tactilevision.mechanics.tables.grid import Axes
from tactilevision.mechanics.tables.table import monotone, neighbours

FRICTIONS = (0.0, 0.1, 0.15, 0.22, 0.3, 0.6, math.inf)


def blocks() -> list[Block]:
    """Empty ones, in no order."""
    axes, nothing = Axes(*(np.array([0.3, 0.4]),) * 3), np.zeros((2, 2, 2))
    return [Block("neo-hooke", mu, 1 / 60, axes, nothing, nothing, 4) for mu in reversed(FRICTIONS)]


@pytest.mark.parametrize("count", [3, 4, 6])
def test_it_is_the_cubic_that_scipy_has(count: int) -> None:
    rng = np.random.default_rng(count)
    places, values = np.sort(rng.random(count)), rng.normal(size=(count, 5, 2))
    cubic = PchipInterpolator(places, values)
    for at in np.linspace(places[0], places[-1], 11):
        np.testing.assert_allclose(monotone(places, values, at=float(at)), cubic(at), rtol=1e-9, atol=1e-12)


def test_between_two_it_is_straight() -> None:
    assert monotone(np.array([0.0, 2.0]), np.array([[1.0], [5.0]]), at=0.5) == pytest.approx(2.0)


def test_the_nearest_two_on_either_side_give_what_all_would() -> None:
    """And a tabulated friction asks its own block alone, be it met but for rounding."""
    effect = dict(zip(FRICTIONS, (0.0, 0.44, 0.67, 0.91, 0.97, 0.99, 1.0), strict=True))
    whole = PchipInterpolator([friction_place(mu) for mu in FRICTIONS], list(effect.values()))
    for mu in (0.03, 0.12, 0.17, 0.25, 0.5, 2.0):
        near = neighbours(blocks(), mu)
        blended = near.blend([np.array([effect[block.friction]]) for block in near.blocks])
        assert blended[0] == pytest.approx(float(whole(friction_place(mu))), rel=1e-12)
        low, high = near.about
        assert low.friction < mu < high.friction
    for mu in FRICTIONS:
        alone = neighbours(blocks(), mu * (1 + 1e-13))
        assert [block.friction for block in alone.blocks] == [block.friction for block in alone.about] == [mu]
