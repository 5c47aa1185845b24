"""Folders of results may be another's: links, second names and pipes in them lead nothing out of them."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from each import each

from tactilevision.batch.folder import MAPS
from tactilevision.cli import main
from tactilevision.errors import OutputError
from tactilevision.files.runs import LOCK, join_lock, output_lock
from tactilevision.files.writing import (
    append_text,
    copy_own,
    make_folder,
    remove,
    replacing,
    staged,
    write_text,
    writes_into,
)
from tactilevision.files.zarr_store import begin_frames, write_frame

ROOT = Path(__file__).parents[2]
PAPER = ROOT / "sample_frames" / "paper_points"
HELD = "what another file holds"

Trap = Callable[[Path, Path], object]  # what lies where a file of results is written, given another file
TRAPS: list[tuple[str, Trap]] = [
    ("a link", lambda place, victim: place.symlink_to(victim)),
    ("a second name", lambda place, victim: os.link(victim, place)),
    ("a link to nowhere", lambda place, victim: place.symlink_to(victim.with_name("nowhere"))),
    ("a link to itself", lambda place, victim: place.symlink_to(place)),
    ("a pipe", lambda place, victim: os.mkfifo(place)),
    ("a device", lambda place, victim: place.symlink_to("/dev/full")),
    ("a folder", lambda place, victim: place.mkdir()),
]


def victim_of(folder: Path) -> Path:
    victim = folder / "victim"
    victim.write_text(HELD)
    return victim


@each("trap", [trap for _, trap in TRAPS])
def test_a_trap_in_place_of_the_lock_is_refused_and_nothing_is_written(trap: Trap, tmp_path: Path) -> None:
    victim, out = victim_of(tmp_path), tmp_path / "out"
    out.mkdir()
    trap(out / LOCK, victim)
    with pytest.raises(OutputError, match=r"\.lock: is (a link|no file)|cannot be written"), output_lock(out):
        pass
    with pytest.raises((OutputError, OSError)):
        assert join_lock(out)
    assert victim.read_text() == HELD
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "victim"]


@pytest.mark.parametrize("command", [["steps"], ["calibrate", str(PAPER), "--out"], ["simulate"]])
def test_a_command_names_the_lock_that_is_a_link(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    victim = victim_of(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / LOCK).symlink_to(victim)
    monkeypatch.setattr(sys, "argv", ["tactilevision", *command, str(tmp_path / "out")])
    assert main() == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert victim.read_text() == HELD


@each("trap", [trap for _, trap in TRAPS])
def test_what_is_appended_or_copied_follows_no_trap(trap: Trap, tmp_path: Path) -> None:
    victim = victim_of(tmp_path)
    trap(tmp_path / "live.csv", victim)
    with pytest.raises(OutputError):
        append_text(tmp_path / "live.csv", "x")
    with pytest.raises(OutputError):
        copy_own(tmp_path / "live.csv", tmp_path / "public")
    assert victim.read_text() == HELD
    assert not (tmp_path / "public").exists()


@each("trap", [trap for _, trap in TRAPS[:4]])
def test_a_file_replaces_the_trap_itself(trap: Trap, tmp_path: Path) -> None:
    victim, place = victim_of(tmp_path), tmp_path / "report.html"
    trap(place, victim)
    write_text(place, "new")
    assert (place.read_text(), victim.read_text()) == ("new", HELD)
    assert not place.is_symlink()


def _staged(out: Path, link: Path) -> None:
    with staged(out) as stage:
        write_text(stage / "a.txt", "new")
        write_text(stage / link.name / "b.txt", "new")


def _zarr(out: Path, link: Path) -> None:
    begin_frames(link / "store", ["a"], fields={"depth": "mm"}, shape=(2, 2), about={})


def _chunk(out: Path, link: Path) -> None:
    begin_frames(out / "store", ["a"], fields={"depth": "mm"}, shape=(2, 2), about={})
    (out / "store" / "depth").rename(link.resolve() / "depth")
    (out / "store" / "depth").symlink_to(link.resolve() / "depth")
    write_frame(out / "store", 0, fields={"depth": np.zeros((2, 2), np.float32)})


@each(
    "act",
    [
        lambda out, link: write_text(link / "b.txt", "new"),
        lambda out, link: make_folder(link),
        lambda out, link: remove(link / "kept"),
        lambda out, link: append_text(link / "kept", "x"),
        lambda out, link: copy_own(link / "kept", out / "public"),
        _staged,
        _zarr,
        _chunk,
    ],
)
def test_a_folder_of_the_results_that_is_a_link_is_refused(
    act: Callable[[Path, Path], None], tmp_path: Path
) -> None:
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    out.mkdir()
    (elsewhere / "kept").write_text(HELD)
    (out / MAPS).symlink_to(elsewhere)
    with pytest.raises(OutputError, match="a folder of the results is a link"), writes_into(out):
        act(out, out / MAPS)
    assert (elsewhere / "kept").read_text() == HELD
    assert {path.name for path in elsewhere.rglob("*")} <= {"kept", "depth", ".zarray", ".zattrs"}
    assert not (out / "a.txt").exists(), "nothing of the results is moved"
    assert not (out / "public").exists()


def test_a_folder_of_results_may_be_a_link_itself(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    with output_lock(tmp_path / "out"), staged(tmp_path / "out") as stage:
        write_text(stage / "depth" / "a.txt", "new")
    assert (tmp_path / "disk" / "depth" / "a.txt").read_text() == "new"


def test_no_result_is_moved_where_one_cannot_be(tmp_path: Path) -> None:
    """A folder of the name of a file, which a rename refuses."""
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"report\.html: is not a file"), staged(tmp_path) as stage:
        write_text(stage / "calibration.json", "{}")
        write_text(stage / "report.html", "new")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_a_name_with_a_nul_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="holds a NUL"), replacing(tmp_path / "a\0b"):
        pass


WRITES = {"write_text", "write_bytes", "touch", "mkdir", "makedirs", "mkdtemp", "mkstemp", "unlink", "rmdir",
          "rmtree", "rename", "renames", "symlink_to", "hardlink_to", "copyfile", "copytree", "copy2", "savefig",
          "imwrite", "to_csv", "to_parquet", "savetxt", "tofile", "VideoWriter", "ParquetWriter"}  # fmt: skip


def direct_writes(path: Path) -> list[str]:
    """Calls that change files without `tactilevision.files`: not on its `temporary`, or a `file` there."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ast.unparse(node.func)
        method = isinstance(node.func, ast.Attribute)
        if name not in {*WRITES, "open", "replace", "dump"} and not name.startswith("save"):
            continue
        said = ast.unparse(node)
        texts = {
            one.value for one in ast.walk(node) if isinstance(one, ast.Constant) and isinstance(one.value, str)
        }
        opens = name == "open" and any(set(text) & set("wax+") and set(text) <= set("wxabt+") for text in texts)
        if (
            (method and name in WRITES) or opens or said.startswith(("np.save", "os.replace", "json.dump("))
        ) and not ("temporary" in said or "(file, " in said or said.startswith("self.write_")):
            found.append(f"{path.relative_to(ROOT)}:{node.lineno} {said[:80]}")
    return found


