"""Real GelSight Mini and GelSight Wedge under a growing force: what is seen grows with it.

No ball of known size was pressed into these two, so there is no light to calibrate and no depth to compare; what
can be held is that the change of colour, once the light's own drift is taken off, follows the force sensor. Rank
correlations as measured on 2026-11-21, with a little room.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each
from scipy.stats import spearmanr

from tactilevision.errors import InputError
from tactilevision.photometric.ball_detection import first_guess
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import make_reference
from tactilevision.records.measured import Bytes
from tactilevision.sensors import get_sensor
from tactilevision.sensors.rectification import rectify, sensor_from_corners

REAL = Path(__file__).parents[2] / ".." / "shared" / "real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="the real frames are not at hand")
MINI = REAL / "feelanyforce" / "records" / "calibration_sphere"
WEDGE = REAL / "estimate_modulus" / "example_data" / "2023-12-06"
WEDGE_CORNERS = [(49.0, 68.0), (462.0, 108.0), (457.0, 384.0), (46.0, 444.0)]  # clicked on a frame of golf_ball_1


def read(path: Path) -> Bytes:
    picture = cv2.imread(str(path))
    assert picture is not None, path
    return np.ascontiguousarray(picture[..., ::-1])


def seen(change: ColourChange, rgb: Bytes) -> float:
    """Root mean square of the smoothed change of colour."""
    return float(np.sqrt(np.mean(cv2.GaussianBlur(change.measure(rgb)[0].transpose(1, 2, 0), (0, 0), 2) ** 2)))


def weights() -> Iterator[tuple[Path, float]]:
    """Frames of the sphere under growing weights with their normal force (unit not documented)."""
    with next(MINI.glob("*.csv")).open(encoding="utf-8") as table:
        for row in csv.DictReader(table):
            forces = (row["FT"] or "").split()
            picture = MINI / "tactile" / Path(row["tactile"] or "none").name
            if len(forces) == 6 and picture.is_file():
                yield picture, float(forces[2])


def test_gelsight_mini_sees_the_weight_grow() -> None:
    sensor = get_sensor("gelsight_mini")
    change = ColourChange(make_reference([read(MINI / "background.png")], may_have_marks=False))
    rows = list(weights())
    assert len(rows) > 100
    sizes = [seen(change, rectify(sensor, read(path))) for path, _ in rows[::3]]
    assert spearmanr(sizes, [force for _, force in rows[::3]])[0] > 0.95


def test_a_sphere_larger_than_the_view_is_not_taken_for_a_ball_press() -> None:
    change = ColourChange(make_reference([read(MINI / "background.png")], may_have_marks=False))
    last = list(weights())[-1][0]
    with pytest.raises(InputError, match="no contact exceeds the noise"):
        first_guess(change.measure(read(last))[0].transpose(1, 2, 0))


@each(
    "name, least",
    [
        ("golf_ball_1", 0.9),
        ("foam_brick_1", 0.95),
        ("orange_ball_softest_1", 0.92),
        ("purple_ball_hardest_1", 0.9),
    ],
)
def test_gelsight_wedge_sees_the_grip_grow(name: str, least: float) -> None:
    sensor = sensor_from_corners(WEDGE_CORNERS, (29.1, 21.8), mm_per_px=get_sensor("gelsight_wedge").mm_per_px)
    assert (sensor.width_px, sensor.height_px) == (320, 240)
    video = cv2.VideoCapture(str(WEDGE / f"{name}.avi"))
    frames = []
    while (read_frame := video.read())[0]:
        frames.append(rectify(sensor, np.ascontiguousarray(read_frame[1][..., ::-1])))
    force = np.load(WEDGE / f"{name}_forces.npy", allow_pickle=False)
    assert len(frames) == len(force)
    change = ColourChange(make_reference(frames[:1], may_have_marks=False))
    sizes = [seen(change, frame) for frame in frames]
    assert spearmanr(sizes, force)[0] > least
    loading = slice(0, int(np.argmax(force)) + 1)
    assert spearmanr(sizes[loading], force[loading])[0] > 0.94, "the two clocks differ; one way, ranks do not mind"
