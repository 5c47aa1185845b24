"""`view` on the sample: pictures, a difference, exports and a film; wrong names are named."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_scenes import sample_method

from tactilevision.cli import main
from tactilevision.files.tiff import write_tiff
from tactilevision.plots import style, viewer as window
from tactilevision.plots.viewer import Window
from tactilevision.records.maps import HeightMap

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "gelslim3"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["tactilevision", "view", *map(str, arguments)])
    return main()


def test_a_frame_is_drawn_compared_exported_and_filmed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Window] = []

    class Kept(Window):
        def __init__(self, *given: Any, **named: Any) -> None:
            super().__init__(*given, **named)
            opened.append(self)

    monkeypatch.setattr(window, "Window", Kept)
    monkeypatch.setattr(style, "check_screen", lambda: None)
    monkeypatch.setattr(style, "show", lambda figures, title: None)
    out = tmp_path / "out"
    wanted = (
        "--frame",
        "00296",
        "--minus",
        "00290.jpg",
        "--film",
        "00294:00297",
        "--export",
        "vtk",
        "--terms",
        "--html",
        "--window",
        "--export",
        "tiff",
    )
    assert run(monkeypatch, SAMPLE, "--method", sample_method(), "--out", out, *wanted) == 0
    names = {path.name for path in out.iterdir()}
    drawn = {f"00296_{what}.png" for what in ("depth", "surface", "normals", "frame", "terms", "minus_00290")}
    assert drawn | {"00296.vtk", "00296.tiff", "00296.html"} <= names
    assert any(name.startswith("film_00294-00297") for name in names)
    _check_window(*opened)
    assert run(monkeypatch, out / "00296.tiff", "--minus", out / "00296.tiff", "--out", tmp_path / "two") == 0


def test_a_window_without_a_screen_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, _tiff(tmp_path), "--out", tmp_path, "--window") == 2
    assert "no screen" in capsys.readouterr().err


def _check_window(shown: Window) -> None:
    assert len(shown.names) > 10
    assert shown.map.get_title(loc="left").startswith("00296.jpg: depth minus that of 00290.jpg")
    shown.go(shown.number - 1)
    assert shown.height.name == "00295.jpg"


def _tiff(folder: Path) -> Path:
    depth = HeightMap(np.full((20, 30), 0.1, np.float32), np.ones((20, 30), np.bool_), (0.1, 0.1), name="a")
    write_tiff(folder / "a.tiff", depth)
    return folder / "a.tiff"


def test_a_depth_tiff_has_no_terms_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, _tiff(tmp_path), "--out", tmp_path, "--terms") == 2
    assert "calibrated on balls" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(("--frame", "x9"), "x9"), (("--film", "press 99"), "no such press"), (("--export", "stl"), "vtk")],
)
def test_wrong_names_are_one_clear_line(
    arguments: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(monkeypatch, SAMPLE, "--out", tmp_path, *arguments) == 2
    assert said in capsys.readouterr().err
