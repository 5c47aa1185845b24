"""Flat punches in a bare folder: what the map says of them holds the truth, by the command as by the library."""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tactilevision.batch.folder import peak_mm, std_at
from tactilevision.cli import main
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.self_calibration import contact_of, contacts_in
from tactilevision.heightmap.torn_frames import TearCheck
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import make_reference
from tactilevision.recording.folder import read_folder
from tactilevision.recording.pictures import read_flats, read_frame, read_reference
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image
from tactilevision.records.maps import ASSUMED_SCALE, STEEP
from tactilevision.sensors.rectification import rectify

SAMPLES = Path(__file__).parents[2] / "sample_frames"


def bare(folder: Path, sample: str, chosen: list[int]) -> None:
    """Rectified frames of a sample, and one of its pictures of the untouched gel, in a folder without tables."""
    recording = read_recording(SAMPLES / sample)
    pictures = {"reference": read_flats(recording)[0]} | {
        f"frame_{number:05d}": read_frame(recording, number).rgb for number in chosen
    }
    for name, rgb in pictures.items():
        write_image(folder / f"{name}.png", rectify(recording.sensor, rgb))


def at_touch(press: str) -> tuple[int, float]:
    """The frame of the sample nearest to the bevel's touch of a press, and the true depth then, mm."""
    recording = read_recording(SAMPLES / "gelslim3")
    truth = tomllib.loads((SAMPLES / "gelslim3" / "truth.toml").read_text())
    one = next(row for row in truth["press"] if row["press"] == press)
    return int(np.argmin(np.abs(recording.frame_times_s - one["touch_time_s"]))), one["depth_mm"]


@pytest.mark.parametrize("press", [pytest.param("p06", marks=pytest.mark.slow), "p10"])
def test_six_frames_of_one_press_hold_its_depth_by_the_library_and_the_command(
    tmp_path: Path, press: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    number, true_mm = at_touch(press)
    (tmp_path / "in").mkdir()
    bare(tmp_path / "in", "gelslim3", list(range(number - 3, number + 3)))
    reader = build_reconstructor(read_folder(tmp_path / "in", "gelslim3"))
    recording = read_folder(tmp_path / "in", "gelslim3")
    height = reader.height_map(read_frame(recording, 3))
    depth_mm = peak_mm(height)
    std_mm = std_at(height, depth_mm)
    assert ASSUMED_SCALE in height.flags
    assert 0.5 * true_mm < depth_mm < true_mm + 2.0 * std_mm
    assert true_mm < depth_mm + 2.0 * std_mm
    command = ["tactilevision", "depth", str(tmp_path / "in"), "--sensor", "gelslim3", "--pictures", "0"]
    monkeypatch.setattr("sys.argv", [*command, "--out", str(tmp_path / "out"), "--workers", "1"])
    assert main() == 0
    row = list(csv.DictReader((tmp_path / "out" / "depth.csv").read_text().splitlines()))[3]
    assert row["frame"] == height.name
    assert float(row["peak_mm"]) == pytest.approx(depth_mm, abs=1e-4)
    assert float(row["peak_std_mm"]) == pytest.approx(std_mm, abs=1e-4)
    assert row["flags"].split() == list(height.flags)


def test_faces_of_a_path_tracer_hold_their_depth_in_a_bare_folder(tmp_path: Path) -> None:
    bare(tmp_path, "rendered_shadows", list(range(1, 9)))
    recording = read_folder(tmp_path, "gelslim3")
    reader = build_reconstructor(recording)
    steps = tomllib.loads((SAMPLES / "rendered_shadows" / "truth.toml").read_text())["step"]
    for number, step in enumerate(steps):
        height = reader.height_map(read_frame(recording, number))
        depth_mm = peak_mm(height)
        assert abs(depth_mm - step["face_mm"]) < 2.0 * std_at(height, depth_mm), step


def test_balls_hide_nothing_and_have_no_wall(tmp_path: Path) -> None:
    recording = read_recording(SAMPLES / "gelslim3")
    flat = rectify(recording.sensor, read_flats(recording)[0])
    for name, rgb in [("reference", flat)] + [
        (ball.path.stem, rectify(recording.sensor, read_reference(recording, ball.path)))
        for ball in recording.balls[::2]
    ]:
        write_image(tmp_path / f"{name}.png", rgb)
    folder = read_folder(tmp_path, "gelslim3")
    reader = build_reconstructor(folder)
    for number in range(8):
        seen = reader.read(read_frame(folder, number))
        assert STEEP not in seen.height.flags
        assert not seen.edges


def test_the_ring_of_a_punch_is_taken_as_its_whole_contact() -> None:
    recording = read_recording(SAMPLES / "gelslim3")
    number, _ = at_touch("p06")
    flat, rgb = (
        rectify(recording.sensor, one) for one in (read_flats(recording)[0], read_frame(recording, number).rgb)
    )
    reference = make_reference([flat])
    (contact,) = contacts_in([rgb], reference, TearCheck(recording.sensor))
    changes, _, valid = ColourChange(reference).measure(rgb)
    assert contact_of(changes, valid, np.random.default_rng(0)) is not None
    radius_px = np.std(contact.place[:, 0]) / np.std(contact.outward[:, 0]) * 0.5 * (rgb.shape[1] - 1)
    assert radius_px > 2.5 / 0.0634, "farther than the punch's edge"
