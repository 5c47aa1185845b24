"""Results are whole or absent."""

from __future__ import annotations

import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from tactilevision.errors import OutputError
from tactilevision.files.writing import append_text, make_folder, replacing, staged, write_json, write_text


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.txt"
    write_text(path, "old")
    with pytest.raises(KeyboardInterrupt), replacing(path) as temporary:
        temporary.write_text("half of the n")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_no_file_takes_the_place_of_a_pipe_a_device_or_a_stream(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    (tmp_path / "link").symlink_to("/dev/null")
    for path in (pipe, tmp_path / "link", Path("/dev/stdout"), Path("/dev/fd/1"), tmp_path):
        before = path.lstat()
        with pytest.raises(OutputError, match="can be replaced"):
            write_text(path, "x")
        assert os.path.samestat(path.lstat(), before)


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


def test_an_interruption_among_the_moves_does_not_part_the_results(tmp_path: Path) -> None:
    """It comes after the first of three files is in its place: the others follow before it is heard."""
    calls, replace = [0], Path.replace

    def once(path: Path, target: Path) -> Path:
        calls[0] += 1
        if calls[0] == 2:
            raise KeyboardInterrupt
        return replace(path, target)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt), staged(tmp_path) as stage:
        for name in ("a", "b", "c"):
            (stage / name).write_text(name)
        patch.setattr(Path, "replace", once)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c"]


def test_json_has_no_nan_and_knows_numpy(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    write_json(path, {"a": np.float64("nan"), "b": np.arange(3), "c": (1.5, float("inf"))})
    assert json.loads(path.read_text()) == {"a": None, "b": [0, 1, 2], "c": [1.5, None]}


def test_bytes_of_a_name_that_are_no_text_are_written_escaped(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9")
    write_text(tmp_path / "a.csv", f"{name}\n")
    append_text(tmp_path / "a.csv", name)
    assert (tmp_path / "a.csv").read_text() == "caf\\udce9\n" + "caf\\udce9"


def test_a_refusing_file_system_is_one_clear_error(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(OutputError, match=r"file.*cannot be written.*--out"):
        write_text(blocked / "result.txt", "x")
    with pytest.raises(OutputError, match="cannot be written"), staged(blocked):
        pass


def test_numpy_s_word_for_a_full_disk_is_told_as_one(tmp_path: Path) -> None:
    with (
        pytest.raises(OutputError, match=r"5 requested and 3 written\. Free some space"),
        replacing(tmp_path / "a"),
    ):
        raise OSError("5 requested and 3 written")
    with pytest.raises(OutputError, match=r"no such driver\. Choose another folder"), replacing(tmp_path / "a"):
        raise OSError("no such driver")
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_takes_no_results_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="cannot be written"):
        make_folder(tmp_path / "file" / "deeper")
    with pytest.raises(OutputError, match="cannot be written"):
        append_text(tmp_path / "nothing", "line")


def test_an_error_of_a_worker_says_the_same_here() -> None:
    sent = OutputError("cannot be written: it is full", where="disk", value=(1, 2), remedy="Free some space.")
    came = pickle.loads(pickle.dumps(sent))  # noqa: S301 -- our own bytes
    assert type(came) is OutputError
    assert str(came) == str(sent)
    assert (came.what, came.where, came.value, came.remedy) == (sent.what, sent.where, sent.value, sent.remedy)
