"""Shear read from simulated frames of a sheared contact, with the camera's lights, blur and noise."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.shear import LOOKS, shear_errors


def test_markers_give_the_tangential_force_and_say_how_well() -> None:
    rows = shear_errors(LOOKS[3], cases=3, seed=5)
    assert np.median(np.abs(rows[:, 3:5])) < 0.05
    assert np.abs(rows[:, 5:7]).max() < 3
    assert np.median(rows[:, 0]) < 60


@pytest.mark.slow
def test_a_strong_grain_is_followed_and_a_faint_one_is_not_pretended() -> None:
    strong, faint = shear_errors(LOOKS[2], cases=3, seed=5), shear_errors(LOOKS[0], cases=2, seed=5)
    known = np.isfinite(strong[:, 3])
    assert known.sum() >= 2
    assert np.abs(strong[known, 5:7]).max() < 3
    assert np.isnan(faint[:, 3:5]).all()
