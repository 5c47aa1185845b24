"""Results are whole or absent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tactilevision.errors import OutputError
from tactilevision.files import replacing, staged, write_json, write_text


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.txt"
    write_text(path, "old")
    with pytest.raises(KeyboardInterrupt), replacing(path) as temporary:
        temporary.write_text("half of the n")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_stage_leaves_the_old_results(tmp_path: Path) -> None:
    with staged(tmp_path) as stage:
        write_text(stage / "a.txt", "old a")
        write_text(stage / "sub" / "b.txt", "old b")
    with pytest.raises(KeyboardInterrupt), staged(tmp_path) as stage:
        write_text(stage / "a.txt", "new a")
        raise KeyboardInterrupt
    assert (tmp_path / "a.txt").read_text() == "old a"
    assert (tmp_path / "sub" / "b.txt").read_text() == "old b"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "sub"]


def test_json_has_no_nan_and_knows_numpy(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    write_json(path, {"a": np.float64("nan"), "b": np.arange(3), "c": (1.5, float("inf"))})
    assert json.loads(path.read_text()) == {"a": None, "b": [0, 1, 2], "c": [1.5, None]}


def test_a_refusing_file_system_is_one_clear_error(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(OutputError, match=r"file.*cannot be written.*--out"):
        write_text(blocked / "result.txt", "x")
    with pytest.raises(OutputError, match="cannot be written"), staged(blocked):
        pass
