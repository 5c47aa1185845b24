"""The limits of contact: as the manual has them, in the unit of what they judge, and rare by chance alone."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.records.contact_thresholds import (
    CONTACT,
    cell_limit_mm,
    depth_limit_mm,
    live_limit_mm,
    reading_limit,
    slope_limit,
    wide_depth_limit_mm,
)


def test_each_limit_is_its_equation() -> None:
    assert slope_limit(0.01) == pytest.approx(0.041)
    assert depth_limit_mm(0.001, 1.0) == 0.01
    assert depth_limit_mm(0.01, 1.0) == pytest.approx(0.05)
    assert depth_limit_mm(0.2, 1.0) == 0.5, "half of the map is pressed, and that is no noise"
    assert live_limit_mm(np.array([[0.01]])).item() == pytest.approx(0.05)
    assert (reading_limit(0.01, 1.0), reading_limit(0.001, 1.0)) == (0.05, 0.03)
    assert cell_limit_mm(np.array([0.001, 0.02]), 1.0).tolist() == [0.03, 0.06]


@pytest.mark.parametrize("seed", range(3))
def test_untouched_gel_passes_the_wide_limit_in_less_than_one_picture_of_two(seed: int) -> None:
    patches = 200
    depth = np.random.default_rng(seed).standard_normal((400, patches))
    limit = wide_depth_limit_mm(np.ones((1, 1)), patches * CONTACT.depth_wave_mm**2).item()
    assert np.mean(depth.max(axis=1) > limit) < 0.5
