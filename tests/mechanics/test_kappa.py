"""kappa against independent values, its limits, its convergence, and the table behind fast_kappa."""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import fast_kappa, kappa, make_table
from tactilevision.mechanics.punch_equation import layer_defect, solve_punch

REFERENCE = Path(__file__).parents[2].parent / "shared/reference/hayes_kappa.csv"

# (nu, a/h, kappa), a/h = .833333 standing for 2.5/3: digits of the reference table, which others computed from the
# same equation with 64 Gauss points
PINNED = [
    (0.0, 0.2, 1.178010105),
    (0.0, 3.0, 5.308692213),
    (0.05, 0.2, 1.180213785),
    (0.45, 0.8, 2.535425491),
    (0.4797, 0.8, 2.706065245),
    (0.4797, 2.5 / 3, 2.810301527),
    (0.5, 1.0, 3.618735849),
    (0.5, 1.5, 6.003013084),
    (0.5, 1.75, 7.474577120),
    (0.5, 2.0, 9.149450452),
    (0.5, 2.5, 13.164004081),
    (0.5, 3.0, 18.157399381),
]


@each("nu, alpha, expected", PINNED)
def test_kappa_of_published_digits(nu: float, alpha: float, expected: float) -> None:
    assert kappa(nu, alpha) == pytest.approx(expected, abs=1e-8)


@pytest.mark.skipif(not REFERENCE.exists(), reason="reference values are not at hand")
def test_kappa_matches_the_reference_table() -> None:
    with REFERENCE.open() as lines:
        rows = [(float(r["nu"]), float(r["a_over_h"]), float(r["kappa"])) for r in csv.DictReader(lines)]
    nu, alpha, expected = np.array(rows).T
    alpha[np.isclose(alpha, 0.833333, atol=1e-9)] = 2.5 / 3  # printed with six digits
    assert np.abs(kappa(nu, alpha) - expected).max() < 1e-8


def test_kappa_tends_to_the_half_space() -> None:
    # kappa = 1 + (2/pi) m(0) alpha + O(alpha^2), m(0) = Int (1 - K) du
    from scipy.integrate import quad

    first, second = ((kappa(0.48, alpha) - 1) / alpha for alpha in (0.1, 0.05))
    slope = 2 / np.pi * quad(lambda u: float(layer_defect(np.array(u), 0.48)), 0, 40)[0]
    assert 2 * second - first == pytest.approx(slope, rel=0.01)


def test_kappa_of_a_wide_punch_tends_to_uniform_compression() -> None:
    # P -> pi a^2 M w / h with M = E (1 - nu) / ((1 + nu)(1 - 2 nu)); the edge adds a term of order h/a
    nu, alphas = 0.3, np.array([5.0, 10.0])
    modulus = (1 - nu) / ((1 + nu) * (1 - 2 * nu)) * (1 - nu**2)
    ratio = kappa(nu, alphas) / (np.pi / 2 * alphas * modulus)
    assert ratio[1] == pytest.approx(1, abs=0.1)
    assert 2 * ratio[1] - ratio[0] == pytest.approx(1, abs=0.003)


def test_quadrature_converges_geometrically() -> None:
    exact = solve_punch(0.499, 10.0, nodes=128).kappa
    errors = [abs(solve_punch(0.499, 10.0, nodes=n).kappa / exact - 1) for n in (16, 32, 48, 64)]
    assert all(later < earlier / 20 for earlier, later in pairwise(errors))
    assert errors[-1] < 1e-10


def test_fast_kappa_holds_its_stated_error_everywhere() -> None:
    rng = np.random.default_rng(1)
    nu = np.concatenate([rng.uniform(0, 0.5, 250), 0.5 - 10 ** rng.uniform(-5, -1, 240), [0, 0, 0.5, 0.5]])
    alpha = np.concatenate([np.exp(rng.uniform(np.log(0.05), np.log(10), 490)), [0.05, 10, 0.05, 10]])
    assert np.abs(fast_kappa(nu, alpha) / kappa(nu, alpha) - 1).max() < 1e-7


def test_shapes_broadcast() -> None:
    assert isinstance(kappa(0.4, 1.0), float)
    assert np.shape(kappa(np.array([0.3, 0.4]), np.array([[1.0], [2.0], [3.0]]))) == (3, 2)
    assert fast_kappa(np.array([0.3, 0.4]), 1.0).shape == (2,)


def test_table_is_reproduced_from_the_equation(tmp_path: Path) -> None:
    from tactilevision.mechanics.kappa import TABLE

    make_table(tmp_path / "table.npz")
    with np.load(TABLE) as shipped, np.load(tmp_path / "table.npz") as fresh:
        np.testing.assert_allclose(shipped["log_kappa"], fresh["log_kappa"], rtol=0, atol=1e-11)


@each("nu, alpha", [(-0.01, 1), (0.51, 1), (0.4, 0.04), (0.4, 10.1), (float("nan"), 1)])
def test_nothing_is_extrapolated(nu: float, alpha: float) -> None:
    for function in (kappa, fast_kappa):
        with pytest.raises(InputError, match="lies in"):
            function(nu, alpha)
