"""The simulated gel against what is known of it from elsewhere: theory, finite elements, geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each

from tactilevision.mechanics.kappa import kappa
from tactilevision.synthetic import gel as truth
from tactilevision.synthetic.gel import BallPress, Grid, Prescribed
from tactilevision.synthetic.punch import Bevel, PunchPress, punch_profile


def grid(half_mm: float, step_mm: float) -> Grid:
    axis = np.arange(-half_mm, half_mm + step_mm / 2, step_mm)
    return Grid(axis, axis)


@pytest.mark.parametrize(("nu", "a_over_h"), [(0.45, 0.5), (0.4797, 2.5 / 3), (0.499, 1.5)])
def test_far_pressure_of_the_profile_is_hayes_kappa(nu: float, a_over_h: float) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(24)
    u, du, K = truth._waves(nu)
    phi = truth._punch_density((nodes + 1) / 2, weights / 2, u, (1 - K) * du, a_over_h)
    assert phi @ weights / 2 == pytest.approx(kappa(nu, a_over_h), rel=1e-7)


def test_thin_punch_on_a_thick_layer_sinks_as_on_a_half_space() -> None:
    radii = np.array([0.011, 0.015, 0.02, 0.04])
    depth = truth.layer_surface(0.4, 0.01, radii=radii)
    np.testing.assert_allclose(depth, 2 / np.pi * np.arcsin(0.01 / radii), atol=0.02)


@each("place_mm, rise", [(4, 0.088), (5, 0.102), (6, 0.072), (8, 0.028), (10, 0.012)])
def test_rise_that_the_camera_sees_is_that_of_other_elements(place_mm: float, rise: float) -> None:
    seen = -punch_profile(0.48, 2.5, 3.0).depth_at(place_mm, 0.4) / 0.4
    assert seen == pytest.approx(rise, abs=0.003)


def test_force_is_that_of_other_elements_at_this_edge_and_friction() -> None:
    """P/(E w) in mm at mu .3, edge .05: NGSolve at nu .4797, where it is .2 % less than at .48."""
    depths = np.array([0.15, 0.3, 0.4, 0.5])
    found = punch_profile(0.48, 2.5, 3.0).force_per_modulus(depths) / depths
    np.testing.assert_allclose(found, [18.93, 19.67, 20.17, 20.68], rtol=0.01)


def test_gel_gives_the_shape_more_rise_and_stiffness_as_it_goes_deeper() -> None:
    """A straight line would keep both: the stand-in that this replaced did."""
    profile = punch_profile(0.48, 2.5, 3.0)
    shallow, deep = (-profile.depth_at(4.0, w) / w for w in (0.1, 0.5))
    assert deep - shallow == pytest.approx(0.008, abs=0.003)
    c, beta = profile.line()
    assert beta == pytest.approx(0.85, abs=0.1)
    assert profile.force_per_modulus(0.4) == pytest.approx(c * 0.4 * (1 + beta * 0.4 / 3), rel=2e-3)
    np.testing.assert_array_equal(profile.force_per_modulus(np.array([-0.1, 0.0])), [0.0, 0.0])


def test_beyond_the_last_depth_solved_the_gel_goes_on_as_elements_do() -> None:
    """What was solved to .66 mm, cut off at .375 mm, where other gels fold, and continued to .6 mm."""
    whole = punch_profile(0.48, 2.5, 3.0)
    few = slice(int((whole.depths_mm < 0.376).sum()))
    short = replace(
        whole,
        depths_mm=whole.depths_mm[few],
        depth=whole.depth[few],
        shift=whole.shift[few],
        area_mm=whole.area_mm[few],
    )
    assert short.depths_mm[-1] == pytest.approx(0.375)
    assert short.force_per_modulus(0.6) == pytest.approx(whole.force_per_modulus(0.6), rel=3e-3)
    places = np.array([3.5, 4.0, 5.0, 6.0, 8.0])
    np.testing.assert_allclose(short.depth_at(places, 0.6), whole.depth_at(places, 0.6), atol=0.003 * 0.6)
    np.testing.assert_allclose(short.carried(0.6), whole.carried(0.6), atol=0.02 * 0.6)


def test_flat_face_and_bevel_lie_where_the_rigid_body_is() -> None:
    bevel = Bevel("right", 5.0, 0.4, 10.0, 2.5)
    press = PunchPress(punch_profile(0.48, 2.5, 3.0), 0.45, (0.5, -0.25), (0.01, -0.02), bevel)
    pad = grid(9.0, 0.05)
    depth = press.depth_mm(pad)
    x, y = pad.places((0.5, -0.25))
    face = np.hypot(x, y) < 2.3
    np.testing.assert_allclose(depth[face], (0.45 + 0.01 * x - 0.02 * y)[face], atol=1e-4)
    plane = 0.45 - 0.4 - (x - 5.0) * np.tan(np.deg2rad(10.0)) + 0.01 * x - 0.02 * y
    under = (x >= 5.0) & (x < 5.1) & (np.abs(y) < 1.0)
    np.testing.assert_allclose(depth[under], plane[under], atol=1e-4)
    everywhere = (x >= 5.0) & (np.abs(y) <= 2.5)
    assert (depth[everywhere] > plane[everywhere] - 1e-4).all()


@each("side", ["right", "left", "top", "bottom"])
def test_bevel_touches_where_depth_and_rise_make_up_its_height(side: str) -> None:
    profile = punch_profile(0.48, 2.5, 3.0)
    bevel = Bevel(side, 5.0, 0.4, 10.0, 2.5)
    touch = bevel.touch_depth_mm(profile)
    assert touch - profile.depth_at(5.0, touch) == pytest.approx(0.4, abs=1e-6)
    pad = grid(9.0, 0.1)
    free = PunchPress(profile, touch - 1e-4, (0.0, 0.0)).depth_mm(pad)
    with_bevel = PunchPress(profile, touch - 1e-4, (0.0, 0.0), bevel=bevel).depth_mm(pad)
    np.testing.assert_array_equal(free, with_bevel)
    dented = PunchPress(profile, touch + 0.02, (0.0, 0.0), bevel=bevel).depth_mm(pad)
    dent = dented - PunchPress(profile, touch + 0.02, (0.0, 0.0)).depth_mm(pad)
    row, column = np.unravel_index(np.argmax(dent), dent.shape)
    place = {"right": (5, 0), "left": (-5, 0), "top": (0, -5), "bottom": (0, 5)}[side]
    assert (pad.x_mm[column], pad.y_mm[row]) == pytest.approx(place, abs=0.11)


def test_close_to_the_punch_the_bevel_touches_late() -> None:
    profile = punch_profile(0.48, 2.5, 3.0)
    near, far = Bevel("right", 2.8, 0.4, 10.0, 0.4), Bevel("right", 5.0, 0.4, 10.0, 0.4)
    assert far.touch_depth_mm(profile) < 0.4 < near.touch_depth_mm(profile)


def test_ball_is_a_sphere_inside_and_smooth_at_the_rim() -> None:
    ball = BallPress(4.0, 1.6, 3.0, 0.48, (0.0, 0.0))
    places, depth = ball.section()
    inside = places < 1.6
    sphere = ball.section()[1][0] - 4.0 + np.sqrt(16.0 - places[inside] ** 2)
    np.testing.assert_allclose(depth[inside], sphere, atol=1e-12)
    rim = int(inside.sum())
    assert depth[rim] == pytest.approx(np.interp(1.6, places[inside], sphere), abs=0.004)
    slopes = np.diff(depth) / np.diff(places)
    assert slopes[rim + 1] == pytest.approx(slopes[rim - 2], rel=0.1)
    assert depth.min() < -0.01  # a bonded gel of nu = 0.48 rises beside the ball


def test_ball_on_a_half_space_sinks_as_sneddon_says() -> None:
    ball = BallPress(4.0, 0.4, 400.0, 0.4, (0.0, 0.0))
    assert ball.section()[1][0] == pytest.approx(0.2 * np.log(4.4 / 3.6), rel=2e-3)


def test_any_height_map_is_drawn_as_it_is() -> None:
    own = grid(3.0, 0.1)
    x, y = own.places()
    prescribed = Prescribed((0.1 * x + 0.05 * y).astype(np.float64), own)
    pad = grid(2.0, 0.25)
    px, py = pad.places()
    np.testing.assert_allclose(prescribed.depth_mm(pad), 0.1 * px + 0.05 * py, atol=1e-5)
