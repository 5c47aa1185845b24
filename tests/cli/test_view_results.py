"""`view` on what `depth` has written: a folder of maps, by name or the deepest, with their deviation."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactilevision.batch.folder import FrameResult, table
from tactilevision.cli import main
from tactilevision.files.tiff import write_tiff
from tactilevision.plots import style
from tactilevision.plots.viewer import Window
from tactilevision.records.maps import HeightMap

SCALE = (0.1, 0.1)
DEPTHS_MM = {"a": 0.1, "b ü": 0.4, "c": 0.2}


@pytest.fixture
def results(tmp_path: Path) -> Path:
    rows = []
    for name, deep in DEPTHS_MM.items():
        depth = np.full((12, 16), deep, np.float32)
        whole = HeightMap(depth, np.ones(depth.shape, np.bool_), SCALE)
        write_tiff(tmp_path / "r" / "depth" / f"{name}.tiff", whole)
        write_tiff(tmp_path / "r" / "depth_std" / f"{name}.tiff", HeightMap(0.1 * depth, whole.valid, SCALE))
        rows.append(FrameResult(f"{name}.jpg", "ok", deep, 0.0, 1.0, 0.01))
    rows.append(FrameResult("d.jpg", "unreadable: the picture is empty"))
    (tmp_path / "r" / "depth.csv").write_text(table(rows), encoding="utf-8")
    return tmp_path / "r"


def run(*words: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        return main()


@pytest.mark.parametrize("where", ["", "depth"])
def test_the_deepest_is_shown_where_none_is_named(results: Path, tmp_path: Path, where: str) -> None:
    assert run("view", results / where, "--out", tmp_path / "v", "--minus", "a.jpg") == 0
    names = {path.name for path in (tmp_path / "v").iterdir()}
    assert names == {"b ü_depth.png", "b ü_surface.png", "b ü_normals.png", "b ü_minus_a.png"}


def test_a_window_leafs_through_the_maps_with_their_deviation(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Any] = []

    class Kept(Window):
        def __init__(self, *given: Any, **named: Any) -> None:
            super().__init__(*given, **named)
            shown.append(self)

    monkeypatch.setattr("tactilevision.plots.viewer.Window", Kept)
    monkeypatch.setattr(style, "check_screen", lambda: None)
    monkeypatch.setattr(style, "show", lambda figures, title: None)
    assert run("view", results, "--out", tmp_path / "v", "--window", "--frame", "c.jpg") == 0
    (opened,) = shown
    assert [opened.number, opened.names] == [2, ["a.tiff", "b ü.tiff", "c.tiff"]]
    opened.go(1)
    assert opened.height.depth_mm.max() == np.float32(0.4)
    assert opened.height.std_mm.max() == pytest.approx(0.04)


def test_a_map_that_is_not_there_and_what_needs_frames_are_told(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, said in (
        (("--frame", "d"), "has no such map (got 'd'). It has a.tiff to c.tiff"),
        (("--film", "all"), "a film needs frames"),
        (("--terms",), "Name a frame of a recording"),
    ):
        assert run("view", results, "--out", tmp_path / "v", *words) == 2
        assert said in capsys.readouterr().err


def test_no_screen_is_told_before_anything_is_drawn(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("matplotlib.pyplot.get_backend", lambda: "agg")
    assert run("view", results, "--out", tmp_path / "v", "--window") == 2
    assert "there is no screen" in capsys.readouterr().err
    assert not (tmp_path / "v").exists()
