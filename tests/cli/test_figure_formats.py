"""Figures come in the form that was asked for, beside the PNG files that reports embed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from each import each

from calibration.tasks import validate as method
from tactilevision.cli import main
from tactilevision.cli.shared_options import FigureFormat
from tactilevision.mechanics.punch_curve import PunchCurve
from tactilevision.plots.style import FORMS

PAPER = Path(__file__).parents[2] / "sample_frames" / "paper_points"
BEGINS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
COMMANDS = ("calibrate", "diagnose", "compare", "validate")


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, arguments)])
    return main()


def figures(folder: Path, form: str) -> dict[str, bytes]:
    return {str(path.relative_to(folder).with_suffix("")): path.read_bytes() for path in folder.rglob(f"*.{form}")}


def test_each_figure_of_a_calibration_is_written_in_that_form_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "calibrate", PAPER, "--law", "paper", "--format", "svg", "--out", tmp_path) == 0
    pictures, others = figures(tmp_path, "png"), figures(tmp_path, "svg")
    assert set(pictures) == set(others) == {"fit", "material"}
    assert all(content.startswith(BEGINS["svg"]) for content in others.values())
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/webp") == page.count("<img") == page.count('type="checkbox"') == 2
    assert run(monkeypatch, "calibrate", PAPER, "--law", "paper", "--out", tmp_path) == 0
    assert figures(tmp_path, "svg") == {}, "nothing of the earlier run stays"


@pytest.mark.slow
def test_a_validation_is_drawn_in_that_form_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    depth_mm = np.linspace(0.01, 1.0, 30)
    curve = PunchCurve(depth_mm, 3.5 * depth_mm, "solved", "")
    monkeypatch.setattr(method, "punch_curve", lambda *_: curve)  # a stand-in for finite elements
    monkeypatch.setattr(method, "tabulated_curve", lambda *_: None)
    (tmp_path / "m.json").write_text(json.dumps({"youngs_modulus_MPa": 0.2, "poisson_ratio": 0.48}))
    chosen = ("--calibration", tmp_path / "m.json", "--format", "pdf", "--out", tmp_path / "out")
    assert run(monkeypatch, "validate", PAPER, *chosen) == 0
    pictures, others = figures(tmp_path / "out", "png"), figures(tmp_path / "out", "pdf")
    assert set(pictures) == set(others) == {"depth_at_equal_force", "force_at_equal_depth"}
    assert all(content.startswith(BEGINS["pdf"]) for content in others.values())


@each("command", COMMANDS)
def test_a_wrong_format_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    assert run(monkeypatch, command, PAPER, "--format", "gif", "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "gif" in said
    assert "--format" in said
    assert not (tmp_path / "out").exists()


def test_the_command_line_knows_the_forms_that_are_drawn() -> None:
    assert get_args(FigureFormat) == FORMS
