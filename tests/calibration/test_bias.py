"""What E could be off by: effects that cannot be seen, and those below the size from which they show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations
from test_screen import MODEL, TRUTH, measured, presses, pure

from calibration.diagnosis import experiment_design as manual_checks
from calibration.diagnosis.sensitivity import largest, limits, possible_bias
from calibration.effects.backing_compliance import BackingCompliance
from calibration.effects.bevel_rise import BevelRise
from calibration.effects.depth_zero import DepthZero
from calibration.effects.force_gain import ForceGain
from calibration.effects.photometric_gain import PhotometricGain
from calibration.effects.viscoelasticity import Viscoelasticity
from calibration.fit.least_squares import Fit, fit
from calibration.inputs.observations import DepthSource, Observations, Shared
from calibration.model.stages import Effect


def points(source: DepthSource = "gauge") -> Observations:
    depths = [np.array([depth]) for depth in np.repeat([0.2, 0.3, 0.45, 0.6], 3)]
    return replace(observations(depths, [indenter()] * len(depths)), depth_source=source)


def fitted(data: Observations) -> Fit:
    return fit(MODEL, measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(0)))


def test_a_bevel_at_an_unknown_distance_is_worth_what_one_at_five_millimetres_is() -> None:
    """The rise of .10 w at 5 mm beside a punch of 2.5 mm makes E 9.5 % low."""
    data = points()
    stated = replace(data, indenters=(replace(data.indenters[0], bevel_distance_mm=5.0),))
    unknown, known = (possible_bias(fitted(d), [BevelRise()])["bevel_rise"] for d in (data, stated))
    assert unknown == pytest.approx(known)
    assert -0.13 < unknown < -0.08


@pytest.mark.parametrize(
    ("source", "there"),
    [("vision", {"photometric_gain"}), ("stage", {"backing_compliance"}), ("gauge", {"bevel_rise"})],
)
def test_what_cannot_be_in_a_depth_from_elsewhere_is_worth_nothing(source: DepthSource, there: set[str]) -> None:
    found = possible_bias(fitted(points(source)), [BevelRise(), PhotometricGain(), BackingCompliance()])
    assert set(found) == {"bevel_rise", "photometric_gain", "backing_compliance"}
    assert {key for key, share in found.items() if share} == there
    assert not manual_checks.of_hidden({key: share for key, share in found.items() if key not in there})


def test_a_rise_that_a_certificate_took_off_is_in_the_fit_and_worth_no_more() -> None:
    taken_off = replace(points(), shared=Shared(rise=0.01))
    assert possible_bias(fitted(taken_off), [BevelRise()]) == {"bevel_rise": 0.0}
    assert "subtracted" in BevelRise().missing(taken_off)


def test_an_effect_without_data_to_act_on_is_unknown_and_not_nothing() -> None:
    assert possible_bias(fitted(points()), [Viscoelasticity()]) == {}


def test_an_effect_that_shows_only_beyond_its_range_is_not_testable() -> None:
    fit_ = pure(presses_with_noise())
    effects: list[Effect] = [DepthZero(), ForceGain()]
    end = largest(DepthZero())
    seen = limits(fit_, effects, missing={"force_gain": "it is E"}, visible={"depth_zero": end / 2})
    assert set(seen.not_testable) == {"force_gain"}
    assert set(seen.below_visibility) == {"depth_zero"}
    beyond = limits(fit_, effects, missing={}, visible={"depth_zero": 1.3 * end, "force_gain": np.inf})
    assert set(beyond.not_testable) == {"depth_zero", "force_gain"}
    assert "from 0.065 mm on" in beyond.not_testable["depth_zero"]
    assert beyond.not_testable["force_gain"]
    assert beyond.below_visibility == {}
    assert abs(beyond.possible_bias["depth_zero"]) > 1.5 * abs(seen.below_visibility["depth_zero"]), (
        "at the end of its range"
    )


def presses_with_noise() -> Observations:
    data = presses(8)
    return measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(3))
