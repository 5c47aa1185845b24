"""The zero plane: found on untouched gel alone, past the rise beside a contact."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.heightmap.zero_plane import find_zero_plane, level
from tactilevision.records.measured import Bools, Floats
from tactilevision.synthetic.gel import BallPress, Grid

SHAPE, STEP = (160, 240), 0.1


def scene(rise_mm: float = 0.04) -> tuple[Floats, Bools]:
    """Depth of a tilted punch with the gel's rise beside it, and the blocks (10 px) it leaves untouched."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] * STEP
    r = np.hypot(x - 12.0, y - 8.0)
    depth = np.where(r < 2.0, 0.4 + 0.02 * (x - 12.0), -rise_mm * np.exp(-(r - 2.0) / 2.25))
    centres = np.hypot(x - 12.0, y - 8.0)[5::10, 5::10]
    return depth, centres > 2.6


def test_an_added_plane_is_taken_off_and_the_punch_keeps_its_tilt() -> None:
    depth, untouched = scene()
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] * STEP
    tilted = depth + 0.3 + 0.01 * x - 0.02 * y
    zero = find_zero_plane(tilted, untouched, mm_per_px=(STEP, STEP), thickness_mm=3.0)
    level(tilted, zero)
    assert np.abs(tilted - depth).max() < 1.5e-3
    face = depth > 0.3
    assert np.polyfit(x[face], tilted[face], 1)[0] == pytest.approx(0.02, abs=2e-4)


@each("thickness_mm", [None, 2.0, 3.0, 4.5])
def test_the_rise_beside_a_contact_is_not_taken_for_zero(thickness_mm: float | None) -> None:
    depth, untouched = scene()
    zero = find_zero_plane(depth, untouched, mm_per_px=(STEP, STEP), thickness_mm=thickness_mm)
    assert abs(zero.offset_mm) < 2.5e-3
    plain = float(np.mean(depth[::10, ::10][untouched]))
    assert abs(zero.offset_mm) < 0.4 * abs(plain)


@pytest.mark.parametrize("radius_mm", [7.0, 9.0])
def test_gel_too_dark_to_be_read_is_no_contact(radius_mm: float) -> None:
    """Dark all round: at 7 mm what can be read reaches no border of the picture, at 9 mm two of them."""
    depth, untouched = scene()
    x, y = (np.arange(5, count, 10) * STEP for count in SHAPE[::-1])
    trusted = np.hypot(x[None, :] - 12.0, y[:, None] - 8.0) < radius_mm
    depth += np.where(np.kron(trusted, np.ones((10, 10))) > 0, 0.0, 0.03)
    zero = find_zero_plane(depth, untouched, mm_per_px=(STEP, STEP), thickness_mm=3.0, trusted=trusted)
    assert abs(zero.offset_mm) < 2.5e-3
    taken_for_contact = find_zero_plane(depth, untouched & trusted, mm_per_px=(STEP, STEP), thickness_mm=3.0)
    assert abs(taken_for_contact.offset_mm) > 3 * abs(zero.offset_mm)


def test_a_speck_that_is_no_dent_moves_nothing() -> None:
    """Waves of untouched gel, and a block that stands out in colour alone: no gel rises beside it."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] * STEP
    waves = 0.02 * np.sin(x / 2.0) * np.cos(y / 1.5)
    untouched = np.ones((16, 24), np.bool_)
    plain = find_zero_plane(waves, untouched, mm_per_px=(STEP, STEP), thickness_mm=3.0)
    untouched[7, 9] = False
    speck = find_zero_plane(waves, untouched, mm_per_px=(STEP, STEP), thickness_mm=3.0)
    assert speck.offset_mm == pytest.approx(plain.offset_mm, abs=2e-4)
    assert speck.std_mm == pytest.approx(plain.std_mm, rel=0.05)


def test_without_contact_it_is_the_plane() -> None:
    x = np.arange(SHAPE[1])[None, :] * STEP
    depth = np.repeat(0.1 - 0.01 * x, SHAPE[0], axis=0)
    zero = find_zero_plane(depth, np.ones((16, 24), np.bool_), mm_per_px=(STEP, STEP))
    level(depth, zero)
    assert np.abs(depth).max() < 1e-8


def test_its_uncertainty_covers_its_error() -> None:
    rng = np.random.default_rng(0)
    misses = []
    for _ in range(60):
        coarse = rng.normal(0.0, 0.004, (4, 6))
        wave = np.kron(coarse, np.ones((40, 40)))
        zero = find_zero_plane(wave, np.ones((16, 24), np.bool_), mm_per_px=(STEP, STEP))
        misses.append(zero.offset_mm / zero.std_mm)
    assert 0.4 < np.std(misses) < 1.6


def test_with_nothing_untouched_it_says_so_by_its_uncertainty() -> None:
    depth, untouched = scene()
    zero = find_zero_plane(depth, np.zeros_like(untouched), mm_per_px=(STEP, STEP))
    assert zero.share == 0.0
    assert zero.std_mm == pytest.approx(float(np.std(depth)), rel=0.2)


def test_a_flat_face_is_not_taken_for_untouched_gel() -> None:
    depth, untouched = scene()
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] * STEP
    face = (np.hypot(x - 12.0, y - 8.0) < 1.6)[5::10, 5::10]
    with_face = find_zero_plane(depth, untouched | face, mm_per_px=(STEP, STEP), thickness_mm=3.0)
    without = find_zero_plane(depth, untouched, mm_per_px=(STEP, STEP), thickness_mm=3.0)
    assert with_face.offset_mm == pytest.approx(without.offset_mm, abs=1e-9)


@pytest.mark.parametrize(("poisson_ratio", "told_mm"), [(0.45, 2.5), (0.49, 2.5), (0.48, None)])
def test_the_wide_rise_beside_a_large_ball_is_not_taken_for_zero(
    poisson_ratio: float, told_mm: float | None
) -> None:
    """Layer theory's surface round a contact over half of the picture's height; the rise there is .1 mm."""
    contact_mm, thickness_mm, centre = 5.7, told_mm or 3.5, (1.0, -0.5)
    grid = Grid(np.arange(-13.5, 13.6, STEP), np.arange(-10.0, 10.1, STEP))
    depth = BallPress(20.0, contact_mm, thickness_mm, poisson_ratio, centre).depth_mm(grid)
    untouched = grid.distance(centre)[5::10, 5::10] > contact_mm + 0.6
    zero = find_zero_plane(depth, untouched, mm_per_px=(STEP, STEP), thickness_mm=told_mm)
    assert float(depth.min()) < -0.06
    assert abs(zero.offset_mm) < 0.003, "with the decay held at .75 h: .006, .013, .018"
    assert abs(zero.offset_mm) < 2.0 * zero.std_mm


@pytest.mark.parametrize("share", [0.3, 0.6, 0.8])
def test_a_face_that_covers_most_of_the_picture_is_not_taken_for_the_gel(share: float) -> None:
    edge = (1.0 - share) * SHAPE[1] * STEP
    x = np.repeat(np.arange(SHAPE[1])[None, :] * STEP, SHAPE[0], axis=0)
    depth = np.where(x > edge, 0.3, -0.03 * np.exp(-(edge - x) / 2.7))
    untouched = np.abs(x - edge)[5::10, 5::10] > 0.6
    zero = find_zero_plane(depth, untouched, mm_per_px=(STEP, STEP), thickness_mm=3.0)
    level(depth, zero)
    assert abs(float(depth[x > edge].mean()) - 0.3) < 0.02
