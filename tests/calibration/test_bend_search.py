"""The bend that theory allows is let go only for what it takes away."""

from __future__ import annotations

import numpy as np
import pytest
from test_screen import MODEL, TRUTH, measured, presses, pure

from calibration.diagnosis import forward_selection as module
from calibration.diagnosis.score_test import Scored, ScoreTest
from calibration.fit.least_squares import Fit, fit
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model


def _screen(statistic: float, p_adjusted: float) -> ScoreTest:
    return ScoreTest((), (Scored("a", statistic, p_adjusted, p_adjusted, 1.0),), {}, {})


def _fits() -> tuple[Fit, Fit]:
    data = presses(8)
    straight = pure(measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(0)))
    return straight, fit(Model(FlatPunch(bent=True)), straight.data, noise=straight.noise, tolerances=False)


@pytest.mark.parametrize(("after", "taken"), [(29.5, True), (30.5, False)])
def test_a_bend_has_to_take_what_its_one_parameter_costs_off_a_covariate(
    after: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    straight, bent = _fits()
    monkeypatch.setattr(module, "score_test", lambda *_, **__: _screen(after, 0.02))
    turn = module.Round(_screen(32.0, 0.02), (), {}, straight)
    assert module._takes(straight, bent, turn, np.random.default_rng(0)) is taken


def test_a_bend_that_was_held_against_an_effect_needs_no_covariate(monkeypatch: pytest.MonkeyPatch) -> None:
    straight, bent = _fits()
    monkeypatch.setattr(module, "score_test", lambda *_, **__: _screen(32.0, 0.02))
    turn = module.Round(_screen(32.0, 0.02), (), {"tilt": Scored("tilt", 20.0, 1e-4, 1e-3)}, straight)
    assert module._takes(straight, bent, turn, np.random.default_rng(0))
