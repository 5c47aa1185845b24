"""The indenter's circle in drawn height maps whose circle is known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from contact_scenes import Scene, height_map
from each import each

from tactilevision.contact.footprint import find_footprint, fit_circle, relief_mm, shared_ring, unevenness_mm
from tactilevision.records.maps import HeightMap

SCENES: list[dict[str, Any]] = [
    {"depth_mm": 0.1},
    {"depth_mm": 0.6},
    {"depth_mm": 0.1, "plane": (0.01, 0.002, -0.001)},
    {"depth_mm": 0.3, "mm_per_px": (0.03, 0.04), "size_px": (640, 480)},
    {"depth_mm": 0.3, "blur_mm": 0.2},
    {"depth_mm": 0.3, "blur_mm": 0.03},
    {"depth_mm": 0.3, "radius_mm": 1.5},
    {"depth_mm": 0.35, "height_mm": 0.25, "side": "top"},
    {"depth_mm": 0.3, "centre_mm": (12.5, 0.0)},
    {"depth_mm": 0.5, "tilt": (0.02, -0.01)},
]


@each("given", SCENES)
def test_circle_is_found_below_a_pixel(given: dict[str, Any]) -> None:
    scene = Scene(**given)
    face = find_footprint(height_map(scene, np.random.default_rng(1)), scene.indenter())
    assert face is not None
    assert np.hypot(*np.subtract(face.centre_mm, scene.centre_mm)) < 0.03
    assert face.radius_mm == pytest.approx(scene.radius_mm, rel=0.015)
    assert abs(face.radius_mm - scene.radius_mm) < 3 * face.radius_std_mm + 0.005
    assert face.residual_mm < 0.02


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.03, -0.02)])
def test_depth_and_tilt_of_the_face(tilt: tuple[float, float]) -> None:
    scene = Scene(depth_mm=0.4, tilt=tilt, gain=1.0)
    for seed in range(3):
        face = find_footprint(height_map(scene, np.random.default_rng(seed)), scene.indenter())
        assert face is not None
        assert face.depth_mm == pytest.approx(0.4, abs=4 * face.depth_std_mm)
        assert face.depth_std_mm < 0.003
        assert face.tilt == pytest.approx(tilt, abs=4 * face.tilt_std)


def test_nothing_there_is_nothing() -> None:
    scene = Scene(depth_mm=0.0)
    for seed in range(10):
        assert find_footprint(height_map(scene, np.random.default_rng(seed)), scene.indenter()) is None


def test_another_radius_than_the_stated_one_is_measured() -> None:
    scene = Scene(radius_mm=2.0)
    height = height_map(scene, np.random.default_rng(0))
    for stated in (2.5, 1.6, float("nan")):
        face = find_footprint(height, replace(scene.indenter(), radius_mm=stated))
        assert face is not None
        assert face.radius_mm == pytest.approx(2.0, rel=0.01)


def test_a_balls_own_radius_is_not_looked_for() -> None:
    """It touches a circle of 1 mm, whatever its own radius."""
    scene = Scene(radius_mm=1.0)
    height = height_map(scene, np.random.default_rng(0))
    for radius_mm in (4.0, 20.0):
        face = find_footprint(height, replace(scene.indenter(), shape="sphere", radius_mm=radius_mm))
        assert face is not None
        assert face.radius_mm == pytest.approx(1.0, rel=0.02)


def test_a_hole_in_the_map_is_not_read() -> None:
    scene = Scene()
    height = height_map(scene, np.random.default_rng(0))
    valid, depth = height.valid.copy(), np.array(height.depth_mm)
    valid[150:170, 250:270] = False
    depth[~valid] = 9.0
    face = find_footprint(HeightMap(depth, valid, height.mm_per_px), scene.indenter())
    assert face is not None
    assert face.radius_mm == pytest.approx(2.5, rel=0.01)
    assert face.depth_mm == pytest.approx(0.309, abs=0.01)


def test_a_prior_gives_the_same_circle() -> None:
    scene = Scene()
    height = height_map(scene, np.random.default_rng(0))
    first = find_footprint(height, scene.indenter())
    again = find_footprint(height, scene.indenter(), prior=first)
    assert first is not None
    assert again is not None
    assert again.centre_mm == pytest.approx(first.centre_mm, abs=1e-3)


def test_circle_fit_is_exact_on_a_circle_and_deaf_to_a_third_of_strangers() -> None:
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    points = np.c_[1.0 + 2.5 * np.cos(angle), -2.0 + 2.5 * np.sin(angle)]
    exact = fit_circle(points, start=((0.8, -1.7), 2.2), scale_mm=0.03, independent=30)
    assert exact is not None
    assert (*exact.centre_mm, exact.radius_mm) == pytest.approx((1.0, -2.0, 2.5), abs=1e-9)
    points[:30] += rng.uniform(0.3, 2.0, (30, 2))
    robust = fit_circle(points, start=((0.8, -1.7), 2.2), scale_mm=0.03, independent=30)
    assert robust is not None
    assert (*robust.centre_mm, robust.radius_mm) == pytest.approx((1.0, -2.0, 2.5), abs=1e-3)
    assert robust.kept == pytest.approx(2 / 3, abs=0.05)
    assert fit_circle(points[:5], start=((0.8, -1.7), 2.2), scale_mm=0.03, independent=5) is None


@each("arc_rad", [1e-4, 5e-4, 2e-3, 0.2])
def test_a_short_arc_leaves_centre_and_radius_open(arc_rad: float) -> None:
    for seed in range(20):
        angle = np.random.default_rng(seed).uniform(0, arc_rad, 38)
        points = 2.5 * np.c_[np.cos(angle), np.sin(angle)]
        found = fit_circle(points, start=((0.1, 0.0), 2.4), scale_mm=0.02, independent=30)
        assert found is not None
        assert min(found.centre_std_mm, found.radius_std_mm) > min(0.004 / arc_rad**2, 1000.0)


def test_circle_std_covers_what_noise_does() -> None:
    angle = np.linspace(0, 1.2 * np.pi, 80)
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        radius = 2.5 + 0.03 * rng.standard_normal(80)
        points = np.c_[radius * np.cos(angle), radius * np.sin(angle)]
        found = fit_circle(points, start=((0.0, 0.0), 2.5), scale_mm=0.03, independent=80)
        assert found is not None
        errors.append([(found.radius_mm - 2.5) / found.radius_std_mm])
    assert 0.7 < np.std(errors) < 1.4


@pytest.mark.parametrize("turn", [0.3, 2.5])
def test_a_chip_is_no_tilt(turn: float) -> None:
    tilted = Scene(depth_mm=0.4, tilt=(0.03, -0.02))
    height = height_map(tilted, np.random.default_rng(3))
    face = find_footprint(height, tilted.indenter())
    assert face is not None
    assert relief_mm(height, face) < 0.01 * face.depth_mm, "a lean is none"
    rows, columns = height.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2)[None, :] * height.mm_per_px[0] - face.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2)[:, None] * height.mm_per_px[1] - face.centre_mm[1]
    sector = (np.abs(np.angle(np.exp(1j * (np.arctan2(y, x) - turn)))) < np.pi / 8) & (np.hypot(x, y) > 0.6)
    broken = sector & (np.hypot(x, y) < face.radius_mm)
    chipped = replace(height, depth_mm=np.where(broken, 0.5 * height.depth_mm, height.depth_mm))
    found = find_footprint(chipped, tilted.indenter())
    assert found is not None
    assert relief_mm(chipped, found) > 0.05 * found.depth_mm


def test_what_other_punches_show_on_the_same_sides_is_light_and_a_crumb_is_not() -> None:
    """Three shadows at fixed azimuths, deeper presses darker; one press has a crumb of 30 um on one side."""
    azimuth = 2 * np.pi * np.arange(180) / 180
    rng = np.random.default_rng(1)
    shadows = sum(np.exp(-((np.angle(np.exp(1j * (azimuth - at))) / 0.5) ** 2)) for at in (0.4, 2.9, 4.6))
    shadows = shadows - shadows.mean()
    others = [size * shadows + 0.001 * rng.standard_normal(180) for size in (-0.004, 0.008, 0.02, 0.022, 0.03)]
    light = shared_ring(others)
    plain = 0.04 * shadows + 0.001 * rng.standard_normal(180)
    crumb = plain + 0.03 * (np.abs(azimuth - 1.6) < 0.4)
    assert unevenness_mm(plain, np.zeros(180)) > 0.012
    assert unevenness_mm(plain, light) < 0.003
    assert unevenness_mm(crumb, light) > 0.008
    hidden = np.where(np.abs(azimuth - 3) < 0.7, np.nan, plain)
    assert unevenness_mm(hidden, light) < 0.004
    assert np.isnan(unevenness_mm(np.full(180, np.nan), light))
    assert not shared_ring(others[:2]).any()
