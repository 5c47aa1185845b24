"""The simulated camera: what it does to light, and whether it looks like a real GelSlim."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tactilevision.records.measured import Floats
from tactilevision.synthetic.camera import Camera, CameraOptions, build_camera, distortion
from tactilevision.synthetic.gel import Flat, Grid, Prescribed
from tactilevision.synthetic.lights import Finish, gelslim_lights, random_lights, reflect

REAL = Path(__file__).parents[3] / "shared" / "real" / "gelslim3_mcubelab"


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


@pytest.fixture(scope="module")
def camera() -> Camera:
    return build_camera(CameraOptions(), rng())


def test_walls_facing_a_light_are_bright_and_walls_turned_away_go_dark() -> None:
    axis = np.linspace(-1, 1, 5)
    pad = Grid(axis, axis)
    left = gelslim_lights()[1]  # green, from the left
    lamp = (left.shine(pad, reference=pad),)
    flat, towards, away = (
        float(
            reflect(
                lamp,
                np.ones(1),
                slopes=(np.full((5, 5), p, np.float32), np.zeros((5, 5), np.float32)),
                finish=Finish(),
            )[2, 2, 1]
        )
        for p in (0.0, 0.5, -3.0)
    )
    assert towards > 1.1 * flat  # the gel comes towards the camera as x grows: it faces left
    assert 0 <= away < 0.15 * flat


def test_lens_maps_are_each_other_s_inverse_and_keep_the_border() -> None:
    to_rectified, to_raw = distortion(CameraOptions(distortion_px=9.0))
    columns = np.arange(427, dtype=np.float32)
    back = cv2.remap(to_raw[0], *to_rectified, cv2.INTER_LINEAR)
    np.testing.assert_allclose(back, np.broadcast_to(columns, back.shape), atol=0.05)
    assert np.abs(to_rectified[0] - columns).max() > 5
    np.testing.assert_allclose(to_rectified[0][:, [0, -1]], np.tile([0, 426], (320, 1)), atol=1e-6)


def test_rectified_frame_shows_the_surface_where_it_is(camera: Camera) -> None:
    pad = camera.grid
    x, y = pad.places((4.0, -3.0))
    bump = Prescribed(0.4 * np.exp(-(x**2 + y**2).astype(np.float64) / 0.5), pad)
    change = np.abs(camera.ideal(bump) - camera.ideal(Flat())).sum(axis=2)
    to_rectified, _ = distortion(CameraOptions())
    straight = cv2.remap(change, *to_rectified, cv2.INTER_LINEAR)
    weight = straight * (straight > 0.2 * straight.max())
    found = float((weight * x).sum() / weight.sum()), float((weight * y).sum() / weight.sum())
    assert found == pytest.approx((0.0, 0.0), abs=0.3)


def test_noise_is_that_of_shots_and_reading_and_averages_out(camera: Camera) -> None:
    light = camera.ideal(Flat())
    generator = rng()
    frames = np.stack([camera.expose(light, generator)[100:200, 150:250] for _ in range(12)]).astype(float)
    noise = frames.std(axis=0, ddof=1).mean(axis=(0, 1))
    assert (noise > 0.5).all()
    assert (noise < 2.0).all()
    means = np.stack([camera.expose(light, generator, averaged=16)[100:200, 150:250] for _ in range(12)]).astype(
        float
    )
    assert (means.std(axis=0, ddof=1).mean(axis=(0, 1)) < 0.6 * noise).all()


def test_lamps_drift_slowly_from_what_the_reference_shows(camera: Camera) -> None:
    start, later = camera.ideal(Flat(), 0.0), camera.ideal(Flat(), 120.0)
    change = (later / np.maximum(start, 0.05) - 1)[start > 0.1]
    assert 1e-4 < np.abs(change).max() < 0.02


def test_seeds_draw_lights_from_every_side() -> None:
    drawn = [random_lights(np.random.default_rng(seed)) for seed in range(40)]
    places = np.array([[light.position_mm[:2] for light in lights] for lights in drawn])
    angles = np.arctan2(places[:, 0, 1], places[:, 0, 0])
    assert np.abs(np.exp(1j * angles).mean()) < 0.4
    assert len({tuple(int(np.argmax(light.colour)) for light in lights) for lights in drawn}) == 6


def blocks(rgb: Floats) -> Floats:
    return np.asarray(cv2.resize(rgb.astype(np.float64), (7, 5), interpolation=cv2.INTER_AREA))


@pytest.mark.skipif(not REAL.exists(), reason="the real frames are not here")
def test_flat_gel_looks_like_gelslim() -> None:
    frame = cv2.imread(str(REAL / "markerless" / "ref.jpg"))
    assert frame is not None
    maps = np.load(REAL / "abe_corr.npz")
    real = blocks(frame[..., ::-1][maps["x"], maps["y"]])
    to_rectified, _ = distortion(CameraOptions())
    camera = build_camera(CameraOptions(), rng())
    ours = blocks(cv2.remap(camera.picture(Flat(), rng()), *to_rectified, cv2.INTER_LINEAR))
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), real.mean(axis=(0, 1)), atol=12)
    assert np.abs(ours - real).mean() < 16
    for channel in range(3):
        assert np.corrcoef(ours[..., channel].ravel(), real[..., channel].ravel())[0, 1] > 0.9
