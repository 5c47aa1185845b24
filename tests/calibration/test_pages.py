"""What the pages say: why a press was rejected, and that something is left where an error alone hides it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.report.report import calibration_page, pattern_sentence
from calibration.tasks.compare import Comparison, compare
from tactilevision.records.certified import CertificationDetails, CertifiedPoint


def test_a_rejected_press_says_why_in_a_sentence() -> None:
    said = "tangential: the tangential force is 21 % of the normal one; tilt: the face is tilted"
    points = [
        CertifiedPoint(
            "p1", "A", 0.2, 0.5, accepted=False, reason="tangential", details=CertificationDetails(findings=said)
        ),
        CertifiedPoint("p2", "A", 0.2, 0.5, accepted=False, reason="short_rest"),
    ]
    page = calibration_page("title", None, points=points)
    assert "rejected (tangential): the tangential force is 21 % of the normal one</td>" in page
    assert "rejected: short rest</td>" in page


def test_no_presses_are_headed_where_there_is_none_to_list() -> None:
    assert "<h2>Presses</h2>" not in calibration_page("title", None, points=[])


@pytest.fixture
def plain() -> Comparison:
    data = observations([np.linspace(0.05, 0.6, 20)] * 4, [indenter("A")] * 4)
    force = Model(FlatPunch()).predict(np.array([0.2, 0.48, 0.85]), data)
    noisy = data.with_force(force + 0.01 * np.random.default_rng(1).standard_normal(data.size))
    return compare(noisy, [], rng=np.random.default_rng(0))


def test_what_is_left_is_said_also_where_the_error_is_as_small_as_presses_repeat(plain: Comparison) -> None:
    last = plain.models[-1]
    on_depth = tuple(replace(one, p_adjusted=1e-5 if one.key in ("w", "1/w") else 1.0) for one in last.covariates)
    left = replace(plain, models=(replace(last, covariates=on_depth),))
    assert any(one.key == "w" for one in on_depth)
    assert pattern_sentence(left, explained=True).endswith("depends on the depth.")
    assert pattern_sentence(left, explained=False) == "The residual depends on the depth."
    quiet = tuple(replace(one, p_adjusted=1.0) for one in last.covariates)
    assert pattern_sentence(replace(plain, models=(replace(last, covariates=quiet),)), explained=True) == ""
