"""A rounded edge on a layer: increments, the half-space, a sharp edge, finite elements, the polynomial's error."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tactilevision.mechanics import filleted_punch
from tactilevision.mechanics.filleted_punch import rounded_contact
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.records.measured import Floats

ELEMENTS = Path(__file__).parents[2] / "benchmarks" / "blind" / "edge_fem.csv"


def force(depth: Floats, outer: float, edge: float, nu: float = 0.48, sticking: float = 0.0) -> Floats:
    """Of E/(1 - nu^2) = 1 MPa, on 3 mm."""
    r, share = rounded_contact(depth, outer, edge_mm=edge, thickness_mm=3.0, poisson_ratio=nu, sticking=sticking)
    return np.asarray(2 * r * fast_kappa(np.full(r.size, nu), r / 3.0) * share * depth)


@pytest.mark.parametrize(("outer", "edge", "nu"), [(2.5, 0.1, 0.48), (1.5, 0.5, 0.4999), (3.5, 0.3, 0.3)])
def test_each_step_of_depth_meets_a_flat_punch_of_the_contact_there(outer: float, edge: float, nu: float) -> None:
    """dP/dw = 2 r E* kappa(nu, r/h) for every smooth frictionless contact."""
    depth = np.linspace(1e-3, 0.6, 3001)
    r, _ = rounded_contact(depth, outer, edge_mm=edge, thickness_mm=3.0, poisson_ratio=nu)
    stiffness = 2 * r * fast_kappa(np.full(r.size, nu), r / 3.0)
    found = np.gradient(force(depth, outer, edge, nu=nu), depth)
    np.testing.assert_allclose(found[1:-1], stiffness[1:-1], rtol=3e-4)
    assert r[0] < outer - 0.9 * edge
    assert r[-1] <= outer


def test_on_a_thick_gel_the_contact_grows_as_on_a_half_space() -> None:
    """w = (r/rho) [sqrt(r^2 - b^2) - b arccos(b/r)]; the layer is felt at r/h = .05, where the table ends."""
    b, edge, r = 2.0, 0.5, np.array([2.05, 2.2, 2.45])
    depth = r / edge * (np.sqrt(r**2 - b**2) - b * np.arccos(b / r))
    found, _ = rounded_contact(depth, b + edge, edge_mm=edge, thickness_mm=200.0, poisson_ratio=0.48)
    np.testing.assert_allclose(found, r, rtol=8e-3)


def test_a_sharp_edge_is_all_there_from_the_first_touch() -> None:
    depth = np.array([0.0, 1e-3, 0.5])
    for edge in (0.0, 1e-9, 2e-5):
        r, share = rounded_contact(depth, 2.5, edge_mm=edge, thickness_mm=3.0, poisson_ratio=0.48)
        np.testing.assert_allclose(r[1:], 2.5, rtol=1e-4)
        np.testing.assert_allclose(share[1:], 1.0, rtol=1e-4)


@pytest.mark.parametrize("outer", [1.9, 2.5, 3.1])
def test_edges_twice_as_blunt_lose_what_elements_lose(outer: float) -> None:
    """Force of an edge of .2 mm over that of .1 mm, elements of a gel that slides, to 20 % of its thickness."""
    with ELEMENTS.open(newline="", encoding="utf-8") as file:
        rows = [
            {k: float(v) for k, v in row.items()}
            for row in csv.DictReader(line for line in file if not line.startswith("#"))
        ]
    mine = {(row["edge_mm"], row["w_mm"]): row["P_over_w_N_per_mm"] for row in rows if row["a_mm"] == outer}
    depth = np.array([w for edge, w in mine if edge == 0.2])
    elements = np.array([mine[0.2, w] / mine[0.1, w] for w in depth])
    np.testing.assert_allclose(force(depth, outer, 0.2) / force(depth, outer, 0.1), elements, rtol=4e-3)
    assert elements[0] < 0.94


def test_on_gel_that_sticks_the_contact_grows_as_slowly_as_on_a_half_space() -> None:
    """Elements that do not slip (neo-Hooke): P/w of an edge of .3 mm over one of .05 mm, w .05 to .4 mm."""
    depth = np.array([0.05, 0.1, 0.2, 0.3, 0.4])
    elements = np.array([15.2961, 15.8266, 16.6824, 17.4744, 18.2230])
    elements /= np.array([18.4511, 18.7525, 19.3151, 19.8650, 20.4090])
    found = [force(depth, 2.5, 0.3, sticking=s) / force(depth, 2.5, 0.05, sticking=s) / elements for s in (1, 0)]
    np.testing.assert_allclose(found[0], 1, atol=7e-3)
    assert found[1][-1] > 1.03


def test_what_is_kept_of_the_layer_is_as_good_as_stated() -> None:
    """Relative error of the polynomial below 2e-4 at places between its nodes."""
    rng = np.random.default_rng(4)
    for nu in (0.45, 0.48, 0.4999):
        ratio, v = float(rng.uniform(0.2, 1.5)), rng.uniform(0.1, 0.99, 6)
        kept = filleted_punch._of_layers([nu], np.full((1, 6), ratio), v[None])[:, 0]
        np.testing.assert_allclose(kept, filleted_punch.exact_ratios(nu, ratio, v=v), rtol=2e-4)


def test_splines_of_many_punches_are_scipys() -> None:
    rng = np.random.default_rng(3)
    x, y = np.cumsum(rng.uniform(0.1, 2, (3, 9)), axis=1), rng.normal(size=(3, 9, 2))
    for one, at, values in zip(filleted_punch._splines(x, y), x, y, strict=True):
        np.testing.assert_allclose(one, CubicSpline(at, values).c, rtol=1e-9, atol=1e-9)
