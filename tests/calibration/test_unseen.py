"""E's interval allows for what may be there unseen; presses that stand out are set aside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations
from test_screen import MODEL, TRUTH, measured, presses

from calibration.diagnosis.sensitivity import UndetectedEffect, average_models
from calibration.effects import EFFECTS
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import outlying_presses
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.report.diagnosis_report import summary, verdict_sentence
from calibration.result.material import determine_material
from calibration.tasks.compare import base_model, fit_alone
from calibration.tasks.diagnose import diagnose
from tactilevision.records.measured import Estimate, Pair

RADII = (1.5, 2.5, 3.5)
THREE = Model(FlatPunch())


def three_radii(edge_mm: float | None = None) -> Observations:
    depths = [np.linspace(0.02, deepest, 15) for deepest in (0.3, 0.45, 0.45) for _ in RADII for _ in range(2)]
    punches = [indenter(f"R{r:g}", r) for _ in range(3) for r in RADII for _ in range(2)]
    return observations(depths, [replace(one, edge_radius_mm=edge_mm) for one in punches])


def fitted(effect: str = "", size: float = 0.0, edge_mm: float | None = None) -> Fit:
    """Of three radii, with an effect that the fit is not told of."""
    data, model = three_radii(edge_mm), THREE + EFFECTS[effect] if effect else THREE
    law = np.array([0.2, 0.48, 0.55, 0.85, 1.15])
    force = model.predict(np.append(law, size) if effect else law, data)
    rng = np.random.default_rng(3)
    gain = 1 + 0.005 * rng.standard_normal(data.count)[data.press]
    return fit_alone(base_model(data), data.with_force(force * gain + 0.004 * rng.standard_normal(data.size)))


def allowed(one: Fit, *keys: str) -> tuple[Estimate, Estimate, tuple[UndetectedEffect, ...]]:
    alone = determine_material(one).youngs_modulus
    return alone, *average_models(alone, one, effects=[EFFECTS[key] for key in keys or EFFECTS])


@pytest.mark.slow
def test_radii_that_exclude_a_wrong_thickness_leave_the_interval_as_it_is() -> None:
    alone, wide, unseen = allowed(fitted(edge_mm=0.0))
    before, after = _ends(alone), _ends(wide)
    assert after[0] <= before[0] < before[1] <= after[1], "never narrower"
    assert after[1] - after[0] < 1.25 * (before[1] - before[0])
    assert {u.key for u in unseen} >= {"thickness", "force_gain", "skin"}
    assert not {u.key for u in unseen} & {"backing_compliance", "bevel_rise"}, "the depth is the picture's"
    assert sum(u.chance for u in unseen) < 0.7


@pytest.mark.slow
def test_an_edge_that_is_not_stated_is_to_be_expected() -> None:
    """One of a size that radii do not show makes E low, and is in the interval; a stated one is no edge unseen."""
    effect = EFFECTS["edge_fillet"]
    data, model = three_radii(), THREE + effect
    force = model.predict(np.array([0.2, 0.48, 0.55, 0.85, 1.15, 0.06, 0.0]), data)
    rng = np.random.default_rng(3)
    gain = 1 + 0.005 * rng.standard_normal(data.count)[data.press]
    one = fit_alone(base_model(data), data.with_force(force * gain + 0.004 * rng.standard_normal(data.size)))
    alone, wide, unseen = allowed(one)
    assert alone.value is not None
    assert alone.value < 0.196
    assert _ends(wide)[0] < 0.2 < _ends(wide)[1]
    assert unseen[0].key == "edge_fillet"
    assert not effect.to_be_expected(three_radii(0.0))


@pytest.mark.slow
def test_a_thickness_that_the_radii_hint_at_is_in_the_interval() -> None:
    one = fitted("thickness", 0.12)
    alone, wide, unseen = allowed(one)
    assert _ends(alone)[1] < 0.2, "alone it misses the truth"
    assert _ends(wide)[0] < 0.2 < _ends(wide)[1]
    assert unseen[0].key in ("thickness", "skin")


def test_what_one_punch_cannot_show_keeps_its_chance_and_widens() -> None:
    data = presses()
    one = fit_alone(base_model(data), measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(1)))
    alone, wide, unseen = allowed(one, "thickness", "force_gain")
    assert {u.key: u.chance for u in unseen} == pytest.approx({"thickness": 0.25, "force_gain": 0.25}, abs=0.02)
    assert {u.key: u.off for u in unseen}["force_gain"] == pytest.approx(0.01, rel=0.1), "half its range of 2 %"
    assert 1.1 < np.diff(_ends(wide))[0] / np.diff(_ends(alone))[0] < 5


def test_effects_of_another_depth_are_absent() -> None:
    data = presses(2)
    assert EFFECTS["backing_compliance"].absent(data)
    assert not EFFECTS["backing_compliance"].absent(replace(data, depth_source="stage"))
    assert not EFFECTS["tilt"].absent(data)


@pytest.mark.slow
def test_a_press_that_cannot_belong_is_set_aside_and_both_verdicts_are_said() -> None:
    data = presses(20)
    force = MODEL.predict(TRUTH, data.shifted(np.where(data.press == 5, -0.06, 0.0)))
    found = diagnose(measured(data, force, np.random.default_rng(1)), np.random.default_rng(0))
    assert (found.verdict, found.presses.without, found.presses.set_aside) == ("UNKNOWN", "ADEQUATE", ("p5",))
    assert found.presses.odd.foreign
    said = verdict_sentence(found)
    assert "Press p5 cannot belong" in said
    assert "Without it: ADEQUATE. No effect is significant" in said
    assert found.as_json()["set_aside"] == {"presses": ["p5"], "verdict_without": "ADEQUATE"}
    assert found.measure_next[0].action.startswith("press p5 again")
    assert found.material.after.youngs_modulus.value == pytest.approx(0.2, rel=0.02), "the others' E"
    assert any(line.startswith("E of the base model: ") for line in summary(found))


def test_one_reading_far_out_among_heavy_tails_is_no_foreign_press() -> None:
    data = presses(30)
    rng = np.random.default_rng(5)
    tails = 0.006 * rng.standard_t(3, 30)
    tails[4] = 0.08
    force = MODEL.predict(TRUTH, data.shifted(tails[data.press]))
    one = fit_alone(base_model(data), measured(data, force, rng))
    heavy = outlying_presses(one)
    assert heavy.presses == ("p4",)
    assert not heavy.foreign


def _ends(E: Estimate) -> Pair:
    assert E.interval95 is not None
    return E.interval95
