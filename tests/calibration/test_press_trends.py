"""A drift from press to press is called a trend in the figure and on the page."""

from __future__ import annotations

import numpy as np
import pytest
from made_presses import indenter, observations
from scipy.stats import spearmanr

from calibration.diagnosis.covariates import press_trends
from calibration.report.misfit import residual_strips
from calibration.report.report import pattern_sentence
from calibration.tasks.compare import Comparison, compare
from tactilevision.plots.misfit import evidence

DEPTHS = (0.22, 0.36, 0.5)


def compared(drift: float, count: int = 9) -> Comparison:
    """Points of three depths in turn; the force falls by `drift` a press, and has .3 % at random."""
    depth = [np.array([DEPTHS[k % 3]]) for k in range(count)]
    data = observations(depth, [indenter()] * count, time_s=[np.array([300.0 * k]) for k in range(count)])
    gain = 1 - drift * np.arange(count) + 0.003 * np.random.default_rng(4).standard_normal(count)
    force = 4.0 * data.depth_mm * gain  # a straight law of any gel
    return compare(data.with_force(force), [], rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def drifting() -> Comparison:
    return compared(0.008)


def told(found: Comparison) -> dict[str, str]:
    """What stands over each panel."""
    shown = residual_strips({"law": found.models[0].fitted}, [found.models[0].covariates])
    return {one.name: evidence(one.p_adjusted[0], one.p_trend[0]) for one in shown.strips}


def test_a_plain_drift_over_nine_presses_is_told(drifting: Comparison) -> None:
    over = told(drifting)
    assert over.pop("order").startswith("a trend (p = 0.00")
    assert all(words.startswith("no pattern") for words in over.values())
    assert pattern_sentence(drifting, explained=True).endswith("depends on the order of pressing.")


def test_presses_that_do_not_drift_have_no_trend() -> None:
    steady = compared(0.0)
    assert all(words.startswith("no pattern") for words in told(steady).values())
    assert pattern_sentence(steady, explained=True) == ""


def test_p_is_of_a_rank_correlation_times_the_covariates(drifting: Comparison) -> None:
    fitted = drifting.models[0].fitted
    found = press_trends(fitted)
    assert "indenter" not in found, "a name has no order"
    ranked = fitted.residual_N / np.hypot(fitted.noise.gain * fitted.about.force_N, fitted.noise.scale)
    other = spearmanr(ranked, fitted.data.presses.order).pvalue  # t's tails, near enough at nine
    assert found["order"] == pytest.approx(len(found) * other, rel=1.0, abs=2e-3)
    assert found["w"] == 1.0
