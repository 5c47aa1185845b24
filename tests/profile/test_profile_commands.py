"""`calibrate-sensor`, and the profile in `depth`, `force` and `view`; a bare folder with what can be guessed."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from each import each
from lamp_sensor import TOML, free, pressed, saved, write_ball_folder, write_frames

from tactilevision.cli import main, train as command
from tactilevision.files.tiff import read_tiff
from tactilevision.photometric.storage import save_method
from tactilevision.press import certified_faces
from tactilevision.profile.sensor import load_sensor
from tactilevision.profile.storage import read_profile
from tactilevision.recording.images import read_image
from tactilevision.recording.write import write_image

DATA = Path(__file__).parents[1] / "data"


def run(*words: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        return main()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A profile made by the command from a folder of ball presses and flats."""
    root = write_ball_folder(tmp_path_factory.mktemp("balls"))
    out, told = root / "lamp.tvs", root / "told.json"
    words = ("--sensor", root / "sensor.toml", "--serial", "07", "--out", out, "--json", told)
    assert run("calibrate-sensor", root, *words) == 0
    return out


def test_a_folder_of_balls_and_flats_becomes_a_sensor(made: Path) -> None:
    profile = read_profile(made)
    assert profile.name == "custom 07"
    assert profile.method.card.balls == 8
    assert profile.material is not None
    assert profile.material.youngs_modulus_MPa == 0.2
    told = json.loads((made.parent / "told.json").read_text())
    assert (told["serial"], told["method"], told["poisson_ratio"]) == ("07", "polynomial", 0.48)
    seen = load_sensor(made).read(pressed())
    assert seen.height.depth_mm.max() == pytest.approx(0.49, rel=0.1)
    assert seen.wrench is not None
    assert seen.wrench.force_N[2] > 0.1


def test_what_the_certificate_warned_of_is_not_said_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = SimpleNamespace(depth_scale=None, doubt="faces read 25 % less")
    monkeypatch.setattr(certified_faces, "read_faces", lambda *_, **__: [])
    monkeypatch.setattr(certified_faces, "face_depth_correction", lambda *_, **__: found)
    reader: Any = SimpleNamespace(taught=None)
    recording: Any = None
    for said, times in (("another",), 1), (("faces read 25 % less",), 0):
        assert command._taught(recording, reader, [], said=said) == (reader, None)
        assert capsys.readouterr().err.count("faces read") == times


def test_depth_force_and_view_take_the_profile(made: Path, tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "frames")
    assert run("depth", frames, "--sensor", made, "--out", tmp_path / "d", "--workers", 1, "--pictures", 0) == 0
    height = read_tiff(tmp_path / "d" / "depth" / "1.tiff")
    seen = load_sensor(made).read(pressed())
    np.testing.assert_array_equal(height.depth_mm, seen.height.depth_mm)
    assert run("force", frames, "--sensor", made, "--out", tmp_path / "f", "--workers", 1, "--pictures", 0) == 0
    with (tmp_path / "f" / "resultants.csv").open() as file:
        forces = [float(row["fz_N"]) for row in csv.DictReader(file)]
    assert seen.wrench is not None
    assert forces[0] == 0.0
    assert forces[1] == pytest.approx(seen.wrench.force_N[2], rel=1e-5)
    assert run("view", frames, "--sensor", made, "--frame", "1", "--out", tmp_path / "v") == 0
    assert (tmp_path / "v" / "1_depth.png").is_file()


