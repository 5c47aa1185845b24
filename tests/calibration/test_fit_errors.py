"""One held-out error and one repeatability for the same presses, whatever command states them."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.diagnosis.refit import held_out_rms
from calibration.fit.least_squares import fit
from calibration.fit.repeats import repeatability_rms
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.tasks.compare import base_model, compare, judged
from calibration.tasks.diagnose import diagnose
from tactilevision.cli import main

PAPER = Path(__file__).parents[2] / "sample_frames" / "paper_points"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> None:
    monkeypatch.setattr(sys, "argv", ["tactilevision", *map(str, arguments)])
    assert main() == 0


@pytest.mark.slow
def test_every_command_states_the_same_two_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(monkeypatch, "calibrate", PAPER, "--out", tmp_path / "calibrated")
    said = capsys.readouterr().out
    run(monkeypatch, "compare", PAPER, "--with", "depth_zero", "--out", tmp_path / "compared")
    run(monkeypatch, "diagnose", PAPER, "--out", tmp_path / "diagnosed")
    calibrated = json.loads((tmp_path / "calibrated" / "calibration.json").read_text())
    base, added = (m["rms_error_N"] for m in json.loads((tmp_path / "compared" / "comparison.json").read_text()))
    diagnosed = json.loads((tmp_path / "diagnosed" / "diagnosis.json").read_text())["rms_error_N"]
    held_out, repeatability = calibrated["held_out_N"], calibrated["noise_floor_N"]
    assert [base["held_out"], base["floor"]] == pytest.approx([held_out, repeatability], rel=1e-6)
    assert [diagnosed["held_out_before"], diagnosed["floor"]] == pytest.approx([held_out, repeatability], rel=1e-6)
    assert f"error on held-out presses {1e3 * held_out:.1f} mN" in said
    assert "no press is repeated" in said
    assert base["repeats"] is None
    capsys.readouterr()
    run(monkeypatch, "steps", tmp_path / "compared")
    said = capsys.readouterr().out
    assert f"error on held-out presses from {1e3 * held_out:.1f} to {1e3 * added['held_out']:.1f} mN" in said


def test_of_an_exact_law_both_figures_are_the_noise() -> None:
    """Over drawn seeds: the held-out error and the repeatability have the noise's own size."""
    model, std_N, figures = Model(FlatPunch()), 0.01, []
    heights = np.repeat(np.linspace(0.15, 0.6, 5), 4)
    punches = [indenter(f"h{k // 4}") for k in range(20)]
    data = observations([np.array([height]) for height in heights], punches)
    force = model.predict(model.defaults(data), data)
    for seed in range(12):
        noisy = data.with_force(force + std_N * np.random.default_rng(seed).standard_normal(force.size))
        again = judged(fit(model, noisy))
        figures.append((held_out_rms(again), repeatability_rms(again)))
    assert np.mean(figures, axis=0) == pytest.approx([std_N, std_N], rel=0.2)


def test_every_command_holds_effects_against_the_same_plain_law() -> None:
    """Depths with a noise that nobody stated: calibrate, compare and diagnose weigh them alike."""
    rng = np.random.default_rng(2)
    punches = [indenter(name, radius) for name, radius in (("small", 1.0), ("large", 4.0)) for _ in range(4)]
    data = observations([np.linspace(0.05, 0.6, 40)] * 8, punches)
    model = Model(FlatPunch())
    force = model.predict(np.array([0.2, 0.48, 0.85, 0.85]), data) + 0.001 * rng.standard_normal(data.size)
    noisy = replace(data.with_force(force), depth_mm=data.depth_mm + 0.003 * rng.standard_normal(data.size))
    (alone,) = compare(noisy, [], rng=rng).models
    diagnosed = diagnose(noisy, np.random.default_rng(0)).errors
    assert alone.fitted.data.depth_over_force_noise > 0, "else the test tests nothing"
    assert (alone.rms_N, alone.held_out_N) == (diagnosed.before, diagnosed.held_out_before)
    again = judged(fit(base_model(noisy), noisy))
    assert held_out_rms(again) == pytest.approx(alone.held_out_N, rel=1e-3)
    assert repeatability_rms(again) == pytest.approx(alone.repeatability_N, rel=1e-3)
