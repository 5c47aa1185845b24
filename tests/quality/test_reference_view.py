"""References of another view are registered or refused, and so are pictures under one light."""

from __future__ import annotations

import dataclasses
import re
import sys
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each
from shared_scenes import SAMPLE

from tactilevision.cli import main
from tactilevision.errors import InputError
from tactilevision.heightmap.build import build_reconstructor, flats_in_view
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_view import check_three_lights, in_view_of, register
from tactilevision.photometric.methods.network import find_model
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_network
from tactilevision.profile.sensor import make_profile
from tactilevision.recording.folder import read_folder
from tactilevision.recording.images import read_image
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Bytes
from tactilevision.sensors import get_sensor
from tactilevision.sensors.rectification import rectify

REAL = Path(__file__).parents[3] / "shared" / "real"
real = pytest.mark.skipif(not REAL.is_dir(), reason="real frames are not here")
SETS = {
    "gelslim3_mcubelab/markerless": ("ref.jpg", "sample_*"),
    "gelslim3_mcubelab/markers": ("ref.jpg", "sample_*"),
    "gelslim_heightmap/test_data": ("ref.jpg", "sample_*"),
    "taxim_gelsight_mini": ("f0.png", "img_*"),
    "feelanyforce/records/calibration_sphere": ("background.png", "tactile/*"),
}
SCALE, RIGHT, DOWN = 0.8, 0.05, -0.05  # of the picture: a crop and its middle


@lru_cache
def pictures(name: str) -> tuple[Bytes, tuple[Bytes, ...]]:
    reference, frames = SETS[name]
    some = sorted((REAL / name).glob(frames))
    return read_image(REAL / name / reference), tuple(read_image(path) for path in some[:: len(some) // 5])


def cropped(rgb: Bytes) -> Bytes:
    height, width = rgb.shape[:2]
    top, left = (round(n * ((1 - SCALE) / 2 + shift)) for n, shift in ((height, DOWN), (width, RIGHT)))
    part = rgb[top : top + round(SCALE * height), left : left + round(SCALE * width)]
    return np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_CUBIC))


@real
@each("name", sorted(SETS)[::2])
def test_a_real_reference_is_of_the_view_and_a_crop_of_it_is_registered(name: str) -> None:
    untouched, presses = pictures(name)
    assert in_view_of([untouched], presses)
    crop = cropped(untouched)
    assert not in_view_of([crop], presses)
    found = register([crop], presses)
    assert re.search(r"scaled by 0\.(79|80)", found.note)
    assert found.covered is not None
    assert found.covered.mean() == pytest.approx(SCALE**2, abs=0.03)
    off = np.abs(found.flats[0].astype(float) - untouched)[found.covered]
    assert np.median(off) < min(3, 0.2 * np.median(np.abs(crop.astype(float) - untouched)))  # grey levels


@real
@each("turn", [np.fliplr, np.flipud, lambda rgb: rgb[::-1, ::-1], lambda rgb: rgb[..., ::-1]])
@each("name", sorted(SETS))
def test_a_real_reference_that_is_turned_is_refused(name: str, turn: object) -> None:
    untouched, presses = pictures(name)
    assert callable(turn)
    turned = np.ascontiguousarray(turn(untouched))
    assert not in_view_of([turned], presses)
    with pytest.raises(InputError, match=r"the frames (are (mirrored|turned)|have red and blue swapped)"):
        register([turned], presses)


@real
@each("of, other", [sorted(SETS)[1:3], sorted(SETS)[4::-4]])
def test_the_reference_of_another_unit_is_refused(of: str, other: str) -> None:
    untouched, presses = pictures(of)[0], pictures(other)[1]
    untouched = np.asarray(cv2.resize(untouched, presses[0].shape[1::-1], interpolation=cv2.INTER_AREA))
    assert not in_view_of([untouched], presses)
    with pytest.raises(InputError, match="It may show another crop, place or unit"):
        register([untouched], presses)


def test_a_lamp_that_fails_or_another_exposure_is_the_same_view() -> None:
    recording = read_recording(SAMPLE)
    flats = [rectify(recording.sensor, read_image(path)) for path in recording.flats]
    for factor in ((0.5, 0.5, 0.5), (1.0, 1.0, 0.3)):
        dimmed = [np.rint(flats[0] * np.array(factor)).astype(np.uint8)]
        assert in_view_of(flats[1:], dimmed)


