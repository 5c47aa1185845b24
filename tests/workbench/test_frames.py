"""What the page is told of the frames of a press."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.workbench.recorded import KEPT, Frames
from tactilevision.contact.bevel import Onset
from tactilevision.errors import InputError
from tactilevision.files.writing import as_json
from tactilevision.press.bevel_contact import ContactEvent
from tactilevision.press.certificate import Evidence
from tactilevision.records.maps import Footprint, HeightMap


def frames(touch_s: float | None) -> Frames:
    """Ten frames a tenth of a second apart, one press of the last six, a face 1 mm right of the middle."""
    press = SimpleNamespace(press="p1", start_s=0.35, end_s=0.95)
    recording: Any = SimpleNamespace(
        name="made", presses=(press,), frame_times_s=np.arange(10) / 10, frame_names=("f",) * 10
    )
    height = HeightMap(np.zeros((40, 80)), np.ones((40, 80), bool), mm_per_px=(0.1, 0.1))
    face = Footprint(np.ones((40, 80), bool), (1.0, 0.0), 0.0, 2.0, 0.0, (0.0, 0.0), 0.0, 0.3, 0.0, 0.0)
    onset: Any = Onset
    evidence = Evidence(
        press="p1",
        frame_index=5,
        frame_name="f",
        footprint=face,
        height_map=height,
        bevel_window_mm=((3.0, -1.0), (3.4, 1.0)),
        time_s=np.arange(4, 10) / 10,
        depth_mm=np.linspace(0, 0.5, 6),
        signal_mm=None,
        touch=None if touch_s is None else ContactEvent(touch_s, 0.01, 0.2, "height", onset),
        event_s=0.6,
        force_time_s=np.arange(1200) / 1200,
        force_N=np.ones((1200, 3)),
    )
    return Frames(recording, onset, {"p1": evidence})


def test_the_certificates_event_face_and_bevel_are_told_in_shares_of_the_picture() -> None:
    found = frames(0.63).view("p1")
    assert found["frames"] == [4, 5, 6, 7, 8, 9]
    assert found["event"] == 2
    assert found["event_s"] == pytest.approx(0.23)
    assert found["face"] == pytest.approx([0.625, 0.5, 0.25, 0.5])
    assert found["bevel"] == pytest.approx([0.875, 0.25, 0.05, 0.5])
    assert found["deepest_mm"] == 0.5
    assert (found["depth_s"][0], found["depth_mm"][-1]) == (0.0, 0.5)
    assert len(found["force_s"]) == len(found["force_N"]) <= 400


def test_without_a_sure_touch_there_is_no_event_and_without_evidence_only_frames() -> None:
    assert frames(None).view("p1")["event"] is None
    assert frames(None).view("p2") == {"frames": [], "times": [], "heights": True}


def test_ten_thousand_frames_are_told_at_once_and_read_one_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    made, many = frames(None), 10_000
    made.recording.frame_times_s = np.arange(many) / 100  # type: ignore[misc]
    made.recording.frame_names = ("f",) * many  # type: ignore[misc]
    made.recording.presses[0].end_s = 1e9  # type: ignore[misc]
    began = time.process_time()
    found = as_json(made.view("p1"))
    assert time.process_time() - began < 0.5
    assert len(found) < 300_000, "bytes that the page is sent of a press"
    read: list[int] = []
    monkeypatch.setattr("calibration.workbench.recorded.read_frame", lambda _, number: read.append(number))
    made.reconstructor = SimpleNamespace(
        rectified=lambda _: np.zeros((300, 400, 3), np.uint8), height_map=lambda _: None
    )  # type: ignore[assignment]
    assert made.small(9_000).shape == (180, 240, 3)
    assert read == [9_000]
    for number in range(0, many, 50):
        made.see(number)
    assert Frames._seen.cache_info().currsize == KEPT, "a long scrub does not fill the memory"
    with pytest.raises(InputError, match="no such frame"):
        made.small(many)
