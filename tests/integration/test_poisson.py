"""Integration: exact for its own scheme, right at every contact size, second order, and honest about holes."""

from __future__ import annotations

import numpy as np
import pytest
from each import each
from hypothesis import given, settings, strategies as st

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.heightmap.poisson import divergence, gradient, integrate, solve_edges
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Floats

SHAPE = (240, 320)


def grid(shape: tuple[int, int], mm_per_px: tuple[float, float] = (1.0, 1.0)) -> tuple[Floats, Floats]:
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    return x * mm_per_px[0], y * mm_per_px[1]


def cap(radius_px: float, *, centre: tuple[float, float] = (160.3, 119.6)) -> tuple[Floats, SlopeMap]:
    """A ball's cap of that contact radius on flat gel: its depth, and its exact slopes."""
    x, y = grid(SHAPE)
    x, y = x - centre[0], y - centre[1]
    ball = 1.5 * radius_px
    inside = np.hypot(x, y) < radius_px
    drop = np.sqrt(np.maximum(ball**2 - x**2 - y**2, 1.0))
    depth = np.where(inside, drop - np.sqrt(ball**2 - radius_px**2), 0.0)
    return depth, SlopeMap(np.where(inside, -x / drop, 0.0), np.where(inside, -y / drop, 0.0))


@each("radius_px", [6, 9, 12, 18, 25, 35, 50, 70, 90])
def test_a_ball_is_as_deep_as_it_is_at_every_size(radius_px: float) -> None:
    depth, slopes = cap(radius_px)
    found = integrate(slopes, (1.0, 1.0))
    found -= np.median(found[:15])
    assert found.max() / depth.max() == pytest.approx(1.0, abs=0.02)
    assert np.sqrt(np.mean((found - depth) ** 2)) < 0.02 * depth.max()


def punch(
    tilt: tuple[float, float] = (0.0, 0.0), centre: tuple[float, float] = (160.0, 120.0)
) -> tuple[Floats, SlopeMap]:
    """A flat face 40 px in radius under walls 3 px wide, tilted, 5 deep; slopes by analytic differentiation."""
    x, y = grid(SHAPE)
    x, y = x - centre[0], y - centre[1]
    r = np.maximum(np.hypot(x, y), 1e-9)
    face, rate = 5.0 + tilt[0] * x + tilt[1] * y, 1.0 / 1.5
    wall = 0.5 * (1.0 - np.tanh(rate * (r - 40.0)))
    fall = -0.5 * rate / np.cosh(np.clip(rate * (r - 40.0), -300, 300)) ** 2
    return face * wall, SlopeMap(tilt[0] * wall + face * fall * x / r, tilt[1] * wall + face * fall * y / r)


def test_a_flat_face_is_not_bowed_and_a_tilted_one_keeps_its_tilt() -> None:
    for tilt in ((0.0, 0.0), (0.02, -0.03)):
        depth, slopes = punch(tilt)
        found = integrate(slopes, (1.0, 1.0))
        found -= np.median(found[:15])
        x, y = grid(SHAPE)
        face = np.hypot(x - 160, y - 120) < 34
        terms = np.stack([np.ones(face.sum()), x[face] - 160, y[face] - 120], axis=1)
        plane, *_ = np.linalg.lstsq(terms, found[face], rcond=None)
        assert plane[0] == pytest.approx(5.0, rel=0.02)
        assert plane[1:] == pytest.approx(np.array(tilt), abs=5e-4)
        assert np.ptp(found[face] - terms @ plane) < 0.02 * 5.0
        assert np.abs(found - depth).max() < 0.05 * 5.0


def test_a_contact_cut_by_the_border_is_right() -> None:
    depth, slopes = punch(centre=(25.0, 120.0))
    found = integrate(slopes, (1.0, 1.0))
    found -= np.median(found[:, -15:])
    assert found[115:125, 5:40].mean() / depth[115:125, 5:40].mean() == pytest.approx(1.0, abs=0.02)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(2, 40), st.integers(2, 40), st.floats(0.01, 3.0), st.floats(0.01, 3.0), st.integers(0, 2**32 - 1)
)
def test_it_is_exact_for_its_own_scheme(height: int, width: int, step_x: float, step_y: float, seed: int) -> None:
    x, y = grid((height, width), (step_x, step_y))
    a = np.random.default_rng(seed).normal(size=5)
    depth = a[0] * x + a[1] * y + a[2] * x * x + a[3] * x * y + a[4] * y * y
    slopes = SlopeMap(a[0] + 2 * a[2] * x + a[3] * y, a[1] + a[3] * x + 2 * a[4] * y)
    found = integrate(slopes, (step_x, step_y))
    assert found == pytest.approx(depth - depth.mean(), abs=1e-9 * max(1.0, np.abs(depth).max()))


