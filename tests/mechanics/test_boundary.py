"""The pad's free side softens the gel, the less the farther; against a fresh solution and in its limits."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.mechanics.boundary import (
    RATIO_A_OVER_H,
    RATIO_DISTANCES,
    RATIO_POISSON,
    TABLE,
    rim_share,
    softening,
)
from tactilevision.mechanics.boundary_solve import depth_ratio, linear_shares
from tactilevision.mechanics.flat_contact import FlatContact

GEL = {"radius_mm": 2.5, "thickness_mm": 3.0, "poisson_ratio": 0.48}


def test_far_side_does_nothing_and_a_near_one_much() -> None:
    s = softening(np.array([1.0, 3.0, 6.0, 12.5, 40.0]), **GEL)
    assert (np.diff(s) < 0).all()
    np.testing.assert_allclose(s[:4], [0.32, 0.088, 0.020, 7e-4], rtol=0.15)
    assert s[4] < 1e-6


def test_incompressible_gel_feels_the_side_more() -> None:
    by_nu = [float(softening(3.0, radius_mm=2.5, thickness_mm=3.0, poisson_ratio=nu)) for nu in (0.3, 0.45, 0.499)]
    assert by_nu[0] < by_nu[1] < by_nu[2]


@pytest.mark.slow
def test_table_agrees_with_fresh_solutions_between_its_nodes() -> None:
    for nu, alpha, d in ((0.48, 1.0, 1.2), (0.465, 0.7, 0.6), (0.43, 2.5 / 3, 2.5)):
        fresh = linear_shares((alpha,), (nu,), distances=(d,)).item()
        ours = softening(3 * d, radius_mm=3 * alpha, thickness_mm=3.0, poisson_ratio=nu)
        assert float(ours) == pytest.approx(fresh, rel=0.03)


@pytest.mark.slow
def test_a_ratio_of_the_table_is_what_elements_give_today() -> None:
    at = RATIO_A_OVER_H.index(2.5 / 3), RATIO_POISSON.index(0.48), RATIO_DISTANCES.index(1.0), -1
    with np.load(TABLE, allow_pickle=False) as content:
        kept = content["ratio"][at]
    np.testing.assert_allclose(depth_ratio(2.5 / 3, 0.48, 1.0, math.inf), kept, rtol=0.002)


def share(depth_mm: float, pad_radius_mm: float, friction: float) -> float:
    """For the paper's punch."""
    contact = FlatContact(2.5, 0.05, 3.0, friction, pad_radius_mm=pad_radius_mm)
    return float(rim_share(depth_mm, contact, poisson_ratio=0.48))


def test_a_wide_pad_is_the_tables_own_and_the_share_grows_from_there() -> None:
    assert share(0.1, 15.0, 0.3) == share(0.1, 60.0, 0.3) == 0
    shares = [share(0.1, pad, 0.3) for pad in (14.99, 12.0, 9.0, 6.0, 4.0)]
    assert 0 < shares[0] < 1e-5
    assert (np.diff(shares) > 0).all()


def test_what_sticks_or_is_deep_leaves_the_rim_in_peace() -> None:
    assert share(0.1, 7.5, 0.0) > share(0.1, 7.5, 0.15) > share(0.1, 7.5, math.inf)
    assert share(0.1, 7.5, 0.3) > share(0.3, 7.5, 0.3) > share(0.6, 7.5, 0.3)


def test_card_states_what_the_table_is() -> None:
    card = json.loads(TABLE.with_suffix(".json").read_text())
    assert {"source", "made_by", "licence", "sha256"} <= set(card)


def test_nothing_is_extrapolated() -> None:
    with pytest.raises(InputError, match="d/h"):
        softening(0.5, **GEL)
    with pytest.raises(InputError, match="Poisson"):
        softening(5.0, radius_mm=2.5, thickness_mm=3.0, poisson_ratio=0.2)
