"""Points, one a press: what drifts or follows the speed passes for their scatter, and is told from it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.diagnosis.diagnosis import Diagnosis
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.score_test import ScoreTest
from calibration.inputs.conditions import bins, covariates
from calibration.inputs.observations import Observations
from calibration.report.diagnosis_report import verdict_sentence
from calibration.tasks.diagnose import diagnose

HEIGHTS_MM = (0.14, 0.27, 0.41, 0.55)


def points(seed: int, *, repeats: int = 3, drift: float = 0.0, slow: float = 0.0) -> Observations:
    """Certified depths and forces of a line in w, .3 % a press; `drift` of the force over all presses, `slow` of
    it less where the punch comes at half the speed, which is kept within a percent.
    """
    rng = np.random.default_rng(seed)
    depth = rng.permutation(np.repeat(HEIGHTS_MM, repeats))
    count = depth.size
    half = np.arange(count) % 2
    data = observations([np.array([w]) for w in depth], [indenter()] * count)
    speed = 0.2 / (1 + half) * (1 + 0.01 * rng.standard_normal(count))
    data = replace(data, depth_source="gauge", presses=replace(data.presses, speed_mm_s=speed))
    scale = (
        (1 - drift * np.arange(count) / (count - 1)) * (1 - slow * half) * (1 + 0.003 * rng.standard_normal(count))
    )
    force = 3.8 * depth * (1 + 0.28 * depth) * scale + 0.0015 * rng.standard_normal(count)
    data = replace(data, depth_std_mm=np.full(count, 0.001), force_std_N=np.full(count, 0.0015))
    return data.with_force(force)


def diagnosed(data: Observations) -> Diagnosis:
    return diagnose(data, np.random.default_rng(0))


def test_a_force_that_drifts_in_proportion_is_told_from_the_presses_scatter() -> None:
    """Twelve presses in mixed order, 10 % from first to last: like ones scatter by 4 %."""
    found = diagnosed(points(3, drift=0.1))
    assert found.verdict == "IDENTIFIED"
    assert found.candidates == ("gain_drift",)
    assert dict(found.effects[0].parameters)["gain"].value == pytest.approx(-0.1, abs=0.02)


@cache
def sound(seed: int) -> Diagnosis:
    return diagnosed(points(seed))


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (6, 7))])
def test_points_that_nothing_ails_are_not_accused(seed: int) -> None:
    assert sound(seed).verdict == "ADEQUATE"


def test_a_speed_that_is_set_and_kept_within_some_percent_is_one_speed() -> None:
    data = points(3)
    rate = next(one for one in covariates(data) if one.name == "log rate")
    number = bins(rate, 6)
    assert sorted(set(number)) == [0, 1]
    assert (number == (data.presses.speed_mm_s > 0.15)).all()
    spread = replace(rate, values=np.linspace(0, 1, 12))
    assert len(set(bins(spread, 6))) == 6, "values without gaps are cut into equal shares"


def test_presses_that_differ_with_the_speed_are_named_where_no_effect_explains_them() -> None:
    found = diagnosed(points(3, slow=0.025))
    assert found.verdict == "UNKNOWN"
    assert found.search.covariates[0].key == "log rate"
    contrast = found.presses.contrast
    assert contrast is not None
    assert contrast.presses == tuple(f"p{k}" for k in range(0, 12, 2))
    assert contrast.relative == pytest.approx(1 / (1 - 0.025) - 1, abs=0.006)
    assert (contrast.covariate, contrast.unit, contrast.above) == ("rate", "mm/s", True)
    assert 0.1 < contrast.at < 0.2
    assert all(label in verdict_sentence(found) for label in contrast.presses)


def test_one_session_is_sorted_by_its_order_alone() -> None:
    data = points(3)
    assert "order" in {one.name for one in covariates(data)}
    assert "recording date" not in {one.name for one in covariates(data)}
    days = replace(data, presses=replace(data.presses, day=np.repeat([0.0, 3.0], 6)))
    assert "recording date" in {one.name for one in covariates(days)}


def test_what_only_the_picture_shows_is_not_laid_to_the_forces() -> None:
    """UNKNOWN of the depth that the picture reads, beside forces that nothing ails."""
    found = sound(5)
    base = found.fits.base
    unseen = Searched(base, base, (), (), ScoreTest((), (), {}, {}))
    said = verdict_sentence(replace(found, verdict="UNKNOWN", search=replace(found.search, sight=unseen)))
    assert said.startswith("The reconstructed depth has an error")
    assert "No effect is significant in the forces themselves." in said