def white(rgb: Bytes, change: np.ndarray) -> Bytes:
    """The picture of a ball in a gel under one light, from its grey and a change of it."""
    grey = cv2.GaussianBlur(rgb.astype(np.float32).mean(axis=2), (0, 0), 30)
    warm = np.array([1.0, 0.9, 0.75], np.float32) * (1 + change)[..., None]
    return np.asarray(np.clip(np.rint(grey[..., None] * warm), 0, 255), np.uint8)


@each("kind", ["gelsight_mini", "gelslim3", "custom"])
def test_white_light_is_refused_whatever_the_sensor_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    rgb = np.full((240, 320, 3), 120, np.uint8)
    y, x = np.mgrid[:240, :320]
    dent = -0.4 * np.exp(-((x - 150) ** 2 + (y - 110) ** 2) / 800)
    cv2.imwrite(str(tmp_path / "reference.png"), white(rgb, np.zeros((240, 320)))[..., ::-1])
    cv2.imwrite(str(tmp_path / "press.png"), white(rgb, dent)[..., ::-1])
    with pytest.raises(InputError, match=r"three colours change alike \(correlation 1\.000\)"):
        build_reconstructor(read_folder(tmp_path, kind, mm_per_px=0.06, guess=True))
    words = (str(tmp_path), "--sensor", kind, "--mm-per-px", "0.06", "--out", str(tmp_path / "a.tvs"))
    for command in ("depth", "calibrate-sensor"):
        monkeypatch.setattr(sys, "argv", ["tactilevision", command, *words])
        assert main() == 2
    assert not (tmp_path / "a.tvs").exists()


@real
@each("name", sorted(SETS))
def test_coloured_light_is_not_white(name: str) -> None:
    untouched, presses = pictures(name)
    check_three_lights(untouched.astype(np.float32), presses)


def test_the_reference_among_the_frames_says_nothing_of_the_view() -> None:
    recording = read_recording(SAMPLE)
    flats = [rectify(recording.sensor, read_image(path)) for path in recording.flats]
    assert flats_in_view(recording, flats).note == ""
    assert flats_in_view(dataclasses.replace(recording, flats=()), flats).flats == []


def test_frames_of_another_view_than_the_balls_are_refused(tmp_path: Path) -> None:
    """A registered reference would contradict the ball presses of its own view."""
    recording = read_recording(SAMPLE)
    for k in range(0, 40, 10):
        rgb = cropped(read_frame(recording, k).rgb)
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), rgb[..., ::-1])
    names = tuple(sorted(path.name for path in tmp_path.iterdir()))
    times = np.arange(len(names), dtype=np.float64)
    other = dataclasses.replace(recording, frames_path=tmp_path, frame_names=names, frame_times_s=times)
    with pytest.raises(InputError, match="not of the view of the reference and the ball presses"):
        build_reconstructor(other)


def test_a_single_picture_under_white_light_is_rejected() -> None:
    """As of a video whose first frames are untouched."""
    grey = np.full((240, 320, 3), 120, np.uint8)
    y, x = np.mgrid[:240, :320]
    flat = white(grey, 0.05 * (x - 160) / 160)
    press = white(grey, 0.05 * (x - 160) / 160 - 0.4 * np.exp(-((x - 150) ** 2 + (y - 110) ** 2) / 400))
    sensor = get_sensor("gelsight_mini")
    path = find_model("gelsight_mini")
    assert path is not None
    reader = Reconstructor(sensor, load_network(path, make_reference([flat])))
    reader.rectified_map(flat)
    with pytest.raises(InputError, match="three colours change alike"):
        reader.rectified_map(press)


@real
def test_no_shear_is_measured_from_a_registered_reference(tmp_path: Path) -> None:
    untouched, presses = pictures("gelslim3_mcubelab/markerless")
    cv2.imwrite(str(tmp_path / "reference.png"), cropped(untouched)[..., ::-1])
    for k, rgb in enumerate(presses[:4]):
        cv2.imwrite(str(tmp_path / f"{k}.png"), rgb[..., ::-1])
    recording = read_folder(tmp_path, "gelslim3", mm_per_px=0.0634, guess=True)
    reader = build_reconstructor(recording)
    assert reader.match is not None
    assert reader.match.registered
    valid = reader.rectified_map(presses[0]).valid
    assert not valid[:20].any() or not valid[-20:].any()  # beyond the crop
    assert make_profile(recording, reader).followed == "nothing"
