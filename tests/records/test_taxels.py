"""Means over taxels: exact overlaps, conserved force, and what was not seen."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.profile.model import Seen
from tactilevision.records.maps import HeightMap, TractionMap
from tactilevision.records.taxels import TaxelGrid

MM = 0.1


def seen(*, valid: bool = True, sheared: bool = True) -> Seen:
    """A ball of 4 mm, .3 mm deep, and gel that sinks next to it; tractions on a grid of their own."""
    y, x = np.mgrid[:81, :101] * MM
    away = np.hypot(x - 5.0, y - 4.0)
    ball = 0.3 - (4 - np.sqrt(np.maximum(16 - away**2, 0)))
    touched = ball > 0
    known = np.full(x.shape, True)
    known[:, :20] = valid
    height = HeightMap(np.where(touched, ball, 0.05), known, (MM, MM))
    t_z = np.zeros((9, 11))
    t_z[3:6, 4:7] = 0.02
    force = (0.0, 0.0, 0.02 * 9 * 0.25)
    t_y = 0.1 * t_z if sheared else np.full_like(t_z, np.nan)
    tractions = TractionMap(0 * t_y, t_y, t_z, (0.5, 0.5), force, force, first_mm=(-2.5, -2.0))
    return Seen(height, touched, None, tractions, ())


def test_the_force_is_conserved_whatever_the_grid() -> None:
    for grid in (TaxelGrid(5, 6, (0.7, 0.9)), TaxelGrid(16, 20, (0.23, 0.21), (0.03, -0.05))):
        force = seen().at_taxels(grid).force_N
        assert force is not None
        assert np.nansum(force[2]) == pytest.approx(0.045)
        assert np.nansum(force[1]) == pytest.approx(0.0045)


def test_the_normal_force_is_known_without_shear() -> None:
    force = seen(sheared=False).at_taxels(TaxelGrid(5, 6, (0.7, 0.9))).force_N
    assert force is not None
    assert np.isnan(force[:2]).all()
    assert np.nansum(force[2]) == pytest.approx(0.045)


def test_penetration_is_in_metres_and_zero_outside_contact() -> None:
    found = seen().at_taxels(TaxelGrid(7, 9, (1.0, 1.0)))
    assert found.penetration_m[3, 4] == pytest.approx(3e-4 - 1e-6 / 6 / 8e-3, rel=0.01)  # its mean sag over 1 mm
    assert found.penetration_m[0, 0] == 0
    volume = found.penetration_m.sum() * 1e-6
    assert volume == pytest.approx(np.pi * 0.3e-3**2 * (4e-3 - 0.1e-3), rel=0.01)  # of the ball's cap


def test_taxels_that_were_not_seen_are_nan() -> None:
    grid = TaxelGrid(3, 3, (3.3, 2.0))
    found = seen(valid=False).at_taxels(grid)
    assert np.isnan(found.penetration_m[:, 0]).all()
    assert np.isfinite(found.penetration_m[:, 1:]).all()


def test_impossible_grids_are_refused() -> None:
    with pytest.raises(InputError, match="at least one row"):
        TaxelGrid(0, 3, (1.0, 1.0))
    with pytest.raises(InputError, match="pitches above 0"):
        TaxelGrid(2, 3, (1.0, float("nan")))
