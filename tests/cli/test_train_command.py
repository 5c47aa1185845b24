"""train as a user calls it: any method, its card, and what it says of recordings it cannot use."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from sample_light import SAMPLE, light_of_sample

from tactilevision.cli import main
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.network_training import NetworkFitter
from tactilevision.photometric.storage import load_method
from tactilevision.press import certified_faces as wall_lessons
from tactilevision.press.certified_faces import Certified
from tactilevision.recording.read import read_recording
from tactilevision.records.certified import TaughtWalls


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, arguments)])
    return main()


@pytest.mark.slow
@pytest.mark.parametrize("balls", [6, 16])
def test_a_network_is_trained_and_used_again(balls: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With six balls and no presses, or with the whole sample."""
    sample = SAMPLE if balls == 16 else light_of_sample(tmp_path, balls=balls)
    monkeypatch.setitem(PHOTOMETRIC, "network", NetworkFitter(steps=40))
    out = tmp_path / "light.npz"
    assert run(monkeypatch, "train", sample, "--method", "network", "--out", out, "--licence", "CC0-1.0") == 0
    card = json.loads(out.with_suffix(".json").read_text())
    assert card["method"] == "network"
    assert card["licence"] == "CC0-1.0"
    assert card["sensor"] == "gelslim3"
    assert f"{balls} ball presses" in card["data"]
    assert {"torch", "onnxruntime", "kornia"} <= set(card["versions"])
    assert 0.5 < card["held_out_depth_ratio"] < 1.5
    assert len(card["held_out_balls"]) == balls
    steps = card["flat_steps"]  # so short a training may leave none of them to be certified; it says so
    counted = sum(band["count"] for band in card.get("flat_steps_by", {"true_mm": ()})["true_mm"])
    assert counted == len(steps) if isinstance(steps, list) else "no flat steps" in steps
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert card["held_out_direction_error_deg"] < 20.0
    found = build_reconstructor(read_recording(sample), str(out))
    assert found.method.name == "network"


@pytest.mark.parametrize("balls", [0, 2])
def test_too_few_balls_are_told(
    balls: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "train", light_of_sample(tmp_path, balls=balls), "--out", tmp_path / "light.npz") == 2
    said = capsys.readouterr().err
    assert ("no ball presses" in said) if balls == 0 else ("too few ball presses" in said)
    assert not (tmp_path / "light.npz").exists()


def test_an_unknown_method_is_named_with_the_known_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "train", SAMPLE, "--method", "magic", "--out", tmp_path / "light.npz") == 2
    said = capsys.readouterr().err
    assert "polynomial" in said
    assert "network" in said


def test_the_card_says_that_its_steps_were_read_before_walls_were_taught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    walls = TaughtWalls(0.1, 0.2, (0.01, 0.02, 0.0), (0.2, 0.6), 0.03)

    def plant(reader: Reconstructor, _: object) -> Reconstructor:
        return reader.varied(taught=walls)

    steps = {"flat_steps": "planted"}, (Certified("1", 1.0, 0.3),)
    monkeypatch.setattr(sys.modules["tactilevision.cli.train"], "_certified", lambda *_: steps)
    monkeypatch.setattr(wall_lessons, "teach_walls", plant)
    out = tmp_path / "light.npz"
    assert (
        run(monkeypatch, "train", light_of_sample(tmp_path, balls=8), "--method", "polynomial", "--out", out) == 0
    )
    assert "before" in json.loads(out.with_suffix(".json").read_text())["flat_steps_walls"]
    assert load_method(out).walls == walls


def test_a_bare_folder_of_presses_without_a_radius_is_told_the_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sample = read_recording(SAMPLE)
    shutil.copy(sample.flats[0], tmp_path / f"ref{sample.flats[0].suffix}")
    for number, ball in enumerate(sample.balls[:3]):
        shutil.copy(ball.path, tmp_path / f"{number}{ball.path.suffix}")
    assert run(monkeypatch, "train", tmp_path, "--sensor", "gelslim3", "--out", tmp_path / "light.npz") == 2
    assert "state the radius with --ball-radius-mm" in capsys.readouterr().err
