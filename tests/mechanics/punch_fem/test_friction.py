"""Between tabulated frictions: which blocks the monotone cubic asks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tactilevision.mechanics.flat_contact import friction_place
from tactilevision.mechanics.tables.blocks import Block
from tactilevision.mechanics.tables.grid import Axes
from tactilevision.mechanics.tables.table import neighbours

FRICTIONS = (0.0, 0.1, 0.15, 0.22, 0.3, 0.6, math.inf)


def blocks() -> list[Block]:
    """Empty ones, in no order."""
    axes, nothing = Axes(*(np.array([0.3, 0.4]),) * 3), np.zeros((2, 2, 2))
    return [Block("neo-hooke", mu, 1 / 60, axes, nothing, nothing, 4) for mu in reversed(FRICTIONS)]


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
