"""What the rendered pictures are made of, without the renderer."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.rendered.camera import RenderedCamera, build_camera
from benchmarks.rendered.families import Rig, draw_rig
from benchmarks.rendered.mesh import height_field
from benchmarks.rendered.path_tracer import PathTracer
from tactilevision.synthetic.gel import Area, Flat, Grid, Prescribed, Singles, Surface
from tactilevision.synthetic.punch import Bevel, PunchPress, PunchProfile

RIG = replace(draw_rig("train", 1), width_px=60, height_px=40, mm_per_px=0.2)


@dataclass(frozen=True, eq=False)
class Drawn(PathTracer):
    """A stand-in for the path tracer: each lamp's light is 1 + depth squared; it counts what it draws."""

    drawn: list[float] = field(default_factory=list)

    def lamps(self, surface: Surface) -> Singles:
        """Light (H, W, 3)."""
        depth = surface.depth_mm(self.grid)
        self.drawn.append(float(depth.max()))
        return np.repeat(1 + depth[..., None] ** 2, 3, axis=-1)


def press(face_mm: float) -> PunchPress:
    """A punch whose gel sinks and rises with a made-up shape, and its bevel."""
    radii = np.linspace(0.0, 15.0, 301)
    depth = np.where(radii < 2.5, 1.0, -0.1 * np.exp(-(radii - 2.5)))
    shape = np.tile(depth, (2, 1))
    profile = PunchProfile(2.5, 3.0, radii, np.array([0.1, 0.6]), shape, 0 * shape, np.array([18.0, 20.0]))
    return PunchPress(profile, face_mm, (0.0, 0.0), bevel=Bevel("right", 5.0, 0.3, 10.0, 2.5))


def camera_of(rig: Rig) -> RenderedCamera:
    grid = build_camera(rig, Path()).grid
    return RenderedCamera(rig, Drawn(rig, grid, Path()))


def test_families_share_no_draw_and_both_cover_their_ranges() -> None:
    elevations: dict[str, list[float]] = {"train": [], "bench": []}
    for family in ("train", "bench"):
        for seed in range(120):
            for lamp in draw_rig(family, seed).lamps:
                x, y, z = lamp.centre_mm
                elevations[family].append(float(np.rad2deg(np.arctan2(z, np.hypot(x, y)))))
    for values in elevations.values():
        assert 15.0 <= min(values) < 17.5
        assert 32.5 < max(values) <= 35.0
    teeth = {family: {int((v - 15) / 20 * 16) for v in values} for family, values in elevations.items()}
    assert not teeth["train"] & teeth["bench"]


def test_green_gives_blue_up_to_seven_tenths() -> None:
    shares = []
    for seed in range(60):
        green = next(lamp for lamp in draw_rig("train", seed).lamps if lamp.colour[1] == 1.0)
        shares.append(green.colour[2])
    assert max(shares) <= 0.7
    assert min(shares) >= 0.2
    assert max(shares) > 0.6


def test_the_mesh_lies_on_the_surface_and_is_dense_where_it_is_steep() -> None:
    axis = np.linspace(-3.0, 3.0, 61)
    grid = Grid(axis, axis)
    x, y = grid.places()
    hill = Prescribed(np.asarray(0.3 * x + 0.1 * y, np.float64), grid, steep=(Area((0.0, 0.0), (1.0, 1.0)),))
    mesh = height_field(hill, grid)
    inside = (np.abs(mesh.x_mm) < 0.9).nonzero()[0]
    assert np.diff(mesh.x_mm[inside]).max() == pytest.approx(0.1 / 3)
    assert np.diff(mesh.x_mm).max() == pytest.approx(0.2)
    middle = np.flatnonzero((np.abs(mesh.vertices()[:, 0]) < 0.5) & (np.abs(mesh.vertices()[:, 1]) < 0.5))
    vertices, normals = mesh.vertices()[middle], mesh.normals()[middle]
    np.testing.assert_allclose(vertices[:, 2], 0.3 * vertices[:, 0] - 0.1 * vertices[:, 1], atol=1e-5)
    expected = np.array([-0.3, 0.1, 1.0]) / np.sqrt(1.1)
    np.testing.assert_allclose(normals, np.broadcast_to(expected, normals.shape), atol=1e-4)
    corners = mesh.vertices()[mesh.faces()[0]]
    assert np.cross(corners[1] - corners[0], corners[2] - corners[0])[2] > 0  # its front faces the camera


def test_light_between_two_rendered_depths_is_linear_and_exact_at_each() -> None:
    camera = camera_of(RIG)
    tracer = camera.tracer
    assert isinstance(tracer, Drawn)
    touch = press(0.1).bevel.touch_depth_mm(press(0.1).profile)  # type: ignore[union-attr]
    at = camera._lamps(press(touch))
    np.testing.assert_allclose(at, tracer.lamps(press(touch)), atol=1e-6)
    low, high = (camera._lamps(press(touch * part)) for part in (0.5, 0.75))
    between = camera._lamps(press(touch * 0.625))
    np.testing.assert_allclose(between, (low + high) / 2, atol=1e-5)
    assert len(set(tracer.drawn)) <= 5


def test_a_still_gel_and_one_in_the_air_give_the_free_picture() -> None:
    camera = camera_of(RIG)
    np.testing.assert_array_equal(camera.ideal(press(-0.1)), camera.ideal(Flat()))


def test_noise_averages_out_and_the_response_spans_the_grey_levels() -> None:
    camera = camera_of(RIG)
    light = np.linspace(0, 1, 300, dtype=np.float32).reshape(10, 10, 3)
    greys = camera.expose(light, None)
    assert greys.min() == 0
    assert greys.max() == 255
    assert (np.diff(greys.ravel().astype(int)) >= 0).all()
    half = np.full((200, 200, 3), 0.4, np.float32)
    one, many = (camera.expose(half, np.random.default_rng(1), averaged=n).astype(float).std() for n in (1, 16))
    assert many < 0.5 * one


def test_the_same_seed_gives_the_same_rig() -> None:
    assert draw_rig("bench", 7) == draw_rig("bench", 7)
    assert draw_rig("bench", 7) != draw_rig("train", 7)
