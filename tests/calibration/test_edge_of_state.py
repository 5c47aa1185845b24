"""The contact of a rounded edge, sample by sample."""

from __future__ import annotations

import numpy as np

from calibration.laws.flat_punch import on_its_edge
from calibration.model.stages import State


def test_samples_of_unknown_thickness_end_and_stay_as_they_are() -> None:
    """A thickness that grows along places which nobody recorded is not a number: the search never ended."""
    one = np.ones(4)
    thickness = np.array([3.0, np.nan, 3.0, np.nan])
    state = State(0.3 * one, 2.5 * one, 0.1 * one, thickness, one, 0 * one, 0 * one)
    met = on_its_edge(state, 0.48)
    np.testing.assert_array_equal(met.radius_mm[1::2], 2.5)
    np.testing.assert_array_equal(met.factor[1::2], 1.0)
    assert (met.factor[::2] < 1.0).all()
    known = on_its_edge(State(0.3 * one, 2.5 * one, 0.1 * one, 3.0 * one, one, 0 * one, 0 * one), 0.48)
    np.testing.assert_array_equal(met.radius_mm[::2], known.radius_mm[::2])
    np.testing.assert_array_equal(met.factor[::2], known.factor[::2])
