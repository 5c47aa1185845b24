"""Trees of recordings, folders and videos; runs that are killed outright go on where they were."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import zarr
from test_depth_folder import SENSOR, RedIsSlope

from tactilevision.batch.folder import FrameResult, reconstruct_folder
from tactilevision.batch.tree import Branch, _table, find_sources, reconstruct_tree
from tactilevision.errors import InputError, OutputError, RecordingError
from tactilevision.files.tiff import read_tiff
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.folder import read_folder
from tactilevision.recording.model import Recording

ROOT = Path(__file__).parents[2]


def pictures(folder: Path, count: int) -> Path:
    folder.mkdir(parents=True)
    for number in range(count):
        rgb = np.full((48, 64, 3), 100, np.uint8)
        rgb[10:20, 20 : 24 + number % 30, 0] = 120
        cv2.imwrite(str(folder / f"{number:03d}.png"), rgb[..., ::-1])
    return folder


def mixed(root: Path) -> Path:
    """Pictures at the top and below, a video, a torn picture, a recording without a word, and an empty folder."""
    pictures(root, 2)
    pictures(root / "b" / "frames", 3)
    torn = pictures(root / "c" / "d", 3) / "001.png"
    torn.write_bytes(torn.read_bytes()[:60])
    video = cv2.VideoWriter(str(root / "e.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for number in range(4):
        video.write(np.full((48, 64, 3), 90 + number, np.uint8))
    video.release()
    (root / "f").mkdir()
    (root / "f" / "recording.toml").write_text("format = 7")
    (root / "empty").mkdir()
    return root


def read(path: Path) -> Recording:
    if (path / "recording.toml").exists():
        raise RecordingError("speaks another format", where=path)
    return read_folder(path, SENSOR)


def light(_: Recording) -> Reconstructor:
    return Reconstructor(SENSOR, RedIsSlope())


def test_sources_are_found_and_nothing_inside_a_recording_or_the_results(tmp_path: Path) -> None:
    root = mixed(tmp_path / "in")
    pictures(root / "out" / "depth", 1)
    found = [path.relative_to(root).as_posix() for path in find_sources(root, leave=root / "out")]
    assert found == [".", "b", "c/d", "e.avi", "f"]
    with pytest.raises(InputError, match="no such folder"):
        find_sources(tmp_path / "nowhere")


def test_links_that_lead_back_are_not_followed(tmp_path: Path) -> None:
    root = tmp_path / "in"
    for name in ("a", "b"):
        pictures(root / name, 1)
    (root / "a" / "up").symlink_to(root)
    (root / "a" / "over").symlink_to(root / "b")
    (root / "b" / "over").symlink_to(root / "a")
    pictures(tmp_path / "elsewhere", 1)
    (root / "c").symlink_to(tmp_path / "elsewhere")
    found = [path.relative_to(root).as_posix() for path in find_sources(root)]
    assert found == ["a", "a/over", "b", "b/over", "c"]


def test_a_mixed_tree_becomes_maps_and_one_table(tmp_path: Path) -> None:
    root, out = mixed(tmp_path / "in"), tmp_path / "out"
    told: list[tuple[int, int]] = []
    branches = reconstruct_tree(
        root, out, read=read, light=light, workers=1, progress=lambda done, of, what: told.append((done, of))
    )
    assert [(branch.name, len(branch.rows)) for branch in branches] == [
        (".", 2),
        ("b", 3),
        ("c/d", 3),
        ("e.avi", 4),
        ("f", 0),
    ]
    assert "another format" in branches[-1].why
    assert told[-1] == (12, 12)
    assert told == sorted(told)
    with (out / "depth.csv").open() as file:
        status = {row["frame"]: row["status"] for row in csv.DictReader(file)}
    assert status["c/d/001.png"].startswith("unreadable")
    assert status["f"].startswith("passed over")
    assert sum(words == "ok" for words in status.values()) == 11
    assert read_tiff(out / "e.avi" / "depth" / "2.tiff").depth_mm.shape == (48, 64)
    assert not list(out.rglob(".depth*")), "nothing is left lying about"


def test_a_frame_s_row_stays_one_whatever_its_name_or_fault_holds() -> None:
    row = FrameResult("x\u2028y.png", "unreadable: a\nb\x85c")
    table = list(csv.reader(io.StringIO(_table([Branch("a", (row,))]), newline="")))
    assert [cells[:1] for cells in table[1:]] == [["a/x\u2028y.png"]]


def test_a_frame_of_another_size_and_a_link_to_nowhere_are_bad_frames_only(tmp_path: Path) -> None:
    root = tmp_path / "in"
    pictures(root / "a", 30)
    cv2.imwrite(str(root / "a" / "004.png"), np.full((20, 20, 3), 90, np.uint8))
    cv2.imwrite(str(root / "a" / "005.png"), np.full((48, 64), 90, np.uint8))
    (root / "a" / "000.png").unlink()
    (root / "a" / "000.png").symlink_to("nowhere.png")
    bomb = bytearray((root / "a" / "006.png").read_bytes())
    bomb[16:24] = struct.pack(">II", 100_000, 100_000)  # pixels that its header states
    (root / "a" / "006.png").write_bytes(bomb)
    for workers in (1, 2):
        (branch,) = reconstruct_tree(root, tmp_path / str(workers), read=read, light=light, workers=workers)
        bad = {row.frame: row.status for row in branch.rows if row.status != "ok"}
        assert len(branch.rows) == 30
        assert list(bad) == ["000.png", "004.png", "005.png", "006.png"]
        assert all(status.startswith("unreadable") for status in bad.values())
        assert "two sizes" in bad["004.png"]
        assert "beyond the limit" in bad["006.png"]


def test_results_that_cannot_be_written_end_in_one_line(tmp_path: Path) -> None:
    source = read_folder(pictures(tmp_path / "in", 2), SENSOR)
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="cannot be written"):
        reconstruct_folder(source, light(source), tmp_path / "file", workers=1)


def test_a_video_that_was_cut_is_told_of(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "whole.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for _ in range(20):
        video.write(rng.integers(0, 255, (48, 64, 3), dtype=np.uint8))
    video.release()
    whole = path.read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    recording = read_folder(tmp_path / "cut.avi", SENSOR)
    assert 0 < len(recording.frame_names) < 20
    assert "cut short" in recording.warnings[0]
    assert read_folder(path, SENSOR, guess=False).warnings == ()


def test_a_tree_without_frames_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    with pytest.raises(InputError, match="neither recordings"):
        reconstruct_tree(tmp_path / "in", tmp_path / "out", read=read, light=light)


def test_finished_branches_are_not_done_again(tmp_path: Path) -> None:
    root, out = mixed(tmp_path / "in"), tmp_path / "out"

    def stop(done: int, total: int, what: str) -> None:
        if done == 6:  # one frame into the third
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct_tree(root, out, read=read, light=light, workers=1, progress=stop)
    stamps = {path: path.stat().st_mtime_ns for path in out.rglob("*.tiff")}
    assert len(stamps) == 6
    asked: list[str] = []

    def seen(recording: Recording) -> Reconstructor:
        asked.append(recording.name)
        return light(recording)

    branches = reconstruct_tree(root, out, read=read, light=seen, workers=1)
    assert asked == ["d", "e.avi"]
    assert sum(len(branch.rows) for branch in branches) == 12
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps


def test_a_branch_whose_table_is_gone_or_whose_results_are_damaged_is_done_again(tmp_path: Path) -> None:
    root, out = mixed(tmp_path / "in"), tmp_path / "out"

    def stop(done: int, total: int, what: str) -> None:
        if done == 6:  # two branches are finished
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct_tree(root, out, read=read, light=light, workers=1, progress=stop)
    first, second = sorted(out.rglob(".depth-finished"))
    (first.parent / "depth.csv").unlink()
    second.write_text(second.read_text().replace('"status"', '"statue"'))
    branches = reconstruct_tree(root, out, read=read, light=light, workers=1)
    assert sum(len(branch.rows) for branch in branches) == 12
    assert all((path.parent / "depth.csv").exists() for path in (first, second))


def test_one_zarr_store_holds_what_the_tiffs_hold(tmp_path: Path) -> None:
    source = read_folder(mixed(tmp_path / "in") / "c" / "d", SENSOR)
    reconstruct_folder(source, light(source), tmp_path / "tiff", workers=1)
    rows = reconstruct_folder(source, light(source), tmp_path / "zarr", workers=1, form="zarr")
    assert [row.status == "ok" for row in rows] == [True, False, True]
    group = zarr.open_group(str(tmp_path / "zarr" / "depth.zarr"), mode="r")
    assert list(group["frame"][:]) == list(source.frame_names)
    depth = np.asarray(group["depth_mm"])
    assert np.isnan(depth[1]).all(), "a frame that could not be read is not a flat one"
    for row in (0, 2):
        np.testing.assert_array_equal(
            depth[row], read_tiff(tmp_path / "tiff" / "depth" / f"{row:03d}.tiff").depth_mm
        )
    assert tuple(group.attrs["mm_per_px"]) == SENSOR.mm_per_px
    assert [p.name for p in (tmp_path / "zarr").iterdir() if p.name.startswith(".")] == []


SLOW = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_depth_folder import SENSOR, RedIsSlope
from tactilevision.batch.folder import reconstruct_folder
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.folder import read_folder

class Slow(RedIsSlope):
    def slopes(self, rgb):
        time.sleep(0.02)
        return super().slopes(rgb)

if __name__ == "__main__":
    source = read_folder(Path({frames!r}), SENSOR)
    reconstruct_folder(source, Reconstructor(SENSOR, Slow()), Path({out!r}), workers=2, form={form!r})
"""


