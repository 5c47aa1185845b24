"""A thickness stated wrong: E's interval reaches to what each candidate makes of it, and its check comes first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations

from benchmarks.others_curves.law import slope_N_per_mm
from calibration.diagnosis.experiment_design import plan_next
from calibration.diagnosis.forward_selection import Step
from calibration.diagnosis.refit import Candidate, own_fit, refit_with
from calibration.diagnosis.score_test import Scored
from calibration.effects import EFFECTS
from calibration.inputs.observations import Observations
from calibration.tasks import diagnose as task
from calibration.tasks.compare import base_fit, base_model

MODULUS, NU, STATED_MM, TRUE_MM = 0.25, 0.48, 3.0, 2.4
RADII = (1.5, 2.5, 3.5)
FIRST = "thickness from edge fillet: measure the gel's thickness at its rim"


def measured() -> Observations:
    """Presses of three radii on a gel a fifth thinner than stated, by the integral equation of others_curves."""
    rng, depth = np.random.default_rng(2), np.linspace(0.02, 0.5, 15)
    kinds = [indenter(f"R{radius}", radius) for radius in RADII] * 4
    data = observations([depth] * 12, kinds, time_s=[300.0 * k + 5 * depth for k in range(12)])
    gel = replace(data.gel, thickness_mm=STATED_MM, thickness_std_mm=0.02, poisson_ratio_std=0.005)
    data = replace(data, gel=gel, force_std_N=np.full(data.size, 0.004), depth_std_mm=np.full(data.size, 0.002))
    slope = np.array([slope_N_per_mm(MODULUS, NU, a, TRUE_MM) for a in RADII])[np.arange(12) % 3][data.press]
    gain = 1 + 0.004 * rng.standard_normal(data.count)
    force = slope * data.depth_mm * (1 + 0.7 * data.depth_mm / TRUE_MM) * gain[data.press]
    data = data.with_force(force + 0.004 * rng.standard_normal(data.size))
    return data.shifted(0.002 * rng.standard_normal(data.size))


def test_a_candidate_makes_of_E_what_it_would_without_the_prior_that_may_be_wrong() -> None:
    base = base_fit(base_model(data := measured()), data)
    edge, thickness = (refit_with(base, EFFECTS[key]) for key in ("edge_fillet", "thickness"))
    step = Step(edge, Scored("edge_fillet", 1.0, 0.0, 0.0), 0.5, own_fit(base, edge), (edge, thickness), base)
    own = step.own_fits()
    assert list(own) == ["edge_fillet", "thickness"]
    assert own["edge_fillet"] is step.fitted
    assert thickness.values[0] > 1.1 * MODULUS
    assert own["thickness"].values[0] == pytest.approx(MODULUS, rel=0.03)
    assert STATED_MM * (1 + Candidate.of_fit("thickness", own["thickness"]).own_values[0]) == pytest.approx(
        TRUE_MM, rel=0.04
    )
    group = tuple(Candidate.of_fit(*one) for one in own.items())
    plans = plan_next(base, [[group]], again=(), left=None, instead=(), bias={"friction": 0.1})
    assert plans[0].action == FIRST
    assert [plan.separates != "" for plan in plans] == [True] * (len(plans) - 1) + [False]


@pytest.mark.slow
def test_the_modulus_of_each_candidate_is_in_the_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    table = {key: EFFECTS[key] for key in ("edge_fillet", "thickness")}
    monkeypatch.setattr(task, "effects_for", lambda data: tuple(table.values()))
    found = task.diagnose(measured(), np.random.default_rng(0))
    low, high = found.material.after.youngs_modulus.interval95 or (np.inf, 0.0)
    assert found.verdict == "AMBIGUOUS"
    assert set(found.candidates) == set(table)
    assert low < MODULUS < high
    assert found.measure_next[0].action == FIRST
