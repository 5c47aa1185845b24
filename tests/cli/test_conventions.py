"""The command line keeps to what other command lines do: groups, short options, completion, and questions."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from each import each

from tactilevision.cli import main
from tactilevision.cli.app import COMMANDS, GROUPS, app

PAPER = Path(__file__).parents[2] / "sample_frames" / "paper_points"
GELSLIM = PAPER.with_name("gelslim3")
WIDTH = 80  # columns of a terminal


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, arguments)])
    return main()


def test_the_help_lists_commands_by_group_each_on_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "-h") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line[:-1] for line in lines if line.endswith(":") and line[0] != " "] == ["Options", *GROUPS]
    for name, (*_, summary) in COMMANDS.items():
        assert f"  {name:16}  {summary}" in lines
    assert max(map(len, lines)) < WIDTH


@each("name", list(COMMANDS))
def test_help_is_sentences_and_options_have_one_name(name: str) -> None:
    command = typer.main.get_command(app).get_command(None, name)  # type: ignore[attr-defined]
    spelt = {option for one in command.params for option in one.opts}
    for one in command.params:
        assert re.fullmatch(r"[A-Z`][\s\S]*\.", one.help), (one.opts, one.help)
    assert {"-q", "--quiet"} <= spelt
    assert ("-o" in spelt) == ("--out" in spelt)
    assert not spelt & {"--scheduler", "--processes"}


@each(
    "arguments, said",
    [
        (("compare", PAPER, "--effect", "mine.py"), "Add an effect by --with KEY or --with FILE.py"),
        (("compare", PAPER, "--effect=mine.py"), "Add an effect by --with KEY or --with FILE.py"),
        (("tabulate", "out", "--processes", "2"), "Use --workers."),
        (("depth", PAPER, "--scheduler", "x"), "Use --cluster ADDRESS."),
        (("compare", PAPER, "--wth", "x"), "Did you mean --with"),
        (("compare", PAPER, "--with", "viscoelastcity"), "Did you mean viscoelasticity?"),
        (("compare", PAPER, "--with", "none.py"), "error: none.py: there is no such file."),
        (("depth", "pictures", "--sensor", "gelslm3"), "Did you mean gelslim3?"),
        (("tabulate", "out", "--law", "henky"), "Did you mean hencky?"),
        (("view", "none.tiff"), "error: none.tiff: there is no such file."),
        (("force", GELSLIM, "--calibration", "none.json"), "error: none.json: there is no such file."),
        (("calibrate", "pictures"), "`tactilevision depth pictures --sensor NAME` makes height maps of them"),
    ],
)
def test_what_was_meant_is_named(
    arguments: tuple[object, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    picture = cv2.imencode(".png", np.zeros((24, 32, 3), np.uint8))[1].tobytes()
    (tmp_path / "pictures" / "0.png").write_bytes(picture)
    assert run(monkeypatch, *arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Errno" not in error


def test_json_is_printed_alone_and_quiet_prints_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "plan", PAPER, "--json", "-") == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["reached"] is False
    assert "half widths" in printed.err
    assert run(monkeypatch, "plan", PAPER, "-q") == 0
    assert capsys.readouterr().out == ""
    assert run(monkeypatch, "new-effect", tmp_path / "mine.py") == 0
    assert "wrote" in capsys.readouterr().out, "a later command is not quiet"


def test_a_shell_completes_commands_without_importing_them_and_options() -> None:
    def completed(line: str, place: int) -> list[str]:
        about = {"_TACTILEVISION_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(place)}
        program = (
            "import sys; from tactilevision.cli import main; sys.argv = ['tactilevision']; code = main(); "
            "print(code, 'numpy' in sys.modules, end='', file=sys.stderr)"
        )
        done = subprocess.run(
            [sys.executable, "-c", program], env=os.environ | about, capture_output=True, text=True, check=True
        )
        assert done.stderr == "0 False"
        return done.stdout.split()

    assert completed("tactilevision ca", 1) == ["calibrate", "calibrate-sensor"]
    assert completed("tactilevision compare --wi", 2) == ["--with"]
