"""The command that makes tables: killed and gone on with, on a tiny grid, and what it says to bad options."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from made_tables import made_up

from tactilevision.cli import main
from tactilevision.errors import InputError
from tactilevision.mechanics.tables import solve as method
from tactilevision.mechanics.tables.cases import Grid, case_path, load_case
from tactilevision.mechanics.tables.table import merge, read_table

ROOT = Path(__file__).parents[3]
TINY = (
    "--law",
    "neo-hooke",
    "--friction",
    "inf",
    "--poisson-ratio",
    "0.3,0.4",
    "--a-over-h",
    "0.4,0.6",
    "--edge-over-h",
    "0.1",
)


def start(out: Path, *options: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "tactilevision", "tabulate", str(out), *TINY, *options],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    run = start(tmp_path, "--workers", "1")
    until = time.monotonic() + 120
    while not list(tmp_path.glob("cases/neo*.npz")) and time.monotonic() < until and run.poll() is None:
        time.sleep(0.01)
    os.kill(run.pid, signal.SIGKILL)
    run.communicate()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("cases/neo*.npz")}
    assert before
    assert not (tmp_path / "punch.npz").exists()
    again = start(tmp_path, "--workers", "2", "--json", str(tmp_path / "result.json"))
    _, said = again.communicate(timeout=200)
    assert again.returncode == 0, said.decode()
    assert json.loads((tmp_path / "result.json").read_text())["solved_now"] == 4 - len(before)
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())
    table = read_table(tmp_path / "punch.npz")
    assert table.blocks[0].stiffness.shape[:2] == (2, 2)
    assert np.isfinite(table.blocks[0].stiffness[:, :, 5]).all()
    lines = (tmp_path / "punch.csv").read_text().splitlines()
    assert len(lines) == 5
    assert lines[1].startswith("neo-hooke,no slip,0.1,0.3,0.4,")


def test_every_case_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = Grid(laws=("hencky",), frictions=(0.0, 0.3), edges_over_h=(1 / 60,))
    cases = list(grid.cases())
    monkeypatch.setattr(method, "solve_case", made_up)
    told: list[tuple[int, int]] = []
    assert method.tabulate(cases[:40], tmp_path, report=lambda *counts: told.append(counts)) == 40
    assert told == [(done, 40) for done in range(1, 41)]
    missing = merge(cases, tmp_path, out=tmp_path / "t.npz", notes={"mesh_error": 0.001})
    assert len(missing) == 32
    table = read_table(tmp_path / "t.npz")
    assert [block.friction for block in table.blocks] == [0.0]
    assert table.card["mesh_error"] == 0.001
    assert method.tabulate(cases, tmp_path) == 32
    assert merge(cases, tmp_path, out=tmp_path / "t.npz", notes={}) == []
    again = load_case(case_path(tmp_path, cases[0]))
    np.testing.assert_array_equal(again.u_z, made_up(cases[0]).u_z)


def test_merging_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no block"):
        merge(Grid().cases(), tmp_path, out=tmp_path / "t.npz", notes={})


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--poisson-ratio", "0.3,0.5"), "0.4999"),
        (("--poisson-ratio", "-0.1"), "--poisson-ratio"),
        (("--a-over-h", "wide"), "commas"),
        (("--law", "gent"), "Known are neo-hooke"),
        (("--friction", "-1"), "--friction"),
        pytest.param(("--cluster", "tcp://127.0.0.1:1"), "--cluster", marks=pytest.mark.slow),
    ],
)
def test_bad_options_are_one_clear_message(
    options: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["tactilevision", "tabulate", str(tmp_path), *options])
    assert main() == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.glob("*.npz"))