def test_the_error_falls_with_the_square_of_the_pixel() -> None:
    errors = []
    for count in (16, 32, 64, 128):
        step = 1.0 / count
        x, y = grid((count, count), (step, step))
        x, y = x + step / 2, y + step / 2
        depth = np.sin(2.0 * x) * np.exp(y)
        slopes = SlopeMap(2.0 * np.cos(2.0 * x) * np.exp(y), np.sin(2.0 * x) * np.exp(y))
        found = integrate(slopes, (step, step))
        errors.append(np.abs(found - depth + depth.mean()).max())
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(rates > 1.9)


def test_it_solves_its_normal_equations() -> None:
    rng = np.random.default_rng(3)
    slopes = SlopeMap(rng.normal(size=(23, 31)), rng.normal(size=(23, 31)))
    step = (0.3, 0.7)
    g_x, g_y = gradient(integrate(slopes, step), step)
    p, q = slopes.dz_dx, slopes.dz_dy
    left = divergence(g_x - (p[:, 1:] + p[:, :-1]) / 2, g_y - (q[1:] + q[:-1]) / 2, step)
    assert np.abs(left).max() < 1e-11


def test_gradient_and_divergence_are_adjoint() -> None:
    rng = np.random.default_rng(4)
    depth, e_x, e_y = rng.normal(size=(9, 7)), rng.normal(size=(9, 6)), rng.normal(size=(8, 7))
    g_x, g_y = gradient(depth, (0.3, 0.7))
    assert np.vdot(g_x, e_x) + np.vdot(g_y, e_y) == pytest.approx(
        -np.vdot(depth, divergence(e_x, e_y, (0.3, 0.7)))
    )


def test_single_precision_is_good_for_a_tenth_of_a_micrometre() -> None:
    _, slopes = punch()
    single = SlopeMap(slopes.dz_dx.astype(np.float32), slopes.dz_dy.astype(np.float32))
    exact, quick = integrate(slopes, (0.064, 0.064)), integrate(single, (0.064, 0.064))
    assert quick.dtype == np.float32
    assert np.abs(quick - exact).max() < 1e-4


@each("shape", [(240, 320), (320, 427), (61, 47), (53, 128)])
def test_awkward_sizes_are_solved_as_exactly(shape: tuple[int, int]) -> None:
    x, y = grid(shape, (0.05, 0.06))
    depth = 0.3 * x - 0.2 * y + 0.01 * x * y
    slopes = SlopeMap((0.3 + 0.01 * y).astype(np.float32), (-0.2 + 0.01 * x).astype(np.float32))
    assert np.abs(integrate(slopes, (0.05, 0.06)) - depth + depth.mean()).max() < 2e-5


def test_a_hole_is_bridged_and_does_not_spoil_the_rest() -> None:
    depth, slopes = punch((0.02, -0.03))
    valid = np.ones(SHAPE, np.bool_)
    valid[60:100, 150:180] = False
    valid[200:210] = False
    spoiled = SlopeMap(np.where(valid, slopes.dz_dx, np.nan), np.where(valid, slopes.dz_dy, 9.0), valid)
    found = integrate(spoiled, (1.0, 1.0))
    found -= np.median(found[:15])
    assert np.isfinite(found).all()
    assert np.abs(found - depth)[valid][: 190 * 320].max() < 0.03 * 5.0


def test_slopes_known_to_be_wrong_are_silenced() -> None:
    depth, slopes = punch()
    wrong = np.array(slopes.dz_dx)
    wrong[100:140, 100:104] += 2.0
    kept = integrate(SlopeMap(wrong, slopes.dz_dy, wrong == slopes.dz_dx), (1.0, 1.0))
    spoiled = integrate(SlopeMap(wrong, slopes.dz_dy), (1.0, 1.0))
    error, without = (np.abs(z - np.median(z[:15]) - depth).max() for z in (kept, spoiled))
    assert error < 0.1 * without


def test_it_says_what_is_wrong() -> None:
    flat = np.zeros((8, 8))
    with pytest.raises(InputError, match="two fields"):
        integrate(SlopeMap(flat, np.zeros((8, 9))), (1.0, 1.0))
    rng = np.random.default_rng(1)
    with pytest.raises(ConvergenceError, match="after 2 iterations"):
        solve_edges(
            rng.normal(size=(40, 39)),
            rng.normal(size=(39, 40)),
            w_x=rng.uniform(size=(40, 39)) ** 8,
            w_y=rng.uniform(size=(39, 40)) ** 8,
            mm_per_px=(1.0, 1.0),
            tolerance=1e-9,
            max_iterations=2,
        )
