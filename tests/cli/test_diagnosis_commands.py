"""diagnose, compare, new-effect and train as a user calls them."""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path

import pytest
from sample_light import light_of_sample

from tactilevision.cli import main

ROOT = Path(__file__).parents[2]
PAPER = ROOT / "sample_frames" / "paper_points"
SHADOW = ROOT / "sample_frames" / "hidden_shadow"


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
    assert "these data cannot distinguish" in capsys.readouterr().out


def test_comparison_lists_models_in_the_order_added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "my_effect.py"
    assert run(monkeypatch, "new-effect", own) == 0
    chosen = ("--with", "depth_zero", "--with", own, "--with", "force_drift")
    out = tmp_path / "out"
    assert run(monkeypatch, "compare", PAPER, *chosen, "--format", "svg", "--out", out) == 0
    names = {path.name for path in out.iterdir()}
    assert {"error.png", "error.svg", "residuals.png", "secant.png", "modulus.png", "report.html"} <= names
    models = json.loads((out / "comparison.json").read_text())
    said = (out / "report.html").read_text()
    assert [model["effects"][-1:] for model in models[:2]] == [[], ["depth_zero"]]
    assert "Force drift is excluded" in said, "points have no working time to drift over"
    assert {"before", "after", "held_out_before", "held_out_after", "floor"} <= set(models[1]["rms_error_N"])
    assert models[1]["youngs_modulus_MPa"]["interval95"]
    assert len(models[1]["presses"]) == len(models[0]["presses"]) > 2
    assert "suggested" in models[-1]


def test_a_comparison_of_the_plain_law_points_to_a_diagnosis_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "compare", PAPER, "--no-prior", "--out", tmp_path) == 0
    command = f"tactilevision diagnose {PAPER} --no-prior"
    assert f"to find what is missing: {command}" in capsys.readouterr().out
    assert f"<pre>{command}</pre>" in (tmp_path / "report.html").read_text()


def results(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "history.json"
    }


def test_a_step_is_taken_back_and_put_back_and_all_that_is_shown_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "compare", PAPER, "--with", "depth_zero", "--out", tmp_path) == 0
    script = (tmp_path / "repeat.sh").read_text()
    assert "--with depth_zero" in script
    assert str(PAPER.resolve()) in script
    assert f"--out {tmp_path.resolve() / 'repeated'}" in script
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "calibration_before.json").write_text('{"mine": 1}')
    (tmp_path / "calibration.json").write_text('{"applied": 1}')
    content = json.loads((tmp_path / "history.json").read_text())
    (tmp_path / "history.json").write_text(json.dumps(content | {"applied": True}))
    whole = results(tmp_path)
    assert run(monkeypatch, "steps", tmp_path, "--undo") == 0
    assert "taken back: depth zero" in capsys.readouterr().out
    assert "--with" not in (tmp_path / "repeat.sh").read_text()
    assert [model["effects"] for model in json.loads((tmp_path / "comparison.json").read_text())] == [[]]
    assert "Taken back: depth zero" in (tmp_path / "report.html").read_text()
    assert json.loads((tmp_path / "calibration.json").read_text()) == {"mine": 1}
    changed = results(tmp_path)
    assert all(changed[name] != whole[name] for name in ("report.html", "error.png", "secant.png"))
    assert changed["notes.txt"] == b"mine"
    assert run(monkeypatch, "steps", tmp_path, "--undo") == 2, "nothing is left to undo"
    assert run(monkeypatch, "steps", tmp_path, "--redo") == 0
    assert results(tmp_path) == whole


def test_a_history_runs_no_file_that_nobody_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "mine.py"
    assert run(monkeypatch, "new-effect", own, "--key", "mine") == 0
    own.write_text(own.read_text() + f"\nopen({str(tmp_path / 'ran')!r}, 'w').close()\n")
    steps = [{"key": key, "path": path} for key, path in (("mine", str(own)), ("depth_zero", ""))]
    out = tmp_path / "out"
    out.mkdir()
    kept = {"recordings": [str(PAPER)], "steps": steps, "undone": []}
    (out / "history.json").write_text(json.dumps(kept))
    assert run(monkeypatch, "steps", out, "--undo") == 2
    said = capsys.readouterr().err
    assert "--effect" in said
    assert "mine.py" in said
    assert not (tmp_path / "ran").exists()
    assert json.loads((out / "history.json").read_text()) == kept


@pytest.mark.slow
def test_a_comparison_out_of_time_says_what_it_did_not_add(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import calibration.inputs.deadline as module

    monkeypatch.setattr(module.Deadline, "passed", property(lambda self: self.at_s < float("inf")))
    out = tmp_path / "out"
    assert run(monkeypatch, "compare", PAPER, "--with", "depth_zero", "--time-limit", 1, "--out", out) == 0
    assert "Depth zero is excluded: the time was over" in (out / "report.html").read_text()
    assert run(monkeypatch, "diagnose", PAPER, "--time-limit", 1, "--out", out) == 0
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["stopped"]
    assert "No effect of the catalogue comes near" not in (out / "report.html").read_text(), (
        "what was not tried is not said to fail"
    )
    assert "best answer so far" in (out / "report.html").read_text()


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


@pytest.mark.slow
def test_a_method_made_from_balls_comes_with_its_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, "train", light_of_sample(tmp_path, balls=8), "--out", tmp_path / "light.npz") == 0
    card = json.loads((tmp_path / "light.json").read_text())
    assert card["method"] == "polynomial"
    assert len(card["sha256"]) == 64


@pytest.mark.slow
def test_the_shadows_of_a_path_tracer_are_named_from_its_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "diagnose", SHADOW, "--out", tmp_path / "out") == 0
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert (found["verdict"], found["candidates"]) == ("IDENTIFIED", ["cast_shadow"])
    after = found["material"]["after"]
    assert "cast_shadow" in after["flags"]
    assert any("lamps cast shadows" in line for line in after["warnings"])
    low, high = after["youngs_modulus_MPa"]["interval95"]
    truth = tomllib.loads((SHADOW / "truth.toml").read_text())
    assert low < truth["youngs_modulus_MPa"] < high
