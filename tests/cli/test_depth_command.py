"""`depth` on bare folders: its exit code says whether there are maps at all."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each
from shared_scenes import SAMPLE

from tactilevision.batch.selection import strongest_frames
from tactilevision.cli import main
from tactilevision.cli.depth import how_to_keep_light
from tactilevision.cli.source import Choice
from tactilevision.errors import InputError
from tactilevision.recording.folder import read_folder
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Bytes
from tactilevision.sensors import get_sensor


def untouched() -> Bytes:
    y, x = np.mgrid[:320, :427] / 427.0
    lit = np.stack([60 + 90 * x, 70 + 60 * (1 - x), 50 + 120 * (1 - y)], axis=2)
    return np.asarray(lit + np.random.default_rng(3).normal(0, 1.5, lit.shape), np.uint8)


def command(monkeypatch: pytest.MonkeyPatch, folder: Path, path: Path) -> int:
    words = (
        "depth",
        path,
        "--sensor",
        "gelslim3",
        "--reference",
        folder / "flat.png",
        "--out",
        folder / "out",
        "--workers",
        1,
        "--pictures",
        0,
    )
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
    return main()


def run(monkeypatch: pytest.MonkeyPatch, folder: Path, frames: list[Bytes]) -> int:
    (folder / "frames").mkdir(parents=True)
    cv2.imwrite(str(folder / "flat.png"), untouched())
    for number, frame in enumerate(frames):
        cv2.imwrite(str(folder / "frames" / f"{number}.png"), frame)
    return command(monkeypatch, folder, folder / "frames")


def test_no_map_at_all_is_no_success(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    black = np.zeros_like(untouched())
    assert run(monkeypatch, tmp_path / "none", [black, black]) == 2
    assert (tmp_path / "none" / "out" / "depth.csv").read_text().count("black") == 2
    assert run(monkeypatch, tmp_path / "one", [untouched(), black]) == 0
    assert command(monkeypatch, tmp_path / "one", tmp_path / "one" / "frames" / "0.png") == 0, "one picture alone"
    assert (tmp_path / "one" / "out" / "depth.csv").read_text().count("\n") == 2


def said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> str:
    monkeypatch.setattr(sys, "argv", ["tactilevision", "depth", *map(str, words)])
    assert main() == 2
    return capsys.readouterr().err.splitlines()[-1]


def test_a_bad_reference_is_named_with_the_option_for_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No word of reference/flat, which a bare folder does not have."""
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((240, 320, 3), 255, np.uint8))
    told = said(monkeypatch, capsys, tmp_path, "--sensor", "gelslim3", "--out", tmp_path / "out")
    assert f"{tmp_path / '0.png'}: most of the reference is saturated" in told
    assert "with --reference" in told
    assert "reference/flat" not in told
    assert not (tmp_path / "out").exists()
    sample = Path(__file__).parents[2] / "sample_frames" / "gelslim3"
    told = said(monkeypatch, capsys, sample, "--reference", tmp_path / "0.png", "--out", tmp_path / "out")
    assert f"{tmp_path / '0.png'}: the picture is 320 x 240, the others " in told


@each("scale", ["1e9", "1e-9", "nan", "inf", "-1", "0"])
def test_a_scale_out_of_all_reason_is_refused(
    scale: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = said(monkeypatch, capsys, tmp_path, "--sensor", "gelslim3", f"--mm-per-px={scale}")
    assert "--mm-per-px: a scale lies between 0.0001 and 100 mm per pixel" in told
    assert "State a length on the gel in mm over its length in the picture" in told
    toml = tmp_path / "sensor.toml"
    toml.write_text(f'[sensor]\nkind = "custom"\nwidth_px = 32\nheight_px = 24\nmm_per_px = {float(scale)}\n')
    cv2.imwrite(str(tmp_path / "0.png"), untouched())
    assert "[sensor] mm_per_px" in said(monkeypatch, capsys, tmp_path, "--sensor", toml)
    with pytest.raises(InputError, match=r"between 0\.0001 and 100"):
        read_folder(tmp_path, "gelslim3", mm_per_px=float(scale))
    with pytest.raises(InputError, match=r"between 0\.0001 and 100"):
        get_sensor("gelslim3", mm_per_px=float(scale))


def test_more_pictures_than_frames_are_all_of_them(tmp_path: Path) -> None:
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), untouched())
    recording = read_folder(tmp_path, "gelslim3", reference=tmp_path / "0.png")
    assert strongest_frames(recording, [0.1, 0.3, 0.2], most=10**26) == [0, 1, 2]


def test_a_method_that_was_trained_anew_is_another_way_to_read(tmp_path: Path) -> None:
    chosen, card = Choice(method=str(tmp_path / "method.npz")), tmp_path / "method.json"
    card.write_text('{"sha256": "1"}')
    before = chosen.way
    assert chosen.way == before
    assert replace(chosen, mm_per_px=0.05).way != before
    card.write_text('{"sha256": "2"}')
    assert chosen.way != before
    assert Choice(method="lookup").way != Choice(method="polynomial").way


def test_the_command_that_keeps_a_light_of_own_balls_is_named() -> None:
    recording = read_recording(SAMPLE)
    (said,) = how_to_keep_light(Choice(), recording)
    assert said.endswith(f"tactilevision calibrate-sensor {SAMPLE}")
    assert how_to_keep_light(Choice(method="light.npz"), recording) == []
    assert how_to_keep_light(Choice(), replace(recording, balls=())) == []


def test_a_narrow_strip_becomes_maps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Narrower than the border within which colours are not held against the light."""
    (tmp_path / "frames").mkdir()
    for number, seen in enumerate((untouched(), untouched()[::-1])):
        cv2.imwrite(str(tmp_path / "frames" / f"{number}.png"), cv2.resize(seen, (12, 400)))
    words = ("depth", tmp_path / "frames", "--sensor", "digit", "--mm-per-px", "0.06", "--workers", "1")
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, words), "--out", str(tmp_path / "out")])
    assert main() == 0
    assert "2 of 2 frames became height maps" in capsys.readouterr().out
