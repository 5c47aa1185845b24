"""Cameras that lose, repeat and go; only the newest frame is read; the audit sees what is planted."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.heightmap.scene_faults import blocks_grey
from tactilevision.records.measured import Bytes
from tactilevision.robots.camera import AUTOMATIC, Camera, Newest, Shot, audit, open_camera


class FakeCapture:
    """Gives these pictures (blue first), None for one that does not come, then nothing any more."""

    def __init__(self, pictures: list[Any], exposure: float = 1.0) -> None:
        self.pictures, self.exposure, self.released = iter(pictures), exposure, False

    def read(self) -> tuple[bool, Any]:
        found = next(self.pictures, None)
        return found is not None, found

    def get(self, prop: int, /) -> float:
        return self.exposure if prop == cv2.CAP_PROP_AUTO_EXPOSURE else 0.0

    def release(self) -> None:
        self.released = True


class Clock:
    """Goes on by a tenth of a second with every look."""

    now_s = 0.0

    def __call__(self) -> float:
        self.now_s += 0.1
        return self.now_s


def camera(pictures: list[Any], exposure: float = 1.0) -> Camera:
    return Camera(FakeCapture(pictures, exposure), "camera 0", clock=Clock(), sleep=lambda _: None)


def blue() -> Any:
    return np.full((4, 6, 3), (200, 20, 10), np.uint8)


def test_a_cameras_colours_are_turned_to_red_first_and_counted() -> None:
    coming = camera([blue(), None, blue(), blue()]).shots()
    shots = [next(coming) for _ in range(3)]
    with pytest.raises(InputError, match=r"camera 0: the camera has gone \(got '3 frames came'\)\. Check its"):
        next(coming)
    assert [shot.number for shot in shots] == [0, 1, 2]
    assert shots[0].rgb[0, 0].tolist() == [10, 20, 200]
    assert shots[1].time_s > shots[0].time_s


def test_a_camera_without_pictures_colours_or_number_is_told() -> None:
    with pytest.raises(InputError, match="the camera gives no pictures"):
        next(camera([]).shots())
    with pytest.raises(InputError, match="no colours of 8 bits"):
        next(camera([np.zeros((4, 6), np.uint8)]).shots())
    with pytest.raises(InputError, match=r"no camera of that number can be opened \(got 97\)"):
        open_camera(97)


def test_automatic_exposure_is_told_by_the_driver() -> None:
    assert camera([]).doubts == ()
    assert "exposure is automatic" in camera([], AUTOMATIC).doubts[0]


class Counting:
    """A source of numbered shots that come as fast as they are taken."""

    name = "counting"

    def __init__(self, count: int, *, waits: bool = False, fault: Exception | None = None) -> None:
        self.count, self.waits, self.fault, self.closed = count, waits, fault, False

    def shots(self) -> Iterator[Shot]:
        picture = np.zeros((2, 2, 3), np.uint8)
        for number in range(self.count):
            time.sleep(0.0005)
            yield Shot(picture, time.monotonic(), number)
        if self.fault is not None:
            raise self.fault

    def close(self) -> None:
        self.closed = True


def test_a_slow_reader_drops_frames_and_never_lags() -> None:
    source, seen, ages = Counting(60), [], []
    with Newest(source) as newest:
        for shot in newest:
            ages.append(time.monotonic() - shot.time_s)
            seen.append(shot.number)
            time.sleep(0.006)
    assert seen == sorted(seen)
    assert seen[-1] == 59
    assert len(seen) < 40
    assert newest.came == 60
    assert newest.dropped == 60 - len(seen)
    assert np.median(ages) < 0.006, "what is read is new, however slow the reader"
    assert source.closed


def test_every_frame_is_waited_for_where_that_is_asked_for_and_possible() -> None:
    for waits, all_seen in ((True, True), (False, False)):
        with Newest(Counting(12, waits=waits), every=True) as newest:
            seen = []
            for shot in newest:
                seen.append(shot.number)
                time.sleep(0.004)
        assert (seen == list(range(12))) == all_seen


def test_what_goes_wrong_with_the_source_reaches_the_reader_after_its_last_frame() -> None:
    source, seen = Counting(3, waits=True, fault=InputError("the camera has gone")), []
    with pytest.raises(InputError, match="the camera has gone"), Newest(source, every=True) as newest:
        seen += [shot.number for shot in newest]
    assert source.closed


def test_a_reader_that_has_enough_stops_the_source() -> None:
    source = Counting(10**6)
    with Newest(source) as newest:
        next(iter(newest))
    assert source.closed
    assert newest.came < 10**6


# the audit


def gel(rng: np.random.Generator, gain: float = 1.0) -> Bytes:
    y, x = np.mgrid[:120, :160] / 160
    lit = gain * np.stack([60 + 90 * x, 70 + 60 * (1 - x), 50 + 120 * (1 - y)], axis=2)
    return np.asarray(np.clip(lit + rng.normal(0, 1.0, lit.shape), 0, 255), np.uint8)


def shots(count: int = 40, *, gain: float = 0.0, lost: int = 0, repeated: int = 0) -> list[Shot]:
    rng, found, time_s = np.random.default_rng(0), list[Shot](), 0.0
    for number in range(count):
        time_s += 1 / 60 + rng.normal(0, 5e-4) + (1 / 60 if number and number <= lost else 0.0)
        rgb = found[-1].rgb if 0 < number <= repeated else gel(rng, 1.0 + gain * number / count)
        found.append(Shot(rgb, time_s, number))
    return found


def test_a_good_camera_has_no_warning() -> None:
    seen = audit(shots())
    assert seen.warnings == ()
    assert seen.rate_Hz == pytest.approx(60, rel=0.02)
    assert (seen.lost, seen.repeated) == (0, 0)
    assert seen.brightness_change < 0.01


def test_what_is_planted_is_seen() -> None:
    lossy, slow, automatic = audit(shots(lost=5)), audit(shots(repeated=6)), audit(shots(gain=0.1))
    assert lossy.lost == 5
    assert "5 frames were lost" in lossy.warnings[0]
    assert slow.repeated == 6
    assert "6 of 40 frames repeat the one before" in slow.warnings[0]
    assert automatic.brightness_change == pytest.approx(0.1, rel=0.1)
    assert "is the exposure automatic" in automatic.warnings[0]
    assert set(automatic.as_json()) >= {"rate_Hz", "blocks_grey", "warnings"}


@each("quality", [95, 80, 50, 30])
def test_compression_of_any_quality_is_told_and_its_absence_too(quality: int) -> None:
    rgb = gel(np.random.default_rng(1))
    data = cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    spoilt = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
    assert blocks_grey(rgb) < 0.05
    for picture, told in ((rgb, False), (spoilt, True)):
        seen = audit([Shot(picture, k / 60, k) for k in range(3)])
        assert any("pictures are compressed" in said for said in seen.warnings) == told


def test_one_frame_is_no_audit() -> None:
    with pytest.raises(InputError, match=r"an audit needs frames \(got 1\)"):
        audit(shots(1))
