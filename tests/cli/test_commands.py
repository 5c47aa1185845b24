"""The command line as a user meets it: exit codes, one clear line for a fault, lines of progress when piped."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from each import each
from shared_scenes import calibrated_points
from typer.main import get_command

from calibration.result.result import NO_CLOCK
from tactilevision.cli import console, main
from tactilevision.cli.app import app
from tactilevision.pipeline import CertifiedRecording, calibrate_certified
from tactilevision.press.certificate import Certificate
from tactilevision.recording.read import read_recording

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
    assert "outside the range of contact laws" in out.err
    assert "<img" in (tmp_path / "report.html").read_text()


def test_what_was_said_while_frames_were_read_stands_in_the_result() -> None:
    recording = replace(read_recording(PAPER), warnings=("no rectification",))
    certificate = Certificate(
        points=recording.points,
        curves=(),
        clock_offset=NO_CLOCK,
        evidence={},
        warnings=("lamps cast shadows",),
        flags=("cast_shadow",),
    )
    content = calibrate_certified(CertifiedRecording(recording, certificate)).content
    assert content["warnings"][:2] == ["no rectification", "lamps cast shadows"]
    assert "cast_shadow" in content["flags"]


def test_one_punch_does_not_fix_nu() -> None:
    result = json.loads((calibrated_points() / "calibration.json").read_text())
    nu, modulus = result["poisson_ratio"], result["youngs_modulus_MPa"]
    assert nu["value"] is None
    assert nu["why"]
    assert modulus["interval95"][0] < 0.1915 < modulus["interval95"][1]
    curve = dict(map(tuple, result["youngs_modulus_of_nu"]))
    assert min(curve) <= 0.4797 <= max(curve)


def test_the_page_needs_no_second_file() -> None:
    text = (calibrated_points() / "report.html").read_text()
    assert "http" not in text.replace("http-equiv", "")
    assert "<script" not in text


def test_what_a_certificate_needs_is_asked_for_before_the_light_is_calibrated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without forces and without a reference: the forces are named, the light was not begun."""
    for name in ("recording.toml", "frames", "frames.csv", "presses.csv", "maps.npz"):
        source, place = ROOT / "sample_frames" / "gelslim3" / name, tmp_path / name
        place.symlink_to(source) if source.is_dir() else place.write_bytes(source.read_bytes())
    assert run(monkeypatch, "calibrate", tmp_path, "--out", tmp_path / "out") == 2
    assert "forces.csv" in capsys.readouterr().err


