"""Effects that together follow what one plain error of an instrument does alone are not believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from each import each
from test_diagnose import noisy
from test_effects import BASE, RICH

from calibration.diagnosis.forward_selection import Round, Searched, Step
from calibration.diagnosis.refit import adopt, refit_with
from calibration.diagnosis.score_test import Scored, ScoreTest
from calibration.diagnosis.unexplained import AlternativeExplanation, alternative_explanation, plain_errors
from calibration.effects import EFFECTS
from calibration.effects.instrument_errors import INSTRUMENT_ERRORS, InstrumentError, SinceTouch, since_touch
from calibration.fit.least_squares import fit
from calibration.fit.repeats import refit_with_pure_noise
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import Effect
from calibration.report.diagnosis_report import verdict_sentence
from calibration.tasks.diagnose import diagnose
from tactilevision.records.measured import Floats

LAW = Model(FlatPunch())
STANDING = tuple(Scored(error.key, 50.0, 0.0, 0.0) for error in INSTRUMENT_ERRORS)
NOTHING = ScoreTest((), (Scored("w", 1.0, 1.0, 1.0),), {}, {})
CREEP = np.array([-0.012, 1.5])


def planted(effect: Effect, values: Floats) -> Floats:
    """The force of the law with an effect."""
    return (LAW + effect).predict(np.concatenate([BASE, values]), RICH)


def named(
    force_N: Floats, keys: Sequence[str], seed: int = 3, *, standing: Sequence[Scored] = STANDING
) -> Searched:
    """A search that began with these plain errors beyond chance, added these effects and left nothing."""
    base = current = refit_with_pure_noise(fit(LAW, noisy(RICH, force_N, seed)))
    steps = []
    for key in keys:
        best = refit_with(before := current, EFFECTS[key])
        current = adopt(current, best)
        steps.append(Step(best, Scored(key, 1.0, 0.0, 0.0), 0.5, current, (best,), before))
    first = Round(replace(NOTHING, others=tuple(standing)), (), {}, base)
    return Searched(base, base, (first,), tuple(steps), NOTHING)


def explained(searched: Searched) -> AlternativeExplanation | None:
    return alternative_explanation(searched, plain_errors(searched))


@pytest.mark.slow
def test_a_creep_since_the_touch_stands_for_a_relaxation_beside_an_adhesion() -> None:
    found = explained(named(planted(SinceTouch(), CREEP), ("viscoelasticity", "adhesion")))
    assert found is not None
    assert (found.key, found.covariate) == ("force_since_touch", "t")
    assert found.instead_of == ("viscoelasticity", "adhesion")
    size, tau = (value for _, value in found.sizes)
    assert size == pytest.approx(CREEP[0], rel=0.3)
    assert tau == pytest.approx(CREEP[1], rel=0.6)
    assert found.as_json()["parameters"]["size_N"]["unit"] == "N"


ONE = [pytest.param(key, marks=pytest.mark.slow) for key in (("viscoelasticity",), ("force_bias",))]


@pytest.mark.parametrize("keys", [("depth_zero", "viscoelasticity"), *ONE])
def test_true_effects_alone_and_in_pairs_stand(keys: tuple[str, ...]) -> None:
    truth = {"viscoelasticity": [0.06, 1.0], "depth_zero": [0.015], "force_bias": [0.03]}
    model = LAW
    for key in keys:
        model = model + EFFECTS[key]
    values = np.concatenate([BASE, *(truth[effect.key] for effect in model.effects)])
    assert explained(named(model.predict(values, RICH), keys)) is None


def test_where_nothing_was_named_a_plain_error_is_told_only_if_it_helps() -> None:
    assert explained(named(LAW.predict(BASE, RICH), ())) is None
    back = next(error for error in INSTRUMENT_ERRORS if error.key == "depth_way_back")
    found = explained(named(planted(back, np.array([0.02])), ()))
    assert found is not None
    assert found.key == "depth_way_back"
    assert found.sizes[0][1] == pytest.approx(0.02, rel=0.2)


def test_a_plain_error_without_a_reason_displaces_nothing() -> None:
    back = next(error for error in INSTRUMENT_ERRORS if error.key == "depth_way_back")
    force = planted(back, np.array([0.02]))
    assert explained(named(force, (), standing=())) is None
    chance = [Scored(back.key, 9.0, 0.02, 0.3)]
    assert explained(named(force, (), standing=chance)) is None


@each("error", INSTRUMENT_ERRORS)
def test_a_plain_error_is_nothing_at_its_defaults_and_starts_inside_its_bounds(error: InstrumentError) -> None:
    off = np.array([p.default for p in error.parameters_on(RICH)])
    np.testing.assert_array_equal(planted(error, off), LAW.predict(BASE, RICH))
    assert not error.missing(RICH)
    for start in error.starts(RICH):
        for value, parameter in zip(start, error.parameters_on(RICH), strict=True):
            assert parameter.bounds[0] <= value <= parameter.bounds[1]
        assert np.ptp(planted(error, start) - planted(error, off)) > 0


def test_the_touch_is_where_the_depth_passes_nothing() -> None:
    since = since_touch(RICH)
    first = slice(0, 19)  # the first press: from -.012 mm on, 50 um/s
    expected = np.maximum(RICH.time_s[first] - RICH.time_s[0] - 0.012 / 0.05, 0.0)
    np.testing.assert_allclose(since[first], expected, atol=1e-9)
    inside = RICH.samples(RICH.depth_mm > 0)  # no sample of the air: back from the first two
    np.testing.assert_allclose(since_touch(inside), since[RICH.depth_mm > 0], atol=1e-6)


@pytest.mark.slow
def test_a_creeping_sensor_is_unknown_and_said_so() -> None:
    data = noisy(RICH, planted(SinceTouch(), CREEP), 4)
    found = diagnose(data, np.random.default_rng(0))
    assert found.verdict == "UNKNOWN"
    assert found.remainder.alternative_explanation is not None
    assert "grows from the moment of touch" in verdict_sentence(found)
    assert "dead weight" in found.measure_next[0].action
    assert found.as_json()["otherwise"]["key"] == "force_since_touch"
