"""A sensor of one's own: clicks or dots on a bent raw picture give straight pictures in millimetres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.records.measured import Bytes, Floats
from tactilevision.records.rig import Sensor
from tactilevision.sensors.rectification import (
    find_grid,
    rectify,
    save_rectification,
    sensor_from_corners,
    sensor_from_grid,
)

RAW = (240, 320)
ROWS, COLUMNS, SPACING_MM = 6, 8, 2.5


def bent(x_mm: Floats, y_mm: Floats) -> Floats:
    """Where a place on the gel lies in the raw picture: a keystone and a barrel, other scales along x and y."""
    u, v = x_mm / 8.75 - 1.0, y_mm / 6.25 - 1.0
    swell = 1.0 + 0.05 * (u**2 + v**2)
    return np.stack([160 + 118 * u * swell * (1 + 0.06 * v), 120 + 88 * v * swell], axis=-1)


def dots(*, bright: bool) -> tuple[Bytes, Floats]:
    """A raw picture of the grid, unevenly lit, and where its dots are."""
    x, y = np.meshgrid(SPACING_MM * np.arange(COLUMNS), SPACING_MM * np.arange(ROWS))
    places = bent(x, y)
    row, column = np.indices(RAW, dtype=np.float64)
    picture = 110 + 0.25 * column
    for px, py in places.reshape(-1, 2):
        depth = 1 / (1 + np.exp((np.hypot(column - px, row - py) - 6.0) / 0.7))
        picture = picture * (1 + (0.5 if bright else -0.6) * depth)
    noisy = picture[..., None] + np.random.default_rng(0).normal(0, 1.5, (*RAW, 3))
    return np.clip(noisy, 0, 255).astype(np.uint8), places


@pytest.mark.parametrize("bright", [False, True])
def test_a_seen_grid_straightens_and_scales_each_axis(bright: bool) -> None:
    raw, places = dots(bright=bright)
    found = find_grid(raw, ROWS, columns=COLUMNS)
    assert np.hypot(*np.moveaxis(found - places, 2, 0)).max() < 0.5
    sensor = sensor_from_grid(found, SPACING_MM)
    assert sensor.mm_per_px[0] == pytest.approx(8.75 / 118, rel=0.08)
    assert sensor.mm_per_px[1] == pytest.approx(6.25 / 88, rel=0.08)
    assert rectify(sensor, raw).shape == (sensor.height_px, sensor.width_px, 3)
    assert sensor.rectification is not None
    map_x, map_y = sensor.rectification
    x, y = np.meshgrid(
        *(scale * np.arange(n) for scale, n in zip(sensor.mm_per_px, map_x.shape[::-1], strict=True))
    )
    true = bent(x, y)
    off = np.hypot(map_x - true[..., 0], map_y - true[..., 1])
    assert off.max() < 0.6, "half a pixel, also between the dots"


def test_four_clicks_give_a_scale_to_each_axis() -> None:
    corners = [(20.0, 30.0), (220.0, 30.0), (220.0, 130.0), (20.0, 130.0)]
    sensor = sensor_from_corners(corners, (16.0, 12.0))
    assert sensor.mm_per_px == pytest.approx((0.08, 0.12))
    assert (sensor.width_px, sensor.height_px) == (200, 100)
    assert sensor_from_corners(corners, (16.0, 12.0), mm_per_px=(0.1, 0.1)).width_px == 160
    with pytest.raises(InputError, match="run round"):
        sensor_from_corners([corners[0], corners[2], corners[1], corners[3]], (16.0, 12.0))
    with pytest.raises(InputError, match="four corners"):
        sensor_from_corners(corners[:3], (16.0, 12.0))


def test_a_grid_that_is_not_all_there_is_told() -> None:
    raw, _ = dots(bright=False)
    with pytest.raises(InputError, match=r"no grid of 7 by 9 dots"):
        find_grid(raw, 7, columns=9)
    with pytest.raises(InputError, match="at least 2 by 2"):
        sensor_from_grid(np.zeros((1, 5, 2)), 1.0)


def test_the_maps_are_written_as_a_recording_wants_them(tmp_path: Path) -> None:
    sensor = sensor_from_corners([(2.0, 3.0), (50.0, 3.0), (50.0, 40.0), (2.0, 40.0)], (5.0, 4.0))
    path = save_rectification(sensor, tmp_path / "maps")
    assert sensor.rectification is not None
    with np.load(path, allow_pickle=False) as held:
        assert np.array_equal(held["map_x"], sensor.rectification[0])
        assert np.array_equal(held["map_y"], sensor.rectification[1])
    with pytest.raises(InputError, match="the sensor has no rectification"):
        save_rectification(Sensor("custom", 4, 4, (1.0, 1.0)), tmp_path / "none")
