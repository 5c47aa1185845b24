"""What is not known of the drift of the light, as depth: as much as a wrong drift really makes of a map."""

from __future__ import annotations

import dataclasses
from functools import cache

import cv2
import numpy as np
import pytest
from lamp_room import MM_PER_PX, SHAPE, ball, flat, picture, room_calibration

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.records.measured import Bytes
from tactilevision.sensors import get_sensor

BALL_MM = 4.0


@cache
def method() -> CalibratedMethod:
    return room_calibration(14).method  # so many that corners are read as straight as the middle


def reader() -> Reconstructor:
    sensor = get_sensor("custom", width_px=SHAPE[1], height_px=SHAPE[0], mm_per_px=MM_PER_PX)
    return Reconstructor(sensor, dataclasses.replace(method()))


def pressed(contact_mm: float, gain: float) -> Bytes:
    _, p, q = ball((1.0, -0.5), contact_mm, 10.0)
    return picture(p, q, np.random.default_rng(1), gain=gain)


@pytest.mark.parametrize(("channel", "number", "size"), [(2, 1, 0.004), (0, 2, -0.004), (1, 3, 0.006)])
def test_depth_moves_as_a_wrong_coefficient_moves_it(
    channel: int, number: int, size: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lean and stray light of one channel put wrong by hand; the robust plane moves a little on its own."""
    made, rgb = reader(), flat(np.random.default_rng(1), gain=1.03)
    assert made.referenced is not None
    assert made.error is not None
    seen, tracker = made.read_rectified(rgb), made.referenced.change.tracker
    before = seen.height.depth_mm
    covariance = np.zeros((18, 18))
    covariance[6 * channel + number, 6 * channel + number] = size**2
    said = np.sqrt(made.error.drift.variance(covariance, seen.zero))
    right = tracker.measure(rgb)
    assert right.undo is not None

    def wrong(_: Bytes) -> Drift:
        gains, undo = right.gains.copy(), np.array(right.undo)
        if number < 3:
            gains[channel, number] += size
        else:
            undo[:, 3] -= undo[:, channel] * size * tracker.light[channel]
        return dataclasses.replace(right, gains=gains, undo=undo)

    monkeypatch.setattr(tracker, "measure", wrong)
    moved = made.rectified_map(rgb).depth_mm - before
    rows, columns = said.shape
    blocks = cv2.resize(moved, (columns, rows), interpolation=cv2.INTER_AREA)
    most = float(np.abs(blocks).max())
    assert most > 0.003
    assert said == pytest.approx(np.abs(blocks), abs=0.2 * most)


def test_it_grows_with_the_contact_and_is_none_where_nothing_drifted() -> None:
    made = reader()
    assert made.referenced is not None
    assert made.error is not None
    middle = []
    for contact_mm in (1.0, 2.0, 3.5):
        seen = made.read_rectified(pressed(contact_mm, 1.05))
        drift = made.referenced.change.tracker.measure(pressed(contact_mm, 1.05))
        assert drift.covariance is not None
        said = np.sqrt(made.error.drift.variance(drift.covariance, seen.zero))
        middle.append(float(said[said.shape[0] // 2, said.shape[1] // 2]))
    assert middle[0] < middle[1] < middle[2]
    assert made.referenced.change.tracker.measure(flat(np.random.default_rng(3))).covariance is None
