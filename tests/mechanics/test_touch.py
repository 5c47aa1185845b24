"""The bevel touches early where the gel has risen and late where it sinks in."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.mechanics.profile import ProfileModel, PunchCase, seen_profile, touch_depth
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Indenter

PUNCH = Indenter("A", radius_mm=2.5, height_mm=0.4, height_std_mm=0.005, bevel_distance_mm=5.0)


def test_touch_is_early_by_the_rise() -> None:
    touch = touch_depth(PUNCH, thickness_mm=3.0, poisson_ratio=0.48, poisson_ratio_std=0.01)
    case = PunchCase(0.48, 2.5 / 3, touch.depth_mm / 3)
    assert touch.depth_mm * (1 + float(seen_profile(np.array([2.0]), case)[0])) == pytest.approx(0.4, abs=1e-9)
    assert touch.depth_mm / 0.4 == pytest.approx(0.91, abs=0.01)
    # height .005/1.1, nu .01 is .011 w, distance .1 mm is .003 w, source 6 % of .097 w
    expected = np.linalg.norm([0.005, *(0.364 * np.array([0.0115, 0.002, 0.006]))]) / 1.097
    assert touch.depth_std_mm == pytest.approx(expected, rel=0.1)


def test_touch_near_the_punch_is_late() -> None:
    near = Indenter("B", radius_mm=2.5, height_mm=0.4, bevel_distance_mm=2.9)
    assert touch_depth(near, thickness_mm=3.0, poisson_ratio=0.48, poisson_ratio_std=0.0).depth_mm > 0.4


def test_no_rise_no_correction() -> None:
    def flat(r_over_a: Floats, case: PunchCase, /) -> tuple[Floats, Floats]:
        return 0 * r_over_a, 0 * r_over_a

    model = ProfileModel(flat, "a surface that stays flat", 0.0)
    touch = touch_depth(PUNCH, thickness_mm=3.0, poisson_ratio=0.3, poisson_ratio_std=0.1, model=model)
    assert (touch.depth_mm, touch.depth_std_mm) == pytest.approx((0.4, 0.005))


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="bevel_distance_mm"):
        touch_depth(
            Indenter("C", radius_mm=2.5, height_mm=0.4),
            thickness_mm=3.0,
            poisson_ratio=0.48,
            poisson_ratio_std=0.01,
        )
    with pytest.raises(InputError, match="outside the face"):
        touch_depth(
            Indenter("D", radius_mm=2.5, height_mm=0.4, bevel_distance_mm=2.0),
            thickness_mm=3.0,
            poisson_ratio=0.48,
            poisson_ratio_std=0.01,
        )