@pytest.mark.parametrize("form", [pytest.param("tiff", marks=pytest.mark.slow), "zarr"])
@pytest.mark.slow
def test_killed_outright_it_goes_on_and_loses_nothing(tmp_path: Path, form: str) -> None:
    """kill -9 in mid-run, twice: workers end by themselves, no frame is lost, done twice or half-written."""
    frames, out = pictures(tmp_path / "in", 60), tmp_path / "out"
    script = tmp_path / "run.py"
    here = str(Path(__file__).parent)
    script.write_text(SLOW.format(tests=here, frames=str(frames), out=str(out), form=form))
    journal, done = out / ".depth-journal", 0
    for wanted in (10, 25):
        process = subprocess.Popen([sys.executable, script], cwd=ROOT)
        while done < wanted:
            assert process.poll() is None, "it was not killed but ended"
            time.sleep(0.01)
            done = _noted(journal)
        process.send_signal(signal.SIGKILL)
        process.wait()
        settled = _settled(journal)
        assert settled < 60
        done = settled
    before = _stamps(out)
    subprocess.run([sys.executable, script], cwd=ROOT, check=True)
    with (out / "depth.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["frame"] for row in rows] == [f"{number:03d}.png" for number in range(60)]
    assert {row["status"] for row in rows} == {"ok"}
    after = _stamps(out)
    again = sum(after[name] != stamp for name, stamp in before.items())
    assert again <= 2, "at most the one frame that each worker was at is done again"
    assert len(after) == 60
    shutil.rmtree(tmp_path / "in")


def _noted(journal: Path) -> int:
    return max(0, journal.read_text().count("\n") - 1) if journal.exists() else 0


def _settled(journal: Path) -> int:
    """Rows once the orphaned workers have ended: the count no longer grows."""
    count = -1
    while (now := _noted(journal)) != count:
        count = now
        time.sleep(0.3)
    return count


def _stamps(out: Path) -> dict[str, int]:
    """When each frame's map was written, wherever it lies."""
    chunks = [*out.glob("depth/*.tiff"), *out.glob("*depth.zarr*/depth_mm/[0-9]*.0.0")]
    return {os.path.basename(path): path.stat().st_mtime_ns for path in chunks if not path.name.startswith(".")}


def test_the_command_takes_a_tree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from tactilevision.cli import main

    root = tmp_path / "in"
    shutil.copytree(ROOT / "sample_frames" / "gelslim3" / "reference" / "flat", root / "frames_a")
    shutil.copytree(ROOT / "sample_frames" / "paper_points", root / "points")
    said = [
        "tactilevision",
        "depth",
        str(root),
        "--out",
        str(tmp_path / "out"),
        "--json",
        str(tmp_path / "r.json"),
    ]
    flat = sorted((root / "frames_a").iterdir())[0]
    monkeypatch.setattr(sys, "argv", [*said, "--sensor", "gelslim3", "--reference", str(flat)])
    assert main() == 0
    told = json.loads((tmp_path / "r.json").read_text())
    assert all(frame.startswith("frames_a/") for frame in told["bad"])
    assert told["statuses"]["ok"] == told["frames"] == len(list((root / "frames_a").iterdir()))
    assert "frames" in told["passed_over"]["points"]
    assert "passed over" in capsys.readouterr().out
