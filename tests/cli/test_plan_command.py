"""`tactilevision plan` as a user meets it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from each import each

from tactilevision.cli import main

PAPER = Path(__file__).parents[2] / "sample_frames" / "paper_points"
RIG = ("--radius", "2.5", "--heights", ".3,.6", "--thickness", "3", "--pad-radius", "15")
SHARP = ("--lubricated", "--edge-radius", "0", "--poisson-ratio-std", ".002")


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["tactilevision", "plan", *map(str, arguments)])
    return main()


def test_a_design_with_known_nu_gives_a_number_of_presses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, *RIG, *SHARP, "--within", "5", "--json", tmp_path / "plan.json") == 0
    found = json.loads((tmp_path / "plan.json").read_text())
    assert found["reached"]
    out = capsys.readouterr().out
    assert f"{found['fewest']['presses']} presses reach E within 5 %" in out
    assert found["fewest"]["youngs_modulus_relative"]["half_width_95"] <= 0.05


def test_a_recording_gives_gel_and_faces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, PAPER, *SHARP, "--within", "10", "--json", tmp_path / "plan.json") == 0
    found = json.loads((tmp_path / "plan.json").read_text())
    assert found["as_given"]["heights_mm"] == [0.15, 0.3, 0.4, 0.5, 0.6]
    assert found["as_given"]["radii_mm"] == [2.5]
    assert "presses reach" in capsys.readouterr().out


@each(
    "change, said",
    [
        (("--heights", ".3,3.5"), "reaches through the gel"),
        (("--heights", ".3,nan"), "step height"),
        (("--heights", ".3,high"), "numbers with commas"),
        (("--thickness", "-3"), "thickness_mm must lie between"),
        (("--height-std", "-1"), "height_std_mm must lie between"),
        (("--edge-radius", "nan"), "radius of an edge"),
        (("--poisson-ratio-std", "-1"), "poisson_ratio_std must lie between"),
        (("--pad-radius", "2"), "as wide as the gel pad"),
        (("--depth-noise", "-1"), "noise of depth"),
        (("--modulus", ".1,.2,.3"), "two ends of a range"),
        (("--within", "0"), "a goal must be above 0"),
    ],
)
def test_bad_input_ends_with_one_line_and_code_2(
    change: tuple[str, str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, *RIG, *change) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert said in error


def test_the_thickness_is_needed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "--radius", "2.5") == 2
    assert "--thickness" in capsys.readouterr().err
