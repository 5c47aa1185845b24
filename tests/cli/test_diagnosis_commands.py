"""diagnose, compare, new-effect and train as a user calls them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from test_train_command import shortened

from tactilevision.cli import main

ROOT = Path(__file__).parents[2]
PAPER = ROOT / "sample_frames" / "paper_points"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, arguments)])
    return main()


@pytest.mark.slow
def test_the_papers_points_are_not_called_adequate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A free beta fits them, but no contact law allows this one: four candidates, each with what it would be."""
    assert run(monkeypatch, "diagnose", PAPER, "--format", "pdf", "--out", tmp_path) == 0
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["verdict"] == "AMBIGUOUS"
    assert "beta_outside_theory" in found["flags"]
    assert {"thickness", "edge_fillet", "depth_zero", "stiffening"} <= set(found["candidates"])
    thickness = next(w for w in found["would_have_to_be"] if w["key"] == "thickness")
    assert 3.0 * (1 + thickness["value"]) == pytest.approx(2.25, abs=0.15)
    assert found["measure_next"]
    assert {"history.json", "repeat.sh", "report.html", "residuals.png"} <= {p.name for p in tmp_path.iterdir()}
    drawn = {form: {path.stem for path in tmp_path.rglob(f"*.{form}")} for form in ("png", "pdf")}
    assert drawn["png"] == drawn["pdf"], "each figure is written in both forms"
    assert "cannot tell which of" in capsys.readouterr().out


def test_comparison_lists_models_in_the_order_added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, "compare", PAPER, "--with", "depth_zero", "--format", "svg", "--out", tmp_path) == 0
    assert {"error.png", "error.svg"} <= {path.name for path in tmp_path.iterdir()}
    models = json.loads((tmp_path / "comparison.json").read_text())
    assert [model["effects"] for model in models] == [[], ["depth_zero"]]
    assert {"before", "after", "held_out_before", "held_out_after", "floor"} <= set(models[1]["rms_error_N"])


def test_a_step_is_taken_back_and_put_back_and_the_script_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "compare", PAPER, "--with", "depth_zero", "--out", tmp_path) == 0
    script = (tmp_path / "repeat.sh").read_text()
    assert "--with depth_zero" in script
    assert str(PAPER.resolve()) in script
    assert f"--out {tmp_path.resolve() / 'repeated'}" in script
    (tmp_path / "calibration.json").write_text("{}")
    assert run(monkeypatch, "steps", tmp_path, "--undo") == 0
    assert "--with" not in (tmp_path / "repeat.sh").read_text()
    said = capsys.readouterr().out
    assert "taken back: depth zero" in said
    assert "calibration.json is as --apply wrote it" in said.replace("\n", " ")
    assert run(monkeypatch, "steps", tmp_path, "--undo") == 2, "nothing is left to undo"
    assert run(monkeypatch, "steps", tmp_path, "--redo") == 0
    assert (tmp_path / "repeat.sh").read_text() == script


def test_an_unknown_effect_is_named_with_the_known_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "compare", PAPER, "--with", "magic", "--out", tmp_path) == 2
    said = capsys.readouterr().err
    assert "magic" in said
    assert "depth_zero" in said


def test_a_template_is_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "my_effect.py"
    assert run(monkeypatch, "new-effect", place) == 0
    before = place.read_bytes()
    assert run(monkeypatch, "new-effect", place) == 2
    assert place.read_bytes() == before
    assert run(monkeypatch, "compare", PAPER, "--effect", place, "--out", tmp_path / "out") == 0


def test_a_method_made_from_balls_comes_with_its_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, "train", shortened(tmp_path, 8), "--out", tmp_path / "light.npz") == 0
    card = json.loads((tmp_path / "light.json").read_text())
    assert card["method"] == "polynomial"
    assert len(card["sha256"]) == 64
