"""The catalogue of sensors, and raw pictures made straight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.photometric.methods.network import find_model
from tactilevision.records.measured import Bytes, Picture
from tactilevision.records.rig import Sensor
from tactilevision.sensors import SENSORS, deepest_mm, get_sensor
from tactilevision.sensors.rectification import rectify, sensor_from_corners, sensor_from_grid


def ramp(height: int = 60, width: int = 80) -> Bytes:
    """A picture whose red is its column and whose green is its row."""
    y, x = np.mgrid[:height, :width]
    return np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.uint8)


@each("kind", sorted(SENSORS))
def test_every_sensor_is_called_by_its_name_and_has_a_size(kind: str) -> None:
    sensor = get_sensor(kind)
    assert sensor.kind == kind
    assert min(sensor.width_px, sensor.height_px) > 100
    assert all(0.01 < step < 0.2 for step in sensor.mm_per_px)


def test_fields_can_be_replaced() -> None:
    sensor = get_sensor("gelslim3", mm_per_px=0.06, serial="07")
    assert sensor.mm_per_px == (0.06, 0.06)
    assert sensor.serial == "07"
    assert get_sensor("custom", width_px=5, height_px=4, mm_per_px=(0.1, 0.2)).mm_per_px == (0.1, 0.2)


def test_mistakes_are_named() -> None:
    with pytest.raises(InputError, match=r"no sensor of that name.*gelslim3"):
        get_sensor("gelslim9")
    with pytest.raises(InputError, match=r"custom sensor needs height_px, mm_per_px"):
        get_sensor("custom", width_px=5)
    with pytest.raises(InputError, match="no such field"):
        get_sensor("digit", colour="red")
    with pytest.raises(InputError, match=r"mm_per_px must lie between 0\.0001 and 100"):
        get_sensor("digit", mm_per_px=-1.0)


def test_without_maps_a_picture_is_itself_if_its_size_fits() -> None:
    sensor = get_sensor("custom", width_px=80, height_px=60, mm_per_px=0.1)
    picture = ramp()
    assert rectify(sensor, picture) is picture
    with pytest.raises(InputError, match="40 by 60 px"):
        rectify(sensor, np.ascontiguousarray(picture[:, :40]))


def with_maps(maps: tuple[np.ndarray, np.ndarray]) -> Sensor:
    height, width = maps[0].shape
    return get_sensor("custom", width_px=width, height_px=height, mm_per_px=0.1, rectification=maps)


def maps_of(sensor: Sensor) -> tuple[Picture, Picture]:
    assert sensor.rectification is not None
    return sensor.rectification


def test_a_table_of_rows_and_columns_is_followed() -> None:
    row, column = np.mgrid[10:50, 20:70]
    straight = rectify(with_maps((column.astype(np.float32), row.astype(np.float32))), ramp())
    assert np.array_equal(straight, ramp()[10:50, 20:70])
    with pytest.raises(InputError, match="reaches outside"):
        rectify(with_maps((column.astype(np.float32), row.astype(np.float32))), ramp(30, 80))


def test_four_corners_span_the_picture() -> None:
    corners = [(10.0, 5.0), (70.0, 8.0), (66.0, 50.0), (14.0, 46.0)]
    map_x, map_y = maps_of(sensor_from_corners(corners, (6.0, 4.0), mm_per_px=(0.1, 0.1)))
    assert map_x.shape == (40, 60)
    half = 0.02  # the outermost pixels' centres lie half a pixel inside the corners
    for (row, column), corner in zip(((0, 0), (0, -1), (-1, -1), (-1, 0)), corners, strict=True):
        assert np.hypot(map_x[row, column] - corner[0], map_y[row, column] - corner[1]) < 1.0 + half
    # straight lines stay straight: the middle of the face is where the diagonals cross
    diagonal = np.linalg.solve(
        np.array(
            [
                [corners[2][0] - corners[0][0], corners[1][0] - corners[3][0]],
                [corners[2][1] - corners[0][1], corners[1][1] - corners[3][1]],
            ]
        ),
        np.array([corners[1][0] - corners[0][0], corners[1][1] - corners[0][1]]),
    )
    cross = np.array(corners[0]) + diagonal[0] * (np.array(corners[2]) - np.array(corners[0]))
    found = (map_x[19:21, 29:31].mean(), map_y[19:21, 29:31].mean())
    assert found == pytest.approx(tuple(cross), abs=0.05)
    with pytest.raises(InputError, match="four corners"):
        sensor_from_corners(corners[:3], (6.0, 4.0))


def test_a_grid_undoes_a_lens() -> None:
    def bent(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        u, v = (x - 4.0) / 4.0, (y - 3.0) / 3.0
        swell = 1.0 + 0.06 * (u**2 + v**2)
        return np.stack([40.0 + 30.0 * u * swell, 30.0 + 22.0 * v * swell], axis=-1)

    y, x = np.mgrid[:7, :9].astype(float)
    map_x, map_y = maps_of(sensor_from_grid(bent(x, y), 1.0, mm_per_px=(0.1, 0.1)))
    fine_y, fine_x = np.mgrid[: map_x.shape[0], : map_x.shape[1]] * 0.1
    expected = bent(fine_x, fine_y)
    assert np.abs(map_x - expected[..., 0]).max() < 0.05
    assert np.abs(map_y - expected[..., 1]).max() < 0.05
    with pytest.raises(InputError, match="at least 2 by 2"):
        sensor_from_grid(np.zeros((1, 5, 2)), 1.0)


def test_many_sensors_do_not_pile_up() -> None:
    from tactilevision.sensors import rectification

    row, column = np.mgrid[:20, :30]
    for _ in range(20):
        rectify(with_maps((column.astype(np.float32), row.astype(np.float32))), ramp())
    assert len(rectification._fixed) <= rectification.KEPT


def test_the_page_of_sensors_lists_size_scale_and_what_is_ready() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "sensors.md").read_text(encoding="utf-8")
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| `")
    ]
    listed = {row[0].strip("`"): row for row in rows}
    assert set(listed) == {*SENSORS, "custom"}
    for kind, sensor in SENSORS.items():
        _, size, scale, view, ready, deepest = listed[kind]
        assert float(deepest) == pytest.approx(deepest_mm(sensor), abs=0.05)
        assert size == f"{sensor.width_px} x {sensor.height_px}"
        assert [float(one) for one in scale.split(", ")] == pytest.approx(list(dict.fromkeys(sensor.mm_per_px)))
        across, down = sensor.width_px * sensor.mm_per_px[0], sensor.height_px * sensor.mm_per_px[1]
        assert [float(one) for one in view.split(" x ")] == pytest.approx([across, down], abs=0.06)
        model = kind.removesuffix("_markers")
        assert (find_model(model) is not None) == (ready == f"network `{model}`")