def test_only_the_files_package_writes_files() -> None:
    sources = [path for name in ("tactilevision", "calibration") for path in (ROOT / name).rglob("*.py")]
    others = [path for path in sources if path.parent != ROOT / "tactilevision" / "files"]
    assert [line for path in others for line in direct_writes(path)] == []
    assert len(direct_writes(ROOT / "tactilevision" / "files" / "writing.py")) > 5, "the rule finds what writes"


def test_circles_of_links_are_resolved_without_an_error() -> None:
    """`Path.resolve` raises RuntimeError for one before Python 3.13; files.opening.real_path does not."""
    sources = [path for name in ("tactilevision", "calibration") for path in (ROOT / name).rglob("*.py")]
    assert [str(path) for path in sources if ".resolve()" in path.read_text()] == []


KINDS = ("loop", "pipe", "loop/x", "n" * 300)
INTO = [["calibrate", str(PAPER), "--out"], ["diagnose", str(PAPER), "--out"], ["compare", str(PAPER), "--out"],
        ["simulate"], ["tabulate"], ["validate", str(PAPER), "--out"],
        ["passport", str(PAPER), "--out"], ["view", str(PAPER), "--out"],
        ["depth", str(PAPER), "--out"], ["force", str(PAPER), "--out"], ["steps"],
        ["import", "x.mcap", "--frames", "/a", "--out"]]  # fmt: skip
FROM = [["calibrate"], ["passport"], ["depth"], ["view"], ["diagnose"], ["compare"], ["live", "--camera"],
        ["force"],
        ["import", "--out", "o"], ["export", "--out", "x.mcap"], ["plan"],
        ["train", "--method", "polynomial", "--out", "o"], ["calibrate-sensor", "--out", "o.tvs"], ["validate"],
        ["lerobot", "--camera", "c", "--sensor", "s.tvs", "--out", "o"], ["export-material", "--to", "drake"],
        ["depth", str(PAPER), "--sensor"], ["depth", str(PAPER), "--reference"], ["depth", str(PAPER), "--method"],
        ["force", str(PAPER), "--calibration"], ["diagnose", str(PAPER), "--effect"]]  # fmt: skip


@each("command", [*INTO, *FROM])
def test_odd_paths_are_one_sentence(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for suffix in ("", ".py"):
        (tmp_path / f"loop{suffix}").symlink_to(f"loop{suffix}")
        os.mkfifo(tmp_path / f"pipe{suffix}")
    for kind in KINDS:
        name = f"{kind}.py" if command[-1] == "--effect" and kind in ("loop", "pipe") else kind
        monkeypatch.setattr(sys, "argv", ["tactilevision", *command, name])
        assert main() == 2, (command, kind)
        said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("warning: ")]
        assert len(said) == 1, (command, kind, said)
        assert said[0].startswith("error: ")


KILLED = """
import os, signal, sys
from pathlib import Path
from tactilevision.files.runs import output_lock
from tactilevision.files.writing import replacing
with output_lock(Path(sys.argv[1]), file=True), replacing(sys.argv[1]) as temporary:
    temporary.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_writer_of_one_file_left_is_removed_by_the_next(tmp_path: Path) -> None:
    out = tmp_path / "log.mcap"
    subprocess.run(
        [sys.executable, "-c", KILLED, str(out)], env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False
    )
    assert len(list(tmp_path.iterdir())) == 2
    with output_lock(out, file=True):
        pass
    assert list(tmp_path.iterdir()) == []
