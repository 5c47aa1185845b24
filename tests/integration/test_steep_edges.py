"""Walls of flat faces: the hidden step found from what can be read beside it, other shapes left alone."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import pytest
from each import each

from tactilevision.heightmap.circular_edges import find_circular_edges
from tactilevision.heightmap.poisson import integrate
from tactilevision.heightmap.walls import PunchEdge, WallLaw, fit_edges, restore, restore_windows
from tactilevision.mechanics.profile import PunchCase, seen_profile
from tactilevision.mechanics.tables.punch import TABULATED
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Floats

STEP = 0.06
FINER = 3
SHAPE = (200, 240)
LIMIT = 0.5


def find_punch_edges(slopes: SlopeMap, mm_per_px: tuple[float, float], *, law: WallLaw) -> list[PunchEdge]:
    return fit_edges(find_circular_edges(slopes, mm_per_px, limit=law.limit), law, px=min(mm_per_px))


def places(finer: int = 1, centre: tuple[float, float] = (7.3, 5.9)) -> tuple[Floats, Floats]:
    """Places (H, W) from the axis, mm; each pixel divided `finer` times along either axis."""
    y, x = np.mgrid[: SHAPE[0] * finer, : SHAPE[1] * finer] * (STEP / finer) - 0.5 * STEP * (1 - 1 / finer)
    return x - centre[0], y - centre[1]


LAMPS = 2.1 * np.array([[np.cos(t), np.sin(t)] for t in 2 * np.pi * np.arange(16) / 16])  # leans, all round
STEEP = np.linspace(0.0, 4.0, 401)


def lit(p: Floats, q: Floats) -> Floats:
    """Light (3, ...): what lamps all round give together, and to either side; none where a surface turns away."""
    up = 1.0 / np.sqrt(1.0 + p * p + q * q)
    light = np.zeros((3, *p.shape))
    for x, y in LAMPS:
        one = np.maximum(up * (1.0 - x * p - y * q), 0.0)
        for plane, share in zip(light, (1.0, -2.0 / 2.1**2 * x, -2.0 / 2.1**2 * y), strict=True):
            plane += share / len(LAMPS) * one
    return light


def photographed(depth: Floats, blur_px: float = 0.7, top: float = 0.8) -> SlopeMap:
    """Slopes as a picture shows them: light blurred, averaged over a pixel, and read by what even slopes show.

    `top` is read at most.
    """
    q, p = (np.asarray(one) for one in np.gradient(depth, STEP / FINER))
    light = [cv2.GaussianBlur(v, (0, 0), blur_px * FINER) for v in lit(p, q)]
    up, p, q = (cv2.resize(v, SHAPE[::-1], interpolation=cv2.INTER_AREA) for v in light)
    known, shown = lit(STEEP, 0.0 * STEEP)[:2]
    size = np.hypot(p, q)
    turned = np.interp(size / up, np.maximum.accumulate(shown / known), STEEP) / np.maximum(size, 1e-9)
    p, q = turned * p, turned * q
    held = np.minimum(1.0, top / np.maximum(np.hypot(p, q), 1e-9))
    return SlopeMap((p * held).astype(np.float32), (q * held).astype(np.float32))


@lru_cache
def punch(
    w: float,
    nu: float = 0.47,
    friction: float = 0.3,
    *,
    tilt: tuple[float, float] = (0.0, 0.0),
    centre: tuple[float, float] = (7.3, 5.9),
) -> Floats:
    """A punch of 2 mm on gel of 2.5 mm by finite elements, its edge rounded by the ink, on the finer grid."""
    x, y = places(FINER, centre)
    r = np.hypot(x, y)
    face = w + (tilt[0] * x + tilt[1] * y) * np.minimum(1.0, 2.0 / np.maximum(r, 1e-9))
    unit = -seen_profile(r / 2.0, PunchCase(nu, 0.8, w / 2.5, friction), source=TABULATED.source)
    return np.asarray(face * cv2.GaussianBlur(unit, (0, 0), 0.02 * FINER / STEP))


def face_over_gel(slopes: SlopeMap, centre: tuple[float, float] = (7.3, 5.9)) -> float:
    """Depth of the face over the gel 2.6 to 3 mm from the axis."""
    surface = integrate(slopes, (STEP, STEP))
    r = np.hypot(*places(1, centre))
    return float(surface[r < 1.5].mean() - surface[(r > 2.6) & (r < 3.0)].mean())


def true_over_gel(depth: Floats, centre: tuple[float, float] = (7.3, 5.9)) -> float:
    r = np.hypot(*places(FINER, centre))
    return float(depth[r < 1.5].mean() - depth[(r > 2.6) & (r < 3.0)].mean())


@each("w, nu, friction", [(0.3, 0.43, 0.6), (0.4, 0.47, 0.3), (0.4, 0.43, 0.15), (0.5, 0.487, 0.3)])
@each("blur_px", [0.5, 1.0])
def test_the_hidden_step_is_found(w: float, nu: float, friction: float, blur_px: float) -> None:
    depth = punch(w, nu, friction)
    slopes = photographed(depth, blur_px)
    true, plain = true_over_gel(depth), face_over_gel(slopes)
    walls = find_punch_edges(slopes, (STEP, STEP), law=WallLaw(LIMIT))
    restore(slopes, walls, mm_per_px=(STEP, STEP))
    found = face_over_gel(slopes)
    assert len(walls) == 1
    assert walls[0].radius_mm == pytest.approx(2.0, abs=0.03)
    assert abs(found - true) < 0.06 * true  # friction .15 under wide blur; the others within 4 %
    assert abs(found - true) < 2 * walls[0].std_mm
    assert abs(found - true) < 0.35 * abs(plain - true)


@pytest.mark.parametrize("share", [-0.3, 0.4])
def test_a_taught_wall_carries_the_depth_that_it_was_taught(share: float) -> None:
    walls = TaughtWalls(share, 0.0, (0.0, 0.0, 0.0), (0.2, 0.9), 0.01)
    slopes = photographed(punch(0.6))
    as_read, usual, taught = (SlopeMap(*np.array([slopes.dz_dx, slopes.dz_dy])) for _ in range(3))
    (before,) = find_punch_edges(as_read, (STEP, STEP), law=WallLaw(LIMIT))
    (after,) = find_punch_edges(as_read, (STEP, STEP), law=WallLaw(LIMIT, taught=walls))
    restore(usual, [before], mm_per_px=(STEP, STEP))
    restore(taught, [after], mm_per_px=(STEP, STEP))
    assert before.missing_mm > 0.02
    assert after.missing_mm == pytest.approx((1 + share) * before.missing_mm)
    change = face_over_gel(taught) - face_over_gel(usual)
    assert change == pytest.approx(share * before.missing_mm, rel=0.1)
    assert after.std_mm == pytest.approx(0.01 * before.depth_mm) != before.std_mm


@lru_cache
def found_edge() -> PunchEdge:
    (edge,) = find_punch_edges(photographed(punch(0.6)), (STEP, STEP), law=WallLaw(LIMIT))
    return edge


@each("change_mm", [-0.15, -0.04, -0.005, 0.005, 0.04, 0.15])
def test_a_change_of_depth_lies_where_the_wall_is_steepest(change_mm: float) -> None:
    edge = found_edge()
    part, s = edge.carried(change_mm), edge.places_mm
    steep, new = (np.diff(fall) / (s[1] - s[0]) for fall in (edge.fall_mm, edge.fall_mm + change_mm * (1 - part)))
    assert part[s < -0.15] == pytest.approx(1.0, abs=0.02 + abs(change_mm))
    assert part[s >= edge.reach_mm] == pytest.approx(0.0, abs=1e-9)
    assert new.min() > min(steep.min(), 0.0) - 1e-9, "no wall overhangs"
    if abs(change_mm) < 0.1:
        assert np.all(part[s > 0.1] < 0.02)
        gentle = steep < 0.5 * steep.max()
        assert new[gentle] == pytest.approx(steep[gentle])


def test_a_tilted_face_keeps_its_tilt() -> None:
    depth = punch(0.6, tilt=(0.02, -0.01))
    slopes = photographed(depth)
    restore(slopes, find_punch_edges(slopes, (STEP, STEP), law=WallLaw(LIMIT)), mm_per_px=(STEP, STEP))
    surface = integrate(slopes, (STEP, STEP))
    x, y = places()
    face = np.hypot(x, y) < 1.5
    terms = np.stack([np.ones(face.sum()), x[face], y[face]], axis=1)
    plane = np.linalg.lstsq(terms, surface[face], rcond=None)[0]
    assert plane[1:] == pytest.approx([0.02, -0.01], abs=0.003)


def test_a_face_cut_by_the_border_is_restored_too() -> None:
    centre = (0.9, 5.9)
    depth = punch(0.6, centre=centre)
    slopes = photographed(depth)
    walls = find_punch_edges(slopes, (STEP, STEP), law=WallLaw(LIMIT))
    restore(slopes, walls, mm_per_px=(STEP, STEP))
    assert len(walls) == 1
    assert face_over_gel(slopes, centre) == pytest.approx(true_over_gel(depth, centre), rel=0.05)


def test_a_wall_is_restored_in_the_window_that_holds_it() -> None:
    slopes, whole = (photographed(punch(0.6)) for _ in range(2))
    walls = find_punch_edges(whole, (STEP, STEP), law=WallLaw(LIMIT))
    restore(whole, walls, mm_per_px=(STEP, STEP))
    windows = [(slice(30, 170), slice(52, 194)), (slice(0, 20), slice(0, 20))]
    fine = [np.stack([slopes.dz_dx[window], slopes.dz_dy[window]]) for window in windows]
    found = restore_windows(
        fine, windows, valid=np.ones(SHAPE, np.bool_), mm_per_px=(STEP, STEP), law=WallLaw(LIMIT)
    )
    assert len(found) == len(walls) == 1
    assert found[0].centre_mm == pytest.approx(walls[0].centre_mm, abs=0.1 * STEP)
    assert found[0].radius_mm == pytest.approx(walls[0].radius_mm, abs=0.1 * STEP)
    for mine, all_of_it in zip(fine[0], (whole.dz_dx, whole.dz_dy), strict=True):
        assert np.sqrt(np.mean((mine - all_of_it[windows[0]]) ** 2)) < 0.02


def test_what_has_no_sharp_round_edge_is_left_alone() -> None:
    x, y = places(FINER)
    ball = np.sqrt(np.maximum(4.0 - x**2 - y**2, 0.3)) - np.sqrt(0.3)
    cone = np.maximum(1.2 - 0.7 * np.hypot(x, y), 0.0)
    ridge = np.maximum(0.6 - 0.7 * np.abs(x + 0.4 * y), 0.0)
    noise = np.random.default_rng(1).normal(0, 0.02, x.shape)
    for depth in (ball, cone, ridge, noise):
        assert find_punch_edges(photographed(np.asarray(depth)), (STEP, STEP), law=WallLaw(LIMIT)) == []


def test_gentle_slopes_cost_nothing() -> None:
    slopes = photographed(punch(0.1))
    before = slopes.dz_dx.copy()
    assert find_circular_edges(slopes, (STEP, STEP), limit=LIMIT) == []
    restore(slopes, [], mm_per_px=(STEP, STEP))
    assert np.array_equal(slopes.dz_dx, before)


@pytest.mark.parametrize(("limit", "w"), [(0.3, 0.6), (0.22, 0.5)])
def test_a_wall_that_hides_more_than_a_fifth_of_the_radius_is_carried_through(limit: float, w: float) -> None:
    """As after a calibration on gentle balls: slopes beyond `limit` are unread .4 mm and more beside the edge."""
    depth = punch(w)
    read = photographed(depth, top=limit / 0.8)
    beside = np.hypot(*places()) - 2.0
    unread = beside[np.hypot(read.dz_dx, read.dz_dy) > limit]
    assert unread.max() > 0.4
    short = face_over_gel(read)
    restore(read, find_punch_edges(read, (STEP, STEP), law=WallLaw(limit)), mm_per_px=(STEP, STEP))
    truth = true_over_gel(depth)
    assert short < 0.75 * truth
    assert face_over_gel(read) == pytest.approx(truth, rel=0.05)


def shaded(inner_mm: float, outer_mm: float, *, slope: float, w: float = 0.6) -> SlopeMap:
    """A face as photographed, whose gel between these radii is read with this slope outwards."""
    read = photographed(punch(w))
    x, y = places()
    r = np.hypot(x, y)
    dark = (r > inner_mm) & (r < outer_mm)
    for plane, way in ((read.dz_dx, x), (read.dz_dy, y)):
        plane[dark] = (slope * way / r)[dark]
    return read


def test_a_wall_beside_a_cast_shadow_is_left_as_it_is() -> None:
    """A shadow looks like a slope of .42 that ends at once, where gel falls away by less and less."""
    read = shaded(2.3, 2.9, slope=-0.42, w=0.3)
    assert find_punch_edges(read, (STEP, STEP), law=WallLaw(LIMIT)) == []


@pytest.mark.parametrize("false_slope", [-1.2, 0.4, 0.8])
def test_a_wall_takes_no_depth_away(false_slope: float) -> None:
    """Near a shadow gel read too steep makes a law of too small a fall."""
    read = shaded(2.05, 2.4, slope=false_slope)
    plain = face_over_gel(read)
    walls = find_punch_edges(read, (STEP, STEP), law=WallLaw(LIMIT))
    assert all(wall.missing_mm == 0.0 for wall in walls)
    restore(read, walls, mm_per_px=(STEP, STEP))
    assert face_over_gel(read) == pytest.approx(plain, rel=0.02)
