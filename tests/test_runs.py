"""One run at a time in a folder of results: the second is told, and a killed run never stands in the way."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from each import each

from tactilevision.cli import main
from tactilevision.errors import OutputError, Terminated
from tactilevision.files.runs import LOCK, output_lock

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_frames"
HOLD = "import sys, time; from tactilevision.files.runs import output_lock\nwith output_lock(sys.argv[1]):\n  "


@contextmanager
def another_process(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that holds the folder until it is killed."""
    command = [sys.executable, "-c", HOLD + "print('held', flush=True); time.sleep(60)", str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_second_process_is_told_who_writes_and_since_when(tmp_path: Path) -> None:
    with another_process(tmp_path) as first:
        said = rf"is being written by process {first.pid} since \d\d:\d\d. Wait for it, or give another --out"
        with pytest.raises(OutputError, match=said), output_lock(tmp_path):
            pass
        assert [path.name for path in tmp_path.iterdir()] == [LOCK]


def test_a_killed_process_leaves_nothing_that_blocks_or_stays(tmp_path: Path) -> None:
    with another_process(tmp_path) as first:
        (tmp_path / "figures").mkdir()
        (tmp_path / "figures" / f".unfinished-{first.pid}-x.png").write_bytes(b"half")
    with output_lock(tmp_path):
        assert (tmp_path / LOCK).read_text().split()[0] == str(os.getpid())
        assert list((tmp_path / "figures").iterdir()) == []
    assert [path.name for path in tmp_path.iterdir()] == ["figures"]


def test_a_run_that_ends_early_takes_along_what_its_workers_left(tmp_path: Path) -> None:
    worker = subprocess.Popen([sys.executable, "-c", ""])
    worker.wait()
    with pytest.raises(Terminated), output_lock(tmp_path):
        (tmp_path / "depth").mkdir()
        (tmp_path / "depth" / "1.tiff").write_bytes(b"whole")
        (tmp_path / "depth" / f".unfinished-{worker.pid}-x.tiff").write_bytes(b"half")
        raise Terminated
    assert [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.tiff")] == ["depth/1.tiff"]


def test_a_run_into_one_file_that_fails_leaves_what_lies_beside_it(tmp_path: Path) -> None:
    """Of a process on another machine nobody here knows whether it still writes."""
    elsewhere = subprocess.Popen([sys.executable, "-c", ""])
    elsewhere.wait()
    half = tmp_path / f".unfinished-{elsewhere.pid}-x.tvs"
    with pytest.raises(Terminated), output_lock(tmp_path / "a.tvs", file=True):
        half.write_bytes(b"half")
        raise Terminated
    assert list(tmp_path.iterdir()) == [half]


def test_a_second_thread_is_refused_and_the_first_may_ask_again(tmp_path: Path) -> None:
    refused: list[OutputError] = []

    def second() -> None:
        try:
            with output_lock(tmp_path):
                pass
        except OutputError as fault:
            refused.append(fault)

    with output_lock(tmp_path), output_lock(tmp_path):
        thread = threading.Thread(target=second)
        thread.start()
        thread.join()
    assert [f"process {os.getpid()} " in str(fault) for fault in refused] == [True]
    second()
    assert len(refused) == 1


def test_threads_that_take_turns_never_meet(tmp_path: Path) -> None:
    """Many take and give the lock at a time: between two of them its file is removed and made anew."""
    inside, met, done = [0], [], [0]

    def work() -> None:
        until = time.monotonic() + 0.5
        while time.monotonic() < until:
            try:
                with output_lock(tmp_path):
                    inside[0] += 1
                    met.append(inside[0])
                    time.sleep(0.0005)
                    inside[0] -= 1
                    done[0] += 1
            except OutputError:
                time.sleep(0.0002)

    threads = [threading.Thread(target=work) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert done[0] > 20
    assert set(met) == {1}


def test_without_flock_the_number_of_the_process_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactilevision.files.runs._flock", lambda handle, *, shared: None)
    with another_process(tmp_path), pytest.raises(OutputError, match="being written"), output_lock(tmp_path):
        pass
    with output_lock(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_which_nothing_was_written_is_taken_away(tmp_path: Path) -> None:
    with output_lock(tmp_path / "a" / "b"):
        pass
    assert list(tmp_path.iterdir()) == []
    with output_lock(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "result").write_text("x")
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["result"]


def test_two_files_of_one_folder_are_written_at_a_time(tmp_path: Path) -> None:
    with another_process(tmp_path), output_lock(tmp_path / "one.npz", file=True):
        assert (tmp_path / f".one.npz{LOCK}").exists()


@each(
    "words",
    [
        ["depth", "{gelslim3}", "--out", "{out}"],
        ["depth", "{gelslim3}", "--format", "zarr", "--out", "{out}"],
        ["force", "{gelslim3}", "--calibration", "{toml}", "--out", "{out}"],
        ["calibrate", "{points}", "--out", "{out}"],
        ["diagnose", "{points}", "--out", "{out}"],
        ["compare", "{points}", "--out", "{out}"],
        ["steps", "{out}", "--undo"],
        ["validate", "{points}", "--out", "{out}"],
        ["view", "{gelslim3}", "--out", "{out}"],
        ["tabulate", "{out}"],
        ["simulate", "{out}"],
        ["train", "{gelslim3}", "--out", "{out}/method.npz"],
    ],
)
def test_every_command_that_writes_refuses_a_folder_that_is_being_written(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    gelslim3, out = SAMPLES / "gelslim3", tmp_path / "out"
    places = {"gelslim3": gelslim3, "toml": gelslim3 / "recording.toml", "points": SAMPLES / "paper_points"}
    monkeypatch.setattr(sys, "argv", ["tactilevision", *(word.format(out=out, **places) for word in words)])
    held = threading.Event()
    over = threading.Event()

    def first() -> None:
        file = words[0] == "train"
        with output_lock(out / "method.npz" if file else out, file=file):
            held.set()
            over.wait(60)

    thread = threading.Thread(target=first)
    thread.start()
    held.wait(60)
    try:
        assert main() == 2
        assert len(list(out.iterdir())) == 1, "something was written"
    finally:
        over.set()
        thread.join()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"is being written by process {os.getpid()} since" in said
