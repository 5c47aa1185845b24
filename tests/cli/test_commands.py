"""The command line as a user meets it: exit codes, one clear line for a fault, silence when piped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tactilevision.cli import main

ROOT = Path(__file__).parents[2]
PAPER = ROOT / "sample_frames" / "paper_points"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, arguments)])
    return main()


def test_the_papers_points_give_the_papers_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """c = 3.4943, beta = 1.5071, nu = .4797, E = .1988 (printed as .1981), after eqs. 1-5 of the paper."""
    assert (
        run(monkeypatch, "calibrate", PAPER, "--law", "paper", "--out", tmp_path, "--json", tmp_path / "r.json")
        == 0
    )
    result = json.loads((tmp_path / "calibration.json").read_text())
    assert result["c_N_per_mm"]["value"] == pytest.approx(3.4943, abs=2e-4)
    assert result["beta"]["value"] == pytest.approx(1.5071, abs=3e-4)
    assert result["poisson_ratio"]["value"] == pytest.approx(0.4797, abs=1e-4)
    assert result["youngs_modulus_MPa"]["value"] == pytest.approx(0.1988, abs=1e-4)
    assert result["poisson_ratio_source"] == "beta"
    assert json.loads((tmp_path / "r.json").read_text()) == result
    out = capsys.readouterr()
    assert "reproduction" in out.out
    assert "outside of what contact laws allow" in out.err
    assert "<img" in (tmp_path / "report.html").read_text()


def test_one_punch_does_not_fix_nu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, "calibrate", PAPER, "--out", tmp_path) == 0
    result = json.loads((tmp_path / "calibration.json").read_text())
    nu, modulus = result["poisson_ratio"], result["youngs_modulus_MPa"]
    assert nu["value"] is None
    assert nu["why"]
    assert modulus["interval95"][0] < 0.1915 < modulus["interval95"][1]
    curve = dict(map(tuple, result["youngs_modulus_of_nu"]))
    assert min(curve) <= 0.4797 <= max(curve)


def test_the_page_needs_no_second_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, "calibrate", PAPER, "--out", tmp_path) == 0
    text = (tmp_path / "report.html").read_text()
    assert "http" not in text.replace("http-equiv", "")
    assert "<script" not in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("calibrate", "nowhere"), "nowhere"),
        (("calibrate", PAPER, "--law", "magic"), "magic"),
        (("depth", PAPER), "frames"),
        (("view", PAPER / "points.csv"), "points.csv"),
        (("no-such-command",), "no-such-command"),
    ],
)
def test_bad_input_is_one_clear_message_and_exit_code_2(
    arguments: tuple[object, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, *arguments) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert "Traceback" not in captured.err
    assert captured.out == ""


def test_an_unwritable_place_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert run(monkeypatch, "calibrate", PAPER, "--out", tmp_path / "file" / "out") == 2
    assert "--out" in capsys.readouterr().err


def test_ctrl_c_leaves_the_old_results(tmp_path: Path) -> None:
    """Interrupted at whatever moment, a run leaves the earlier files byte for byte, and nothing half-written."""
    command = [sys.executable, "-m", "tactilevision.cli", "calibrate", str(PAPER), "--out", str(tmp_path)]
    subprocess.run(command, check=True, capture_output=True)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    for delay in (0.3, 1.0, 2.0):
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=os.fspath(tmp_path)
        )
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)
        after = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
        if process.returncode != 0:
            assert after == before
        assert set(after) == set(before)
