"""The correction vanishes with depth, and holds against nonlinear finite elements to a fifth of the thickness."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.force_depth import HELD_OUT, LIMIT, SEEN, Case, press_and_look
from tactilevision.force.large_depth import patch_factor

ONE = np.array([2.5])


def test_without_depth_or_stretch_nothing_is_corrected() -> None:
    none = np.zeros(1)
    assert patch_factor(ONE, none, stretch=none, thickness_mm=3.0, poisson_ratio=0.48)[0] == 1.0
    small = patch_factor(ONE, none + 1e-6, stretch=none, thickness_mm=3.0, poisson_ratio=0.48)[0]
    assert 0 < small - 1 < 1e-6


def test_a_narrow_contact_hardly_feels_the_thickness_and_a_wide_one_all_of_it() -> None:
    depth, none = np.array([0.3]), np.zeros(1)
    narrow, wide = (
        patch_factor(np.array([a]), depth, stretch=none, thickness_mm=3.0, poisson_ratio=0.48)[0]
        for a in (0.3, 8.0)
    )
    assert narrow < 1.02
    assert wide > 1.1


def test_a_patch_that_stretches_by_a_twentieth_is_as_a_wider_one() -> None:
    none = np.zeros(1)
    stretched = patch_factor(ONE, none, stretch=none + 0.05, thickness_mm=3.0, poisson_ratio=0.48)[0]
    assert 1.03 < stretched < 1.07


@pytest.mark.slow
@pytest.mark.parametrize("case", [SEEN[0], SEEN[4], SEEN[1], SEEN[5], HELD_OUT[0]], ids=lambda case: case.name)
def test_force_of_a_nonlinear_press_comes_back(case: Case) -> None:
    rows = press_and_look(case, depths_mm=(0.15, 0.3, 0.6))
    assert np.abs(rows[:, 2] / rows[:, 1] - 1).max() < LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("case", [SEEN[3], SEEN[5]], ids=lambda case: case.name)
def test_without_shear_a_gel_that_grips_is_read_within_what_is_stated(case: Case) -> None:
    rows = press_and_look(case, depths_mm=(0.15, 0.3, 0.6))
    assert np.abs(rows[:, 4] / rows[:, 1] - 1).max() < 0.07
    assert (np.abs(rows[:, 4] - rows[:, 1]) < 2 * rows[:, 5]).all()
