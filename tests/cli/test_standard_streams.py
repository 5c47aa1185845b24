"""Standard streams that are closed, full or know few letters, and names that would steer a terminal."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tactilevision.cli import main
from tactilevision.cli.console import say, warn

ROOT = Path(__file__).parents[2]
PAPER = ROOT / "sample_frames" / "paper_points"
FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no device that is always full")


def in_shell(line: str, *arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """`line` of a shell, in which "$@" is the command line with `arguments`."""
    command = [sys.executable, "-m", "tactilevision", *map(str, arguments)]
    return subprocess.run(
        ["sh", "-c", line, "sh", *command],
        capture_output=True,
        text=True,
        env=os.environ | environment,
        cwd=ROOT,
        check=False,
    )


@FULL
@pytest.mark.parametrize(
    "arguments",
    [
        ["new-effect", "own.py"],
        pytest.param(["calibrate", PAPER, "--no-test", "--out", "."], marks=pytest.mark.slow),
    ],
)
def test_a_summary_that_cannot_be_written_is_told_in_one_line(arguments: list[object], tmp_path: Path) -> None:
    done = in_shell('"$@" > /dev/full', *arguments[:-1], tmp_path / str(arguments[-1]))
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert [line for line in done.stderr.splitlines() if line.startswith("error")] == [
        "error: standard output: cannot be written: No space left on device. Send it elsewhere."
    ]


@FULL
def test_a_summary_is_told_though_warnings_cannot_be_written(tmp_path: Path) -> None:
    done = in_shell('"$@" 2> /dev/full', "calibrate", PAPER, "--no-test", "--out", tmp_path)
    assert done.returncode == 0
    assert "stiffness        c  = 3.494" in done.stdout


@FULL
@pytest.mark.parametrize("arguments", [["calibrate", "nowhere"], ["calibrate", "--nothing"], [""]])
def test_bad_input_keeps_its_exit_code_where_no_error_can_be_written(arguments: list[str]) -> None:
    assert in_shell('"$@" 2> /dev/full', *arguments).returncode == 2


@FULL
@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["calibrate", "--help"]])
def test_help_that_cannot_be_written_is_one_line(arguments: list[str]) -> None:
    done = in_shell('"$@" > /dev/full', *arguments)
    assert done.returncode == 2
    assert done.stderr == (
        "error: standard output or a file: cannot be written: No space left on device. "
        "Make room, or send it elsewhere.\n"
    )


def test_a_terminal_that_knows_no_greek_ends_no_run(tmp_path: Path) -> None:
    line = "from tactilevision.cli import console, main\nimport sys\nsys.argv = ['x', '--version']\nmain()\n"
    script = tmp_path / "says.py"
    script.write_text(line + "console.say('\\u03bd')\n")
    done = subprocess.run(
        [sys.executable, script],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONIOENCODING": "latin-1", "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.stdout.splitlines()[-1] == "\\u03bd", done.stderr


def test_names_steer_no_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    say("press \x1b[2Jp\u202e1\r")
    warn(["one\nand \x07 two"])
    monkeypatch.setattr(sys, "argv", ["tactilevision", "calibrate", "a\x1b[31mred"])
    assert main() == 2
    told = capsys.readouterr()
    assert told.out == "press \\x1b[2Jp\\u202e1\\r\n"
    assert told.err.startswith("warning: one\\nand \\x07 two\nerror: ")
    assert "error: a\\x1b[31mred: there is no such folder." in told.err


def test_a_folder_that_ascii_cannot_name_holds_its_report_though_every_stream_is_closed(tmp_path: Path) -> None:
    """Python's own UTF-8 mode off, as under an old POSIX locale: OpenCV crashed on such a name."""
    there, out = tmp_path / 'it\'s "q" 😀', tmp_path / "aus – 結果"
    shutil.copytree(PAPER, there)
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}
    done = in_shell('"$@" <&- >&- 2>&-', "calibrate", there, "--no-test", "--out", out, **plain)
    assert done.returncode == 0, "it cannot say why: every stream is closed"
    assert "<img" in (out / "report.html").read_text(encoding="utf-8")
