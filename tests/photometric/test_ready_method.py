"""The method that comes along reads gels like GelSlim's before any calibration, and says that it is not theirs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from lamp_room import flat

from tactilevision.errors import InputError
from tactilevision.photometric import load_method
from tactilevision.reconstruct import build_reconstructor
from tactilevision.recording import Recording
from tactilevision.sensors import get_sensor
from tactilevision.weights import find_model


def recording(folder: Path, kind: str, *, flats: int = 1) -> Recording:
    frame = flat(np.random.default_rng(0))
    names = [folder / f"flat{k}.png" for k in range(flats)]
    for name in names:
        cv2.imwrite(str(name), frame[..., ::-1])
    sensor = get_sensor(kind, width_px=frame.shape[1], height_px=frame.shape[0])
    return Recording(folder, "bare", sensor, flats=tuple(names))


def test_it_fits_its_card() -> None:
    path = find_model("gelslim3")
    assert path is not None
    method = load_method(path)
    assert method.card["held_out_direction_error_deg"] < 10.0
    assert method.card["licence"] == "MIT"


def test_without_balls_it_is_used_and_named(tmp_path: Path) -> None:
    found = build_reconstructor(recording(tmp_path, "gelslim3"))
    assert "no ball presses" in found.warnings[0]
    assert found.method.name == "polynomial"


def test_other_sensors_and_missing_references_are_told_what_they_lack(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no ball presses to calibrate the light from"):
        build_reconstructor(recording(tmp_path, "digit"))
    with pytest.raises(InputError, match="no picture of the untouched gel"):
        build_reconstructor(recording(tmp_path, "gelslim3", flats=0))
    with pytest.raises(InputError, match=r"no photometric method of that name.*polynomial, lookup"):
        build_reconstructor(recording(tmp_path, "gelslim3"), "polynomal")


def test_a_saved_method_is_taken_by_its_path(tmp_path: Path) -> None:
    path = find_model("gelslim3")
    assert path is not None
    found = build_reconstructor(recording(tmp_path, "digit"), str(path))
    assert found.method.name == "polynomial"
    assert found.warnings == ()