@each(
    "arguments, said",
    [
        (("calibrate", "nowhere"), "nowhere"),
        (("calibrate", PAPER, "--law", "magic"), "magic"),
        (("depth", PAPER), "frames"),
        (("depth", PAPER, "--calibration", "none.json"), "none.json"),
        (("view", PAPER / "points.csv"), "points.csv"),
        (("no-such-command",), "no-such-command"),
        (("depth", ""), "error: an argument is empty. Is a variable of the shell unset?"),
        (("depth", "x" * 300), "cannot be used: File name too long."),
        (("calibrate", PAPER, "--out", "x" * 300), "cannot be used: File name too long."),
        (("simulate", "out", "--seed", "-1"), "--seed"),
        (("simulate", "out", "--youngs-modulus", "-1"), "Young's modulus must be above 0 MPa (got -1.0)"),
        (("simulate", "out", "--youngs-modulus", "nan"), "Young's modulus must be above 0 MPa (got nan)"),
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
    assert not list(tmp_path.iterdir())
    assert captured.out == ""


def test_an_unwritable_place_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert run(monkeypatch, "calibrate", PAPER, "--out", tmp_path / "file" / "out") == 2
    assert "--out" in capsys.readouterr().err


def test_the_package_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "tactilevision", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("tactilevision ")


@pytest.mark.slow
def test_ctrl_c_leaves_the_old_results(tmp_path: Path) -> None:
    """Interrupted at whatever moment, a run leaves the earlier files byte for byte, and nothing half-written."""
    command = [sys.executable, "-m", "tactilevision", "calibrate", str(PAPER), "--out", str(tmp_path)]
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


def test_without_a_sound_press_each_reason_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, out, told = tmp_path / "recording", tmp_path / "out", tmp_path / "r.json"
    recording.mkdir()
    (recording / "recording.toml").write_text((PAPER / "recording.toml").read_text())
    head, *rows = (PAPER / "points.csv").read_text().splitlines()
    spoilt = [row.replace("true,", "false,bevel_not_touched") for row in rows]
    (recording / "points.csv").write_text("\n".join([head, *spoilt]) + "\n")
    assert run(monkeypatch, "calibrate", recording, "--out", out, "--json", told) == 3
    captured = capsys.readouterr()
    assert "no press can be trusted" in captured.err
    assert "0 of 5 presses accepted" in captured.out
    assert "rejected 5: bevel not touched" in captured.out
    content = json.loads(told.read_text())
    assert content == json.loads((out / "calibration.json").read_text())
    assert content["presses_rejected"][-1] == {"press": "5", "reason": "bevel_not_touched"}
    assert len(content["presses_rejected"]) == 5
    for key in ("youngs_modulus_MPa", "poisson_ratio", "c_N_per_mm", "beta", "reduced_modulus_MPa"):
        assert content[key]["value"] is None
        assert "no press can be trusted" in content[key]["why"]
    assert (out / "points.csv").exists()
    assert "no press can be trusted" in (out / "report.html").read_text()
    assert set(content) == set(json.loads((calibrated_points() / "calibration.json").read_text()))


def test_nothing_of_an_earlier_calibration_stays_beside_a_later_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, out = tmp_path / "recording", tmp_path / "out"
    recording.mkdir()
    (recording / "recording.toml").write_text((PAPER / "recording.toml").read_text())
    (recording / "points.csv").write_text((PAPER / "points.csv").read_text().replace("true,", "false,tilt"))
    assert run(monkeypatch, "calibrate", PAPER, "--no-test", "--out", out) == 0
    (out / "notes.txt").write_text("my own")
    assert (out / "fit.png").exists()
    assert run(monkeypatch, "calibrate", recording, "--out", out) == 3
    assert not (out / "fit.png").exists()
    assert not (out / "material.png").exists()
    assert (out / "points.csv").read_text().count("tilt") == 5
    assert (out / "notes.txt").exists()
    capsys.readouterr()


def test_no_force_is_computed_from_a_calibration_that_fixed_nothing(tmp_path: Path) -> None:
    from calibration.result.result import unfixed_as_json
    from tactilevision.errors import InputError
    from tactilevision.files.writing import write_json
    from tactilevision.force.calibrated import read_material
    from tactilevision.records.rig import Gel

    path = tmp_path / "calibration.json"
    write_json(path, unfixed_as_json(Gel(3.0), (), why="no press can be trusted", law="default"))
    with pytest.raises(InputError, match="no press can be trusted"):
        read_material(path)


def test_no_name_of_a_recording_leads_out_of_the_folder_of_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, points = ((PAPER / name).read_text() for name in ("recording.toml", "points.csv"))
    plain = re.search(r'name = "(.*)"', settings)
    assert plain is not None
    for day, name in ((1, "a/../../b"), (2, "new")):
        folder = tmp_path / "in" / str(day)
        folder.mkdir(parents=True)
        (folder / "points.csv").write_text(points)
        dated = re.sub(r"date = .*\n", "", settings).replace(plain[0], f'name = "{name}"\ndate = 2026-01-0{day}')
        (folder / "recording.toml").write_text(dated)
    out = tmp_path / "results" / "out"
    days = (tmp_path / "in" / str(day) for day in (1, 2))
    assert run(monkeypatch, "calibrate", *days, "--no-test", "--out", out) == 0
    assert (out / "01_a_.._.._b" / "calibration.json").is_file()
    assert read_recording(out / "01_a_.._.._b").points, "each folder of results is a recording of points"
    assert read_recording(out).points
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["out"]


def test_where_there_is_no_terminal_progress_is_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "LINE_EVERY_S", 0.05)
    with console.progress_bar("certifying") as progress:
        progress(2, 9, "presses")
        time.sleep(0.2)
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("certifying presses: 2 of 9, ")
    assert "left" not in said[0], "one step does not tell how long the others take"
    with console.progress_bar("calibrating the light:") as progress:
        progress(0, 4, "balls")
        time.sleep(1.2)
        progress(1, 4, "balls")
        time.sleep(0.1)
    said = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"calibrating the light: balls: 1 of 4, \d+ s, about [34] s left of it", said[-1])
    with console.progress_bar("quick"):
        pass
    assert capsys.readouterr().err == ""


def test_a_warning_is_printed_once_in_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    console.warned.clear()
    for _ in range(3):
        console.warn(["dim", "dim", "dark"])
    assert capsys.readouterr().err.splitlines() == ["warning: dim", "warning: dark"]


@pytest.mark.parametrize("command", [("depth",), ("force", "--calibration", "none.json"), ("calibrate",)])
def test_a_missing_extra_is_told_before_anything_is_read(
    command: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run(monkeypatch, *command, tmp_path / "nowhere", "--cluster", "tcp://127.0.0.1:1") == 2
    assert "pip install '.[cluster]'" in capsys.readouterr().err


def test_completing_a_line_waits_for_no_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr("tactilevision.cluster.connect.check_cluster", asked.append)
    line = ["somewhere", "--cluster", "tcp://127.0.0.1:1"]
    command = get_command(app).get_command(None, "depth")  # type: ignore[attr-defined]
    command.make_context("depth", list(line), resilient_parsing=True)
    assert not asked
    command.make_context("depth", list(line))
    assert asked == line[2:]


def test_help_is_printed_without_importing_a_command() -> None:
    program = (
        "import sys; from tactilevision.cli import main\n"
        "for words in (['--help'], ['calibrate', '--help'], ['live', '--help']):\n"
        "    sys.argv = ['tactilevision', *words]; main()\n"
        "sys.exit(any(name in sys.modules for name in ('numpy', 'tactilevision.pipeline')))"
    )
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    group = get_command(app)
    for name in group.list_commands(None):  # type: ignore[attr-defined]
        assert f"  {name} " in found.stdout
        assert group.get_command(None, name).help, name  # type: ignore[attr-defined]


def test_a_misspelt_command_is_named_with_those_alike(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "dept") == 2
    assert "Did you mean 'depth'" in capsys.readouterr().err
