"""Slow waves of untouched gel are no contact, weak contacts among them are, and only borders cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_forces import GEL, MATERIAL, SCALE, VIEW, hertz, measured
from scipy.ndimage import gaussian_filter

from tactilevision.force.field import CUT, NO_CONTACT, ForceField
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Floats

FREE = np.zeros((3, 360, 480))
SLOW_PX = 8.0  # the waves are alike over 1.4 mm


@pytest.fixture(scope="module")
def field() -> ForceField:
    return ForceField(GEL, MATERIAL, SCALE, view_px=VIEW.shape)


def stated_mm() -> Floats:
    """1 um in the middle of the view, 35 um in its corners, as dark corners make it."""
    x, y = np.meshgrid(np.linspace(-1, 1, VIEW.shape[1]), np.linspace(-1, 1, VIEW.shape[0]))
    return np.asarray(0.001 + 0.017 * (x**4 + y**4))


def with_waves(height: HeightMap, seed: int, understated: float = 1.0) -> HeightMap:
    """`height` with slow waves `understated` times as high as it then states."""
    wave = gaussian_filter(np.random.default_rng(seed).standard_normal(VIEW.shape), SLOW_PX, mode="wrap")
    wave /= 0.5 / (SLOW_PX * np.sqrt(np.pi))  # the deviation that is left of white noise
    return replace(height, depth_mm=height.depth_mm + understated * stated_mm() * wave, std_mm=stated_mm())


@pytest.mark.parametrize(("understated", "most"), [(1.0, 0), (1.5, 0), (2.5, 4)])
def test_slow_waves_of_the_free_gel_are_no_contact(field: ForceField, understated: float, most: int) -> None:
    """Also where the map states too little: that shows in the map itself, unless few cells are left to show it."""
    free = measured(FREE, std_mm=1e-5)[0]
    found = [field(with_waves(free, seed, understated)) for seed in range(40)]
    assert sum(NO_CONTACT not in one.flags for one in found) <= most


def test_a_weak_contact_is_found_where_the_map_is_quiet_though_corners_rise_higher(field: ForceField) -> None:
    weak = measured(hertz(1.2, (0.5, 0.3), (0.0, 0.0, 0.02)), std_mm=1e-5)[0]
    found = [field(with_waves(weak, seed)) for seed in range(10)]
    assert all(NO_CONTACT not in one.flags for one in found)
    assert np.median([one.resultant_N[2] for one in found]) == pytest.approx(0.02, rel=0.25)
    highest = [-with_waves(weak, seed).depth_mm.min() for seed in range(10)]
    assert np.median(highest) > weak.depth_mm.max(), "the corners rise higher than this contact is deep"


def test_a_hole_of_the_map_beside_a_contact_does_not_cut_it_but_may_hide_force(field: ForceField) -> None:
    height = measured(hertz(2.0, (0.0, 0.0), (0.0, 0.0, 0.6)))[0]
    holes = height.valid.copy()
    holes[42:49, 68:73] = False
    whole, holed = field(height), field(replace(height, valid=holes))
    assert CUT not in holed.flags
    missing = whole.resultant_N[2] - holed.resultant_N[2]
    assert 0 < missing < 2 * holed.resultant_std_N[2]
    assert holed.resultant_std_N[2] > whole.resultant_std_N[2]
    holes[42:49, 68:] = False
    assert CUT in field(replace(height, valid=holes)).flags, "what is open to the border is no hole"


def test_an_uncertain_depth_scale_counts_though_dark_corners_are_noisier(field: ForceField) -> None:
    height = measured(hertz(2.0, (0.0, 0.0), (0.0, 0.0, 0.6)), std_mm=1e-5)[0]
    corners = replace(height, std_mm=stated_mm(), untouched_std_mm=stated_mm())
    uncertain = replace(corners, std_mm=np.hypot(stated_mm(), 0.03 * height.depth_mm))
    sure, unsure = field(corners), field(uncertain)
    assert unsure.resultant_N[2] == pytest.approx(sure.resultant_N[2], rel=1e-3)
    gain = np.sqrt(unsure.resultant_std_N[2] ** 2 - sure.resultant_std_N[2] ** 2) / unsure.resultant_N[2]
    assert gain == pytest.approx(0.03, rel=0.15)