def test_a_newer_reference_is_taken(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_frames(tmp_path / "frames")
    words = ("--sensor", made, "--out", tmp_path / "d", "--workers", 1, "--pictures", 0)
    assert run("depth", tmp_path / "frames", *words, "--reference", tmp_path / "frames" / "0.png") == 0
    assert read_tiff(tmp_path / "d" / "depth" / "0.tiff").depth_mm.max() < 0.02
    assert "guessed" not in capsys.readouterr().err


def test_the_recording_that_a_profile_was_made_from_is_read_with_it(tmp_path: Path) -> None:
    """A recording with an older method: what it lacks of the light is in the profile."""
    shutil.copytree(DATA / "small", tmp_path / "small")
    words = ("--method", DATA / "methods" / "polynomial.npz")
    write_image(tmp_path / "small/reference/flat/a.png", read_image(tmp_path / "small/frames/00000.jpg"))
    assert run("calibrate-sensor", tmp_path / "small", *words, "--light-only", "--out", tmp_path / "a.tvs") == 0
    assert run("depth", tmp_path / "small", *words, "--out", tmp_path / "one", "--pictures", 0, "--even-so") == 0
    profile = ("--sensor", tmp_path / "a.tvs", "--pictures", 0, "--even-so")
    assert run("depth", tmp_path / "small", *profile, "--out", tmp_path / "two") == 0
    one, two = (read_tiff(tmp_path / out / "depth" / "00012.tiff").depth_mm for out in ("one", "two"))
    np.testing.assert_array_equal(one, two)
    (tmp_path / "tree").mkdir()
    shutil.move(tmp_path / "small", tmp_path / "tree" / "a")
    shutil.copytree(tmp_path / "tree" / "a", tmp_path / "tree" / "b")
    settings = tmp_path / "tree" / "b" / "recording.toml"
    settings.write_text(settings.read_text().replace('"simulated"', '"08"'))
    told = tmp_path / "told.json"
    assert run("depth", tmp_path / "tree", *profile, "--out", tmp_path / "three", "--json", told) == 0
    assert "its serial is simulated, the recording's is 08" in json.loads(told.read_text())["passed_over"]["b"]
    assert (tmp_path / "three" / "a" / "depth" / "00012.tiff").is_file()


SAID = {
    "is determined by the sensor profile": ("depth", "{frames}", "--sensor", "{tvs}", "--mm-per-px", 0.05),
    "was made for frames of 240 x 180 px": ("depth", "{small}", "--sensor", "{tvs}"),
    "E and nu of the gel are not known": ("force", "{frames}", "--sensor", "{unknown}"),
    "there is no such sensor profile": ("view", "{frames}", "--sensor", "{frames}/none.tvs"),
    "the name of a sensor profile ends in .tvs": ("calibrate-sensor", "{frames}", "--out", "a"),
    "a profile cannot be made from a profile": ("calibrate-sensor", "{frames}", "--sensor", "{tvs}"),
    "Name it with --sensor: gelslim3": ("depth", "{frames}"),
    "Name what was calibrated before with --method FILE.npz or --sensor FILE.tvs": (
        "depth",
        "{untouched}",
        "--sensor",
        "gelsight_wedge",
        "--mm-per-px",
        0.08,
    ),
    "State it with --mm-per-px": ("depth", "{frames}", "--sensor", "digit"),
    "the folder holds no pictures": ("depth", "{empty}", "--sensor", "digit"),
    "State it with --ball-radius-mm": ("calibrate-sensor", "{untold}", "--sensor", "{toml}"),
    "Name it with --reference": ("calibrate-sensor", "{frames}", "--sensor", "{toml}", "--ball-radius-mm", 4),
}


@each("said", SAID)
def test_what_is_wrong_is_said_with_the_option_that_would_help(
    said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_frames(tmp_path / "frames")
    write_image(tmp_path / "small" / "a.png", free()[:90, :120])
    write_image(tmp_path / "untold" / "ball" / "a.png", pressed())
    write_image(tmp_path / "untold" / "flat" / "a.png", free())
    for name in "ab":
        write_image(tmp_path / "untouched" / f"{name}.png", free())
    (tmp_path / "empty").mkdir()
    (tmp_path / "sensor.toml").write_text(TOML)
    without = "".join(line for line in TOML.splitlines(True) if not line.startswith("youngs_modulus"))
    (tmp_path / "unknown.toml").write_text(without)
    places = {name: tmp_path / name for name in ("frames", "small", "empty", "untold", "untouched")}
    places |= {"tvs": saved(tmp_path), "toml": tmp_path / "sensor.toml", "unknown": tmp_path / "unknown.toml"}
    before = {path.name for path in tmp_path.iterdir()}
    assert run(*(str(word).format(**places) for word in SAID[said])) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert said in told
    assert "recording.toml" not in told
    assert {path.name for path in tmp_path.iterdir()} == before, "nothing half-written"


def test_a_bare_folder_is_read_with_what_is_guessed_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The light is that of the contacts, which stand in another light than GelSlim's; the rest is guessed."""
    frames = write_frames(tmp_path / "frames")
    words = ("--sensor", "gelslim3", "--out", tmp_path / "d", "--pictures", 0)
    assert run("depth", frames, *words) == 0
    told = capsys.readouterr().err
    assert "guessed: 0.1128 mm per pixel, that of a usual gelslim3; --mm-per-px states it" in told
    assert "guessed: the first frame, 0.png, shows the untouched gel; --reference states it" in told
    assert "guessed: frames are rectified already" in told
    assert "contacts in the frames" in told
    assert "They contradict the ready network for gelslim3" in told
    scale = read_tiff(tmp_path / "d" / "depth" / "1.tiff").mm_per_px
    assert scale == pytest.approx((0.0634 * 427 / 240, 0.0634 * 320 / 180))
    assert run("depth", frames, *words, "--mm-per-px", 0.08, "--reference", frames / "0.png") == 0
    told = capsys.readouterr().err
    assert "per pixel" not in told
    assert "first frame" not in told
    assert read_tiff(tmp_path / "d" / "depth" / "1.tiff").mm_per_px == (0.08, 0.08)


def test_a_saved_method_keeps_its_own_reference(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    method = save_method(read_profile(made).method, tmp_path / "method.npz")
    frames = write_frames(tmp_path / "frames")
    (frames / "0.png").unlink()
    words = ("--sensor", "gelsight_mini", "--mm-per-px", 0.08, "--method", method, "--pictures", 0)
    assert run("depth", frames, *words, "--out", tmp_path / "d") == 0
    assert "the untouched gel" not in capsys.readouterr().err
    assert read_tiff(tmp_path / "d" / "depth" / "1.tiff").depth_mm.max() == pytest.approx(0.49, rel=0.1)


def test_force_takes_the_thickness_from_the_calibration_where_nothing_describes_the_gel(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    method = save_method(read_profile(made).method, tmp_path / "method.npz")
    frames = write_frames(tmp_path / "frames")
    known: dict[str, Any] = {"youngs_modulus_MPa": 0.2, "poisson_ratio": 0.48}
    known["gel"] = {"thickness_mm": 3.0, "shape": "disc"}
    (tmp_path / "calibration.json").write_text(json.dumps(known))
    words: tuple[object, ...] = ("--sensor", "gelsight_mini", "--mm-per-px", 0.08, "--method", method)
    words = (*words, "--workers", 1, "--pictures", 0)
    assert (
        run("force", frames, *words, "--calibration", tmp_path / "calibration.json", "--out", tmp_path / "f") == 0
    )
    assert "guessed: the gel is 3 mm thick, as the calibration's" in capsys.readouterr().err
    del known["gel"]
    (tmp_path / "calibration.json").write_text(json.dumps(known))
    assert (
        run("force", frames, *words, "--calibration", tmp_path / "calibration.json", "--out", tmp_path / "g") == 2
    )
    told = capsys.readouterr().err
    assert "forces need the gel's thickness" in told
    assert "a profile, with --sensor" in told


def test_contacts_and_one_picture_of_the_gel_make_a_profile(tmp_path: Path) -> None:
    frames, out = write_frames(tmp_path / "frames"), tmp_path / "a.tvs"
    words = ("--sensor", "gelslim3", "--mm-per-px", 0.08, "--reference", frames / "0.png", "--out", out)
    assert run("calibrate-sensor", frames, *words) == 0
    profile = read_profile(out)
    assert profile.method.card.fitted_by == "contacts"
    assert any("the scale may be off by a factor of two or three" in said for said in profile.warnings)
    one = load_sensor(out).read(pressed())
    assert run("depth", frames, *words[:-2], "--out", tmp_path / "d", "--pictures", 0) == 0
    np.testing.assert_array_equal(one.height.depth_mm, read_tiff(tmp_path / "d" / "depth" / "1.tiff").depth_mm)
