"""Where a law loses its ellipticity, against the closed forms of plane strain and small strain."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from tactilevision.mechanics.punch_fem.laws import Hencky, Law, NeoHooke, deformation, least_acoustic
from tactilevision.mechanics.tables.cases import Case
from tactilevision.mechanics.tables.solve import LOST, solve_case
from tactilevision.records.measured import Floats, Material


def sheared(stretch: Floats, law: Law, nu: float) -> Floats:
    """Plane strain without change of volume, turned by 20 degrees."""
    turn = np.array([[math.cos(0.35), -math.sin(0.35)], [math.sin(0.35), math.cos(0.35)]])
    F = np.ones((len(stretch), 5))
    for row, one in zip(F, stretch, strict=True):
        row[:4] = (turn @ np.diag([one, 1 / one])).ravel()
    return least_acoustic(law, Material(0.3, nu), state=deformation(F))


@pytest.mark.parametrize("law", [NeoHooke(), Hencky()], ids=["neo-hooke", "hencky"])
def test_small_strain_has_the_shear_modulus(law: Law) -> None:
    assert sheared(np.array([1.0]), law, 0.4)[0] == pytest.approx(1.0)


def test_henckys_law_ends_where_the_shear_stress_is_at_its_top() -> None:
    """Shear stress over amount k is asinh(k/2) / sqrt(1 + k²/4): stationary at e tanh e = 1, e = ln(stretch)."""
    last = math.exp(brentq(lambda e: e * math.tanh(e) - 1, 1, 2))
    before, after = sheared(np.array([0.99, 1.01]) * last, Hencky(), 0.49999)
    assert before > 0 > after
    assert sheared(np.array([last]), Hencky(), 0.4)[0] < 0


def test_neo_hooke_never_ends() -> None:
    assert (sheared(np.array([2.0, 5.0, 20.0]), NeoHooke(), 0.48) > 0).all()


@pytest.mark.slow
def test_a_press_says_that_the_law_ended() -> None:
    """Hencky, mu = .3, nu = .487, a/h = 1: lost from w/h of about .1 on."""
    depths = (0.05, 0.1, 0.15, 0.2)
    found = solve_case(Case("hencky", 0.3, 1 / 60, 5.0, 0.487, 1.0), depths)
    assert len(found.depth) < len(depths)
    assert found.ended == LOST
